"""The list of example scenes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from burnish.core.errors import UnknownName
from burnish.scene.examples import (
    cornell_box,
    earrings,
    interior,
    ring,
    room,
    sphere,
    still_life,
    tableau,
    teatray,
    vase,
)
from burnish.scene.objects import SceneObject

Finish = Callable[[SceneObject], SceneObject]
"""Gives an object what a Mitsuba scene cannot say, such as a Blinn-Phong layer."""


@dataclass(frozen=True)
class Example:
    """A scene made by code.

    describe: takes a folder for meshes and textures, returns a Mitsuba dictionary.
    finish: by object id, applied once the scene is loaded.
    """

    name: str
    description: str
    describe: Callable[[Path], dict[str, Any]]
    finish: Mapping[str, Finish]


def find(name: str) -> Example:
    """The example of that name. Raises UnknownName."""
    for example in EXAMPLES:
        if example.name == name:
            return example
    raise UnknownName("example scene", name, [example.name for example in EXAMPLES])


EXAMPLES: tuple[Example, ...] = (
    Example(
        "cornell-box",
        "The Cornell box: seven surfaces, each diffuse with a Blinn-Phong gloss to turn up",
        cornell_box.describe,
        cornell_box.FINISH,
    ),
    Example(
        "teatray",
        "The Utah teapot on a wooden tray with copper handles, in a room with a window",
        teatray.describe,
        teatray.FINISH,
    ),
    Example(
        "ring",
        "A gold ring on a plane: its inside throws a caustic",
        ring.describe,
        ring.FINISH,
    ),
    Example(
        "sphere",
        "One glossy sphere on a checkered floor between softboxes",
        sphere.describe,
        sphere.FINISH,
    ),
    Example(
        "vase",
        "Tulips in a glazed vase on a wooden table",
        vase.describe,
        vase.FINISH,
    ),
    Example(
        "tableau",
        "A porcelain rabbit and a jade dragon on polished marble",
        tableau.describe,
        tableau.FINISH,
    ),
    Example(
        "earrings",
        "Pearl earrings on a velvet cloth that drapes over a pedestal",
        earrings.describe,
        earrings.FINISH,
    ),
    Example(
        "still-life",
        "A ball, a bottle and a bowl of fruits on a lacquered table",
        still_life.describe,
        still_life.FINISH,
    ),
    Example(
        "interior",
        "A window with curtains over a tiled floor, and an armchair in its light",
        interior.describe,
        interior.FINISH,
    ),
    Example(
        "room",
        "A couch and stairs over parquet, in light that comes through windows alone",
        room.describe,
        room.FINISH,
    ),
)
