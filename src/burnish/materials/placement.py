"""What can be changed about a light beside how much it sends: its place, its aim, its shape.

Which parameters a light has depends on its kind (Mitsuba's name of the emitter):

| kind | parameters |
|---|---|
| `point` | `position` |
| `spot` | `position`, `direction`, `cutoff_angle`, `beam_width` |
| `projector` | `position`, `direction` |
| `directional` | `direction` |
| `area`, `directionalarea` | `position`, `size`, and `direction` where it faces one way |
| `envmap` | `rotation`, `exposure`, `file` |
| `sunsky` | `rotation`, `exposure` |
| `constant` | `exposure` |

Lengths are the scene's units, angles degrees. What a light is in the scene is the default of
its parameters. `exposure` is a factor of the light like its intensity, and needs no tracing;
the others are its *placement* and change the transport itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from burnish.core.types import Value
from burnish.materials.parameter import Parameter

EXPOSURE = "exposure"
"""The one parameter here that only scales the light."""

_FAR = 1e9

TEMPLATES: Mapping[str, Parameter] = {
    item.name: item
    for item in (
        Parameter(
            "position",
            (0.0, 0.0, 0.0),
            -_FAR,
            _FAR,
            kind="vector",
            description="where the light stands, in the scene's units; of a lamp, its middle",
        ),
        Parameter(
            "direction",
            (0.0, 0.0, 1.0),
            -1.0,
            1.0,
            kind="direction",
            description="where the light is aimed; of a lamp, the way it faces",
        ),
        Parameter(
            "cutoff_angle",
            20.0,
            0.01,
            180.0,
            1.0,
            80.0,
            unit="°",
            description="from the axis to where the cone ends",
        ),
        Parameter(
            "beam_width",
            15.0,
            0.0,
            180.0,
            0.0,
            80.0,
            unit="°",
            description="from the axis to where the light begins to fall off; at most the cutoff",
        ),
        Parameter(
            "size",
            1.0,
            1e-3,
            1e3,
            0.1,
            10.0,
            unit="×",
            scale="logarithmic",
            description="scales the lamp about its middle; it sends as much from each point",
        ),
        Parameter(
            "rotation",
            0.0,
            -360.0,
            360.0,
            -180.0,
            180.0,
            unit="°",
            description="turns the surroundings about their up axis, counter-clockwise from above",
        ),
        Parameter(
            EXPOSURE,
            0.0,
            -20.0,
            20.0,
            -6.0,
            6.0,
            unit="stops",
            description="one stop more is twice the light",
        ),
        Parameter(
            "file",
            "",
            kind="file",
            description="another picture of the surroundings, by latitude and longitude",
        ),
    )
}
"""Limits, units and meanings; each light has its own defaults."""

_FORMS: Mapping[str, tuple[str, ...]] = {
    "point": ("position",),
    "spot": ("position", "direction", "cutoff_angle", "beam_width"),
    "projector": ("position", "direction"),
    "directional": ("direction",),
    "area": ("position", "direction", "size"),
    "directionalarea": ("position", "direction", "size"),
    "envmap": ("rotation", EXPOSURE, "file"),
    "sunsky": ("rotation", EXPOSURE),
    "timed_sunsky": ("rotation", EXPOSURE),
    "constant": (EXPOSURE,),
}
_ALWAYS = ("size", "rotation", EXPOSURE, "file")
"""What starts alike for every light."""


def parameters_of(
    kind: str, values: Mapping[str, Value], extent: tuple[float, float] = (-1.0, 1.0)
) -> tuple[Parameter, ...]:
    """The parameters of a light of a kind, with the scene's values as their defaults.

    values: what the scene says; a parameter that it does not say is left out. extent: the
    least and the greatest coordinate that a slider for the position spans.
    """
    found = []
    for name in _FORMS.get(kind, ()):
        if name not in values and name not in _ALWAYS:
            continue
        known = TEMPLATES[name]
        if name == "position":
            known = replace(known, soft_minimum=extent[0], soft_maximum=extent[1])
        default = known.validate(values[name]) if name in values else known.default
        found.append(replace(known, default=default))
    return tuple(found)


def parameters_to_json(parameters: Sequence[Parameter]) -> dict[str, Any]:
    """Names, defaults and the position's extent, as `parameters_from_json` reads them."""
    return {
        item.name: {
            "default": list(item.default) if isinstance(item.default, tuple) else item.default,
            "span": [item.soft_minimum, item.soft_maximum],
        }
        for item in parameters
    }


def parameters_from_json(data: Mapping[str, Any]) -> tuple[Parameter, ...]:
    """The parameters that were written; those that are not known here are left out."""
    found = []
    for name, entry in data.items():
        if name in TEMPLATES:
            known = TEMPLATES[name]
            low, high = entry["span"]
            known = replace(known, soft_minimum=low, soft_maximum=high)
            found.append(replace(known, default=known.validate(entry["default"])))
    return tuple(found)
