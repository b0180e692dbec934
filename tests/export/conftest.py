"""Scenes to export, and Mitsuba in a process of its own to render them."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest
from PIL import Image

from burnish.core.types import AnyArray
from burnish.reference import PathTracedTruth
from burnish.scene import Scene, load
from burnish.scene.device import activate

activate()

RENDER = """
import sys
import mitsuba as mi
import numpy as np
variant, scene, picture, plugin = sys.argv[1:]
mi.set_variant(variant)
if plugin == "plugin":
    import burnish
    burnish.mitsuba_plugin()
assert plugin == "plugin" or "burnish" not in sys.modules
# Unmerged, the lights are drawn in the order of the scene that was exported
loaded = mi.load_file(scene, optimize=False)
np.save(picture, np.array(mi.render(loaded, spp=16, seed=3)))
"""

Fresh = Callable[..., AnyArray]


@pytest.fixture
def fresh(tmp_path: Path) -> Fresh:
    """Mitsuba's picture of an XML file, from a process that knows nothing of burnish."""

    def render(scene: Path, plugin: bool = False) -> AnyArray:
        picture = tmp_path / "fresh.npy"
        words = [mi.variant(), str(scene), str(picture), "plugin" if plugin else "stock"]
        environment = dict(os.environ)
        source = str(Path(__file__).resolve().parents[2] / "src")
        environment["PYTHONPATH"] = source if plugin else ""
        done = subprocess.run(
            [sys.executable, "-c", RENDER, *words],
            capture_output=True,
            text=True,
            env=environment,
            timeout=300,
        )
        assert done.returncode == 0, done.stderr
        return np.asarray(np.load(picture))

    return render


def own(scene: Scene, state: Any) -> AnyArray:
    """The picture of the truth's own scene, with the samples that the other process takes."""
    built = PathTracedTruth(scene).mi_scene(state)
    path = mi.load_dict({"type": "path"})
    return np.array(mi.render(built, spp=16, seed=3, integrator=path))


def checks(path: Path) -> dict[str, Any]:
    """A bitmap of coloured squares."""
    squares = np.zeros((8, 8, 3), np.uint8)
    squares[::2, ::2], squares[1::2, 1::2] = (220, 120, 60), (60, 160, 220)
    squares[0], squares[:, 0] = 255, (0, 80, 0)
    Image.fromarray(squares).save(path)
    return {"type": "bitmap", "filename": str(path), "to_uv": mi.ScalarTransform4f().scale(3)}


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """One object of each kind: textured, coated, metal, principled, masked."""
    T = mi.ScalarTransform4f()
    texture = checks(tmp_path_factory.mktemp("room") / "checks.png")

    def ball(x: float, bsdf: dict[str, Any]) -> dict[str, Any]:
        return {"type": "sphere", "center": [x, 0.0, 0.6], "radius": 0.5, "bsdf": bsdf}

    coat = {"type": "roughplastic", "alpha": 0.2, "diffuse_reflectance": texture}
    return load(
        {
            "type": "scene",
            "floor": {"type": "rectangle", "to_world": T.scale(4), "bsdf": coat},
            "coated": ball(-1.8, {"type": "plastic", "nonlinear": True}),
            "metal": ball(-0.6, {"type": "roughconductor", "material": "Cu", "alpha": 0.2}),
            "burley": ball(
                0.6,
                {"type": "principled", "base_color": texture, "metallic": 0.3, "roughness": 0.4},
            ),
            "leaf": ball(
                1.8,
                {
                    "type": "mask",
                    "opacity": 0.7,
                    "b": {"type": "twosided", "d": {"type": "diffuse"}},
                },
            ),
            "lamp": {
                "type": "sphere",
                "center": [0, -3, 4],
                "radius": 0.5,
                "emitter": {"type": "area", "radiance": {"type": "rgb", "value": [20, 18, 15]}},
            },
            "sky": {"type": "constant", "radiance": 0.4},
            "view": {
                "type": "perspective",
                "fov": 40.0,
                "to_world": T.look_at([0, -6, 2.5], [0, 0, 0.4], [0, 0, 1]),
                "film": {"type": "hdrfilm", "width": 48, "height": 32},
            },
        }
    )
