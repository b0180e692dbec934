"""Masks, bump and normal maps and blends round an editable material, against Mitsuba's own."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from burnish.core.types import Value
from burnish.reference import PathTracedTruth
from burnish.scene import load
from tests.precompute import worlds
from tests.precompute.test_wrapping import waves
from tests.reference.worlds import SKY, camera, plane
from tests.verify.pictures import Halves, against_truth
from tests.verify.report import Figures

pytestmark = pytest.mark.verify

COATED = {
    "type": "roughplastic",
    "alpha": 0.15,
    "diffuse_reflectance": {"type": "rgb", "value": [0.5, 0.2, 0.1]},
}
METAL = {"type": "roughconductor", "alpha": 0.3, "eta": 0.0, "k": 1.0}
ROUGHNESS = (0.05, 0.2, 0.6)
SERIES = (64, 1, 1)


def textures(folder: Path) -> dict[str, dict[str, Any]]:
    height, normals = waves()
    pictures = {"height": height, "normals": normals * 0.5 + 0.5, "holes": (height > 0.5) * 1.0}
    for name, values in pictures.items():
        Image.fromarray(np.round(255 * values).astype(np.uint8)).save(folder / f"{name}.png")
    return {
        name: {"type": "bitmap", "filename": str(folder / f"{name}.png"), "raw": True}
        for name in pictures
    }


def wrappings(t: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    bent = {"type": "normalmap", "normalmap": t["normals"], "bsdf": COATED}
    return {
        "normalmap": bent,
        "bumpmap": {"type": "bumpmap", "arbitrary": t["height"], "scale": 0.2, "bsdf": COATED},
        "mask": {"type": "mask", "opacity": t["holes"], "bsdf": COATED},
        "all": {"type": "mask", "opacity": 0.7, "bsdf": {"type": "twosided", "bsdf": bent}},
        "blend": {"type": "blendbsdf", "weight": t["holes"], "first": COATED, "second": METAL},
    }


NAMES = ("normalmap", "bumpmap", "mask", "all", "blend")


@pytest.mark.parametrize(
    ("place", "name"),
    [*(("first", name) for name in NAMES), *(("after", name) for name in ("all", "blend"))],
)
def test_a_wrapping_as_it_is_and_edited(
    figures: Figures, tmp_path: Path, name: str, place: str
) -> None:
    """Seen itself, and in the light that it throws on an editable wall before it."""
    bsdf = wrappings(textures(tmp_path))[name]
    layer = "first_specular" if name == "blend" else "specular"
    description = {
        "type": "scene",
        "floor": plane(size=2.0, bsdf=bsdf),
        "wall": worlds.wall(),
        "behind": plane(z=-0.5, size=3.0),
        "lamp": worlds.lamp(),
        "sky": {**SKY, "radiance": 0.2},
        "view": camera(*worlds.VIEW, fov=35),
    }
    loaded = load(description, resolution=(48, 48))
    chosen = ["floor"] if place == "first" else ["floor", "wall"]
    tracer = PathTracedTruth(loaded, bounces=len(SERIES))
    halves = Halves.bake(loaded, tmp_path, series=SERIES, spp=4096, editable=chosen)
    limit = 0.02 if place == "first" else 0.05
    edits: list[tuple[str, Mapping[str, Value]]] = [("as it is", {})]
    edits += [(f"roughness {r:g}", {f"floor.{layer}.roughness": r}) for r in ROUGHNESS]
    for said, edit in edits:
        found = against_truth(halves, tracer, edit, 4096)
        bound = limit if not edit else 0.05
        figures.close(said, found.metrics, bound, found.image, found.reference)
    figures.settle()
