"""Measured materials against Mitsuba tracing the same table, read by code of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

import burnish
from burnish.materials.curve import Curve
from burnish.materials.measured import edited_table, measured_material, write_merl
from burnish.reference.film import Estimate, trace
from burnish.reference.merl import merl_bsdf
from burnish.reference.truth import directly_seen
from burnish.scene import Scene
from tests.materials.test_measured import networks
from tests.verify.pictures import Halves, compare
from tests.verify.report import Figures

pytestmark = pytest.mark.verify

MATERIALS = ("red-fabric", "alum-bronze", "nickel", "red-metallic-paint")
LIMIT = 0.03
GAIN = Curve((0.0, 0.2, 1.0), ((1.0, 1.0, 1.0), (0.3, 1.0, 2.0), (1.0, 1.0, 1.0)))


def merl_file(assets: Path, name: str, folder: Path) -> Path:
    nbrdf = networks(assets)
    path = folder / f"{name}.binary"
    with path.open("wb") as file:
        np.array([90, 90, 180], np.int32).tofile(file)
        nbrdf.to_merl(nbrdf.load(f"merl/{name}")).tofile(file)
    return path


def truth(scene: Scene, path: Path, spp: int) -> Estimate:
    """Direct light alone, by Mitsuba's path tracer with the plugin on the sphere."""
    built = scene.with_bsdfs({"sphere": merl_bsdf(path)})
    integrator = mi.load_dict({"type": "path", "max_depth": 2, "rr_depth": 99})

    def radiance(sampler: Any, ray: Any) -> tuple[Any, Any]:
        return mi.Color3f(integrator.sample(built, sampler, ray)[0]), directly_seen(built, ray)

    return trace(radiance, scene.view(), spp, seed=77)


@pytest.mark.parametrize("name", ["red-fabric", "alum-bronze", "red-metallic-paint"])
def test_mode_direct_on_a_measured_sphere(
    figures: Figures, assets: Path, tmp_path: Path, name: str
) -> None:
    """A fabric, a metal and a paint in mode `direct`: within 0.03."""
    path = merl_file(assets, name, tmp_path)
    scene = burnish.load(
        "sphere", materials={"sphere": measured_material(path)}, resolution=(24, 24)
    )
    # The samples are those of the floor, which is traced
    bundle = burnish.bake(scene, editable=["sphere"], mode="direct", triangles=1000, spp=4096)
    session = burnish.edit(bundle)
    image = session.frame() - next(iter(session.views.values())).emission
    found = compare((image, image), truth(scene, path, 32768))
    figures.close(name, found.metrics, LIMIT, found.image, found.reference)
    path.unlink()
    figures.settle()


@pytest.mark.parametrize("name", MATERIALS)
def test_direct_light_on_a_measured_sphere(
    figures: Figures, assets: Path, tmp_path: Path, name: str
) -> None:
    """A fabric, two metals and a paint, baked: within 0.03, as measured and with a curve drawn
    on the highlight and written to a file."""
    path = merl_file(assets, name, tmp_path)
    material = measured_material(path)
    scene = burnish.load("sphere", materials={"sphere": material}, resolution=(48, 48))
    halves = Halves.bake(scene, tmp_path, series=(128,), spp=4096, editable=["sphere"])
    for what in ("as measured", "edited"):
        if what == "edited":
            for session in halves.sessions:
                session.set_curve("sphere.specular", GAIN)
            path = tmp_path / "edited.binary"
            write_merl(path, edited_table(material, halves.sessions[0].state["sphere"]))
        found = compare(halves.frames(), truth(scene, path, 8192))
        figures.close(f"{name}, {what}", found.metrics, LIMIT, found.image, found.reference)
    for file in tmp_path.glob("*.binary"):
        file.unlink()
    figures.settle()
