"""A parameter as data, so that a command line and an editor can be built from it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from burnish.core.errors import InvalidValue
from burnish.core.types import Value

Kind = Literal["scalar", "colour", "choice"]
Scale = Literal["linear", "logarithmic", "square"]


@dataclass(frozen=True)
class Parameter:
    """One knob of a model: its default, hard limits, soft limits and unit.

    Colours are linear RGB and the limits hold per channel. The soft limits are what a
    slider spans; the hard limits are what `validate` enforces. `scale` is how a slider's
    travel maps to the value, so that equal steps look alike: "square" is value = travel².
    `rough_minimum` is the minimum where a layer has no column for a perfectly smooth lobe.
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
        try:
            if self.kind == "colour":
                items = (value,) * 3 if isinstance(value, (int, float)) else tuple(value)  # type: ignore[arg-type]
                numbers = tuple(float(item) for item in items)
            else:
                numbers = (float(value),)  # type: ignore[arg-type]
        except (TypeError, ValueError):
            shape = "three numbers (linear RGB)" if self.kind == "colour" else "a number"
            raise InvalidValue(f"{field} must be {shape}; got {value!r}") from None
        if self.kind == "colour" and len(numbers) != 3:
            raise InvalidValue(f"{field} must be three numbers (linear RGB); got {value!r}")
        for number in numbers:
            if not (math.isfinite(number) and self.minimum <= number <= self.maximum):
                raise InvalidValue(
                    f"{field} must lie in [{self.minimum:g}, {self.maximum:g}]; got {value!r}"
                )
        if self.kind == "colour":
            return (numbers[0], numbers[1], numbers[2])
        return numbers[0]
