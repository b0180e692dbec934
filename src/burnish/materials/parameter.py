"""A parameter as data, so that a command line and an editor can be built from it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from burnish.core.errors import InvalidValue, MissingFile
from burnish.core.types import Value

Kind = Literal["scalar", "colour", "choice", "vector", "direction", "file"]
Scale = Literal["linear", "logarithmic", "square"]

PICTURES = (".exr", ".hdr", ".rgbe", ".pfm", ".png", ".jpg", ".jpeg", ".tga", ".bmp")
"""Files that a parameter of kind "file" takes."""

_TRIPLES = {
    "colour": "three numbers (linear RGB)",
    "vector": "three numbers (x, y, z)",
    "direction": "three numbers (x, y, z), not all zero",
}


@dataclass(frozen=True)
class Parameter:
    """One knob of a model: its default, hard limits, soft limits and unit.

    Colours are linear RGB and the limits hold per channel. The soft limits are what a
    slider spans; the hard limits are what `validate` enforces. `scale` is how a slider's
    travel maps to the value, so that equal steps look alike: "square" is value = travel².
    `rough_minimum` is the minimum where a layer has no column for a perfectly smooth lobe.
    Of the kinds, a "vector" is x, y and z, a "direction" the same made a unit vector, and a
    "file" the path of a picture, or "" for the scene's own.
    """

    name: str
    default: Value
    minimum: float = 0.0
    maximum: float = 1.0
    soft_minimum: float | None = None
    soft_maximum: float | None = None
    unit: str = ""
    kind: Kind = "scalar"
    choices: tuple[str, ...] = ()
    description: str = ""
    scale: Scale = "linear"
    rough_minimum: float | None = None

    def validate(self, value: object, where: str = "") -> Value:
        """Return `value` in its canonical type. Raises InvalidValue when out of range."""
        field = f"{where}{self.name}"
        if self.kind == "choice":
            if value not in self.choices:
                raise InvalidValue(
                    f"{field} must be one of {', '.join(self.choices)}; got {value!r}"
                )
            return str(value)
        if self.kind == "file":
            return _picture(value, field)
        shape = _TRIPLES.get(self.kind, "a number")
        try:
            if self.kind in _TRIPLES:
                grey = self.kind == "colour" and isinstance(value, (int, float))
                items = (value,) * 3 if grey else tuple(value)  # type: ignore[arg-type]
                numbers = tuple(float(item) for item in items)  # type: ignore[arg-type]
            else:
                numbers = (float(value),)  # type: ignore[arg-type]
        except (TypeError, ValueError):
            raise InvalidValue(f"{field} must be {shape}; got {value!r}") from None
        if self.kind in _TRIPLES and len(numbers) != 3:
            raise InvalidValue(f"{field} must be {shape}; got {value!r}")
        if self.kind == "direction":
            length = math.hypot(*numbers)
            if not (math.isfinite(length) and length > 0):
                raise InvalidValue(f"{field} must be {shape}; got {value!r}")
            numbers = tuple(number / length for number in numbers)
        for number in numbers:
            if not (math.isfinite(number) and self.minimum <= number <= self.maximum):
                raise InvalidValue(
                    f"{field} must lie in [{self.minimum:g}, {self.maximum:g}]; got {value!r}"
                )
        if self.kind in _TRIPLES:
            return (numbers[0], numbers[1], numbers[2])
        return numbers[0]


def _picture(value: object, field: str) -> str:
    """The absolute path of a picture, or "". Raises InvalidValue, MissingFile."""
    if value == "":
        return ""
    if not isinstance(value, (str, Path)) or Path(value).suffix.lower() not in PICTURES:
        raise InvalidValue(
            f"{field} must be the path of a picture ({', '.join(PICTURES)}); got {value!r}"
        )
    place = Path(value).expanduser().resolve()
    if not place.is_file():
        raise MissingFile(f"{field}: no file {str(value)!r}; check the path")
    return str(place)
