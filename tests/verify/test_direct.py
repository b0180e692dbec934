"""Direct light from triangles against Mitsuba's, with the true materials (2006, figures 1-4)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import burnish
from burnish.compare import metrics
from burnish.compare.metrics import Metrics
from burnish.core.types import Float32, Value
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.model import Model, Values
from burnish.materials.models.ashikhmin_shirley import AshikhminShirleyRatio
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.materials.models.cook_torrance_curves import CookTorranceCurves
from burnish.materials.models.lambert import Lambert
from burnish.reference import PathTracedTruth
from burnish.scene import Scene, load
from burnish.scene.examples import find
from burnish.session import Session
from tests.verify.report import Figures

pytestmark = pytest.mark.verify

ENVIRONMENT = "debevec_grace_probe_latlong.hdr"
TRIANGLES = 4000
SAMPLES = 4096


def shaped(*layers: tuple[str, Model, Values]) -> Material:
    return Material(
        tuple(Layer.starting_at(name, model, values, bins=256) for name, model, values in layers),
        MaterialState({name: LayerState(values) for name, _, values in layers}),
    )


def blinn(color: tuple[float, ...], gloss: tuple[float, ...], exponent: float) -> Material:
    return shaped(
        ("diffuse", Lambert(), {"color": color}),
        ("specular", BlinnPhong(), {"color": gloss, "exponent": exponent}),
    )


def brushed(color: tuple[float, ...], ratio: float) -> Material:
    values = {"color": color, "exponent": 200.0, "ratio": ratio}
    return shaped(("specular", AshikhminShirleyRatio(), values))


TEATRAY = {
    "teapot": blinn((0.05, 0.15, 0.2), (0.5, 0.5, 0.5), 2000.0),
    "tray": blinn((0.3, 0.2, 0.1), (0.3, 0.3, 0.3), 100.0),
    "handles": brushed((0.7, 0.5, 0.3), 4.0),
}
EARRINGS = {
    "pearls": blinn((0.5, 0.45, 0.4), (0.3, 0.3, 0.3), 2000.0),
    "cloth": blinn((0.3, 0.02, 0.03), (0.1, 0.1, 0.1), 10.0),
}


def edits_of(glossy: str, other: str) -> dict[str, Mapping[str, Value]]:
    """Names of states and what makes them: of an object that is seen sharply, and another."""
    dull = {f"{glossy}.specular.color": (0.0, 0.0, 0.0), f"{other}.specular.color": (0.0, 0.0, 0.0)}
    return {
        "exponent 2000": {},
        "exponent 100": {f"{glossy}.specular.exponent": 100.0},
        "exponent 10": {f"{glossy}.specular.exponent": 10.0, f"{other}.specular.exponent": 10.0},
        "diffuse": dull,
    }


CASES: dict[str, tuple[Mapping[str, Material], dict[str, Mapping[str, Value]]]] = {
    "teatray": (
        TEATRAY,
        {**edits_of("teapot", "tray"), "anisotropic": {"handles.specular.ratio": 0.25}},
    ),
    "earrings": (EARRINGS, edits_of("pearls", "cloth")),
}


def under(
    assets: Path, name: str, materials: Mapping[str, Material], folder: Path, side: tuple[int, int]
) -> Scene:
    """An example with its environment replaced by a real one."""
    description = dict(find(name).describe(folder))
    for key, value in description.items():
        if isinstance(value, dict) and value.get("type") == "envmap":
            place = {"to_world": value["to_world"]} if "to_world" in value else {}
            description[key] = {
                "type": "envmap",
                "filename": str(assets / "env" / ENVIRONMENT),
                **place,
            }
    return load(description, resolution=side, materials=materials)


@dataclass
class Found:
    """Our picture, the truth and their figures, directly seen emission left out."""

    metrics: Metrics
    image: Float32
    reference: Float32


def against(session: Session, scene: Scene, spp: int = SAMPLES) -> Found:
    truth = PathTracedTruth(scene, bounces=1).estimate(session.state, spp=spp, seed=5)
    image = session.frame() - next(iter(session.views.values())).emission
    first, second = (a - b for a, b in zip(truth.halves, truth.emission_halves, strict=True))
    return Found(metrics(image, (first, second)), image, truth.reflected)


@pytest.mark.parametrize("name", CASES)
def test_a_scene_under_a_real_environment(
    figures: Figures, assets: Path, tmp_path: Path, name: str
) -> None:
    """Every state within 0.03 beyond noise, and FLIP within 0.05."""
    materials, states = CASES[name]
    scene = under(assets, name, materials, tmp_path, (320, 240))
    bundle = burnish.bake(
        scene, tmp_path / "direct.burnish", mode="direct", triangles=TRIANGLES, spp=SAMPLES // 4
    )
    with burnish.edit(bundle) as session:
        for state, edits in states.items():
            session.reset()
            for path, value in edits.items():
                session.set(path, value)
            found = against(session, scene)
            figures.close(state, found.metrics, 0.03, found.image, found.reference)
            figures.at_most(f"{state}: FLIP", found.metrics["flip"], 0.05)
    figures.settle()


def ball(assets: Path, material: Material, side: int) -> Scene:
    """A ball in the air, under a real environment."""
    import mitsuba as mi

    T = mi.ScalarTransform4f()
    look = T.look_at(origin=[0, -5, 0.5], target=[0, 0, 0], up=[0, 0, 1])
    description: dict[str, Any] = {
        "type": "scene",
        "ball": {"type": "sphere", "bsdf": {"type": "diffuse"}},
        "sky": {
            "type": "envmap",
            "filename": str(assets / "env" / ENVIRONMENT),
            "to_world": T.rotate([1, 0, 0], 90),
        },
        "view": {
            "type": "perspective",
            "fov": 26,
            "to_world": look,
            "film": {"type": "hdrfilm", "rfilter": {"type": "box"}},
        },
    }
    return load(description, resolution=(side, side), materials={"ball": material})


def test_fresnel_edits(figures: Figures, assets: Path, tmp_path: Path) -> None:
    """Copper made silver and chromium by n and k of each channel, with two curves: θh and θd."""
    copper = {"eta": (0.2004, 0.924, 1.1022), "k": (3.9129, 2.4528, 2.1421), "roughness": 0.12}
    model = CookTorranceCurves(bins=96, bins2=24)
    scene = ball(assets, shaped(("specular", model, {"color": (1.0, 1.0, 1.0), **copper})), 96)
    bundle = burnish.bake(
        scene, tmp_path / "ball.burnish", mode="direct", triangles=TRIANGLES, spp=64
    )
    metals = {
        "copper": (copper["eta"], copper["k"]),
        "silver": ((0.155, 0.1167, 0.1383), (4.8226, 3.1222, 2.1466)),
        "chromium": ((4.3696, 2.9167, 1.6547), (5.2064, 4.2313, 3.7549)),
    }
    with burnish.edit(bundle) as session:
        for what, (eta, k) in metals.items():
            session.set("ball.specular.eta", eta)
            session.set("ball.specular.k", k)
            found = against(session, scene)
            figures.close(what, found.metrics, 0.03, found.image, found.reference)
            figures.at_most(f"{what}: FLIP", found.metrics["flip"], 0.05)
    figures.settle()


def test_triangles_against_points(
    figures: Figures, assets: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Figure 4: on a ball of exponent 2000, 400 triangles are nearer to the truth than 4,000
    points, which are triangles too, each in the bin of its middle."""
    import mitsuba as mi

    from burnish.precompute.direct import bake, gather

    scene = ball(assets, blinn((0.0, 0.0, 0.0), (0.9, 0.9, 0.9), 2000.0), 128)
    errors = {}
    for what, count in (("triangles", 400), ("points", 4000)):
        if what == "points":
            # Nothing is split, everything counts as bent, and the place in it is its middle
            monkeypatch.setattr(bake, "SMALLEST", 1e9)
            monkeypatch.setattr(gather, "BEND", -1.0)
            monkeypatch.setattr(gather, "_random", lambda *_: (mi.Float(4 / 9), mi.Float(0.5)))
        bundle = burnish.bake(
            scene, tmp_path / f"{what}.burnish", mode="direct", triangles=count, spp=64
        )
        with burnish.edit(bundle) as session:
            found = against(session, scene)
        errors[what] = found.metrics["rel_rmse_beyond_noise"]
        figures.note(f"{count} {what}", f"{errors[what]:.4f}")
    ratio = errors["triangles"] / errors["points"]
    figures.at_most("error of triangles over that of points", ratio, 1.0)
    figures.settle()


