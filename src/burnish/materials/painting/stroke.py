"""Strokes as values: where a brush went on an object, and what it does there.

A stroke lies on the surface, in scene units, and knows no picture: the same strokes paint the
rows of every view, a bake of another size, or the texels of a texture. What they make of a
parameter is an affine map of the value that the material itself has (see `canvas`), so that
what was not painted goes on following its slider.
"""

from __future__ import annotations

import base64
import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from burnish.core.errors import InvalidValue

Triple = tuple[float, float, float]
Kind = Literal["set", "add", "scale", "move", "erase", "clone"]

WEIGHT = "weight"
"""The parameter of a layer that scales all of it: 2006's and 2008's H."""


class Dab(NamedTuple):
    """One touch of a brush: a ball about a point of the surface.

    position, normal: world space. radius: scene units. pressure: 0 to 1. source and
    source_normal: where a clone stamp copies from.
    """

    position: Triple
    normal: Triple
    radius: float
    pressure: float = 1.0
    source: Triple | None = None
    source_normal: Triple | None = None


@dataclass(frozen=True)
class Edit:
    """What a stroke of weight w does to a parameter's u: travel, linear RGB, or H.

    | kind | effect | value |
    |---|---|---|
    | set | u ← (1 − w) u + w · value | 1 or 3 numbers |
    | add | u ← u + w · value, held inside the slider | 1 number of travel |
    | scale | u ← (1 − w + w · value) u | 1 number, of H |
    | move | H ← H + w · share · ratio · H of `source`, which falls by w · share | share, ratio |
    | erase | back to the material's own by w; every parameter where layer is "" | – |
    | clone | u ← (1 − w) u + w · u at the source; every parameter | – |

    base: for "add", the material's own travel when the stroke was made, which keeps u inside
    [0, 1].
    Raises InvalidValue.
    """

    kind: Kind
    layer: str = ""
    parameter: str = ""
    value: tuple[float, ...] = ()
    source: str = ""
    base: float = 0.0

    def __post_init__(self) -> None:
        sizes = {"set": (1, 3), "add": (1,), "scale": (1,), "move": (2,), "erase": (0,)}
        if self.kind not in get_args(Kind):
            raise InvalidValue(
                f"a stroke's edit must be one of {', '.join(get_args(Kind))}; got {self.kind!r}"
            )
        numbers = (*self.value, self.base)
        if len(self.value) not in sizes.get(self.kind, (0,)) or not all(
            map(math.isfinite, numbers)
        ):
            raise InvalidValue(f"edit {self.kind!r} does not take the numbers {self.value!r}")
        if self.kind not in ("erase", "clone") and not (self.layer and self.parameter):
            raise InvalidValue(f"edit {self.kind!r} needs a layer and a parameter")


@dataclass(frozen=True)
class Stroke:
    """A brush's way over one object.

    brush: its name, for people. edits: what it does. dabs: where, none for all of the object.
    strength: 0 to 1, the largest weight. falloff: the standard deviation of the Gaussian, as
    a share of the radius, 0 to 10; 0 is a hard edge.
    Raises InvalidValue.
    """

    brush: str
    edits: tuple[Edit, ...]
    dabs: tuple[Dab, ...] = ()
    strength: float = 1.0
    falloff: float = 0.6
    everywhere: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.strength <= 1:
            raise InvalidValue(f"strength must lie in [0, 1]; got {self.strength!r}")
        if not 0 <= self.falloff <= 10:
            raise InvalidValue(f"falloff must lie in [0, 10]; got {self.falloff!r}")
        for dab in self.dabs:
            if not (0 < dab.radius < math.inf and 0 <= dab.pressure <= 1):
                raise InvalidValue(
                    "a dab's radius must be above 0 and its pressure in [0, 1]; "
                    f"got {dab.radius!r}, {dab.pressure!r}"
                )

    def continues(self, other: Stroke) -> bool:
        """Whether this is `other` drawn further."""
        return replace(self, dabs=self.dabs[: len(other.dabs)]) == other

    def to_json(self) -> dict[str, Any]:
        """Plain values; the dabs as compressed float32."""
        data: dict[str, Any] = {
            "brush": self.brush,
            "edits": [_edit_to_json(edit) for edit in self.edits],
            "strength": self.strength,
            "falloff": self.falloff,
        }
        if self.everywhere:
            data["everywhere"] = True
        if self.dabs:
            numbers = np.array([_numbers(dab) for dab in self.dabs], "<f4")
            packed = base64.b64encode(zlib.compress(numbers.tobytes(), 9)).decode("ascii")
            data |= {"columns": numbers.shape[1], "dabs": packed}
        return data

    @staticmethod
    def from_json(data: Mapping[str, Any]) -> Stroke:
        """The inverse of `to_json`. Raises InvalidValue."""
        try:
            dabs: tuple[Dab, ...] = ()
            if "dabs" in data:
                raw = zlib.decompress(base64.b64decode(data["dabs"], validate=True))
                numbers = np.frombuffer(raw, "<f4").reshape(-1, int(data["columns"]))
                dabs = tuple(_dab(row) for row in numbers.tolist())
            return Stroke(
                brush=str(data["brush"]),
                edits=tuple(_edit_from_json(item) for item in data["edits"]),
                dabs=dabs,
                strength=float(data["strength"]),
                falloff=float(data["falloff"]),
                everywhere=bool(data.get("everywhere", False)),
            )
        except InvalidValue:
            raise
        except (KeyError, TypeError, ValueError, AttributeError, zlib.error) as error:
            raise InvalidValue(
                f"a stroke has a field that is missing or of the wrong shape ({error}); the file "
                "is damaged or from another version of burnish"
            ) from None


def narrow(value: float) -> float:
    """A number as a file will hold it, so that a stroke read back is the same stroke."""
    return float(np.float32(value))


def _edit_to_json(edit: Edit) -> dict[str, Any]:
    fields: dict[str, Any] = {
        "layer": edit.layer,
        "parameter": edit.parameter,
        "value": list(edit.value),
        "source": edit.source,
        "base": edit.base,
    }
    return {"kind": edit.kind, **{name: value for name, value in fields.items() if value}}


def _edit_from_json(data: Mapping[str, Any]) -> Edit:
    return Edit(
        kind=data["kind"],
        layer=str(data.get("layer", "")),
        parameter=str(data.get("parameter", "")),
        value=tuple(float(item) for item in data.get("value", ())),
        source=str(data.get("source", "")),
        base=float(data.get("base", 0.0)),
    )


def _numbers(dab: Dab) -> list[float]:
    own = [*dab.position, *dab.normal, dab.radius, dab.pressure]
    if dab.source is None or dab.source_normal is None:
        return own
    return [*own, *dab.source, *dab.source_normal]


def _dab(row: list[float]) -> Dab:
    if len(row) not in (8, 14) or not all(map(math.isfinite, row)):
        raise ValueError("dabs must be 8 or 14 finite numbers each")
    x, y, z, nx, ny, nz, radius, pressure = row[:8]
    if len(row) == 8:
        return Dab((x, y, z), (nx, ny, nz), radius, pressure)
    a, b, c, na, nb, nc = row[8:]
    return Dab((x, y, z), (nx, ny, nz), radius, pressure, (a, b, c), (na, nb, nc))