def test_energy_of_the_real_maps(figures: Figures, assets: Path) -> None:
    """The triangles of each environment have the energy of its map, to 1e-4."""
    import mitsuba as mi

    from burnish.precompute.direct.environment import environment_triangles
    from burnish.precompute.direct.subdivision import solid_angles

    for place in sorted((assets / "env").iterdir()):
        emitter = mi.load_dict({"type": "envmap", "filename": str(place)})
        found = environment_triangles(emitter, TRIANGLES)
        energy = (found.radiance[:, 0] * solid_angles(found.corners)[:, None]).sum(axis=0)
        data = np.array(mi.traverse(emitter)["data"])[:, 1:-1, :3]
        texels = np.maximum(data.astype(np.float64), 0)
        height, width = texels.shape[:2]
        # The integral of a bilinear map over θ: a tent over each texel times sin θ
        theta = np.linspace(0, np.pi, height)
        h = np.pi / (height - 1)
        tent = np.sin(theta) * (2 * (1 - np.cos(h)) / h**2)
        tent[[0, -1]] = (1 - np.sin(h) / h) / h
        wanted = (texels * tent[:, None, None]).sum(axis=(0, 1)) * h * 2 * np.pi / width
        error = float(np.abs(energy / wanted - 1).max())
        figures.at_most(f"{place.name}: relative error of the energy", error, 1e-4)
    figures.settle()
