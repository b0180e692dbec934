"""Random materials in a small studio, path-traced with noise, and what a fit makes of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

import burnish
from burnish.core.types import Float32, Float64, Value
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.model import Model
from burnish.materials.models.lambert import Lambert
from burnish.reference.truth import PathTracedTruth
from burnish.scene import Scene
from burnish.session import Session
from burnish.session.findings import Fit
from burnish.session.unknowns import CurveOptions, unknowns_of
from tests.reference.worlds import world

BOUNCES = 3
RANGES: dict[str, tuple[float, float]] = {
    "exponent": (5.0, 1000.0),
    "roughness": (0.05, 0.6),
    "ratio": (0.1, 10.0),
}
"""What a random material draws from, where a model's whole range shows nothing in 48 pixels."""


@dataclass(frozen=True)
class Studio:
    """A sphere of a diffuse and a glossy layer on a matte floor, under two lamps, baked."""

    scene: Scene
    bundle: Any

    def session(self) -> Session:
        return burnish.edit(self.bundle)

    def traced(self, session: Session, spp: int, seed: int) -> Float32:
        """The session's materials by the path tracer, as noisy as `spp` makes it."""
        return PathTracedTruth(self.scene, BOUNCES).render(
            session.materials, self.scene.views[0].name, spp, seed
        )


def lamp(x: float, y: float, z: float, side: float, light: float) -> dict[str, Any]:
    to_world = mi.ScalarTransform4f().look_at([x, y, z], [0, 0, 0.8], [0, 0, 1])
    return {
        "type": "rectangle",
        "to_world": to_world @ mi.ScalarTransform4f().scale([side, side, 1.0]),
        "emitter": {"type": "area", "radiance": light},
    }


def studio(model: Model, folder: Path, spp: int = 256, side: int = 48) -> Studio:
    """Trace it once, with the sphere's glossy layer of the given model."""
    values: dict[str, Value] = {item.name: item.default for item in model.parameters}
    values["color"] = (0.3, 0.3, 0.3)
    layers = (
        Layer("diffuse", Lambert(), bins=1),
        Layer.starting_at("specular", model, values, bins=64),
    )
    grey = LayerState({"color": (0.3, 0.3, 0.3)})
    glossy = Material(layers, MaterialState({"diffuse": grey, "specular": LayerState(values)}))
    matte = Material(layers[:1], MaterialState({"diffuse": grey}))
    view = mi.ScalarTransform4f().look_at([0, -5, 2.2], [0, 0, 0.8], [0, 0, 1])
    description = {
        "integrator": {"type": "path"},
        "ball": {"type": "sphere", "center": [0, 0, 1], "radius": 1.0},
        "floor": {"type": "rectangle", "to_world": mi.ScalarTransform4f().scale([4, 4, 1])},
        "key": lamp(-3, -3, 4, 0.5, 30.0),
        "fill": lamp(4, -2, 2.5, 1.0, 5.0),
        "camera": {
            "type": "perspective",
            "fov": 34.0,
            "to_world": view,
            "film": {"type": "hdrfilm", "width": side, "height": side},
        },
    }
    scene = world(description, {"ball": glossy, "floor": matte}, (side, side))
    bundle = burnish.bake(scene, folder / "studio.burnish", series=(64, *(1,) * (BOUNCES - 1)),
                          spp=spp, seed=7)  # fmt: skip
    return Studio(scene, bundle)


def randomise(session: Session, seed: int) -> None:
    """Give the ball a random material that reflects no more than it receives."""
    rng = np.random.default_rng(seed)
    for layer, top in (("diffuse", 0.5), ("specular", 0.45)):
        material = session.material("ball")
        assert material is not None
        for item in material.parameters(layer):
            path = f"ball.{layer}.{item.name}"
            if item.kind == "colour":
                session.set(path, 0.05 + (top - 0.05) * rng.random(3))
                continue
            low, high = RANGES.get(item.name, (item.minimum, item.maximum))
            if item.scale == "logarithmic":
                session.set(path, math.exp(rng.uniform(math.log(low), math.log(high))))
            else:
                session.set(path, rng.uniform(math.sqrt(low), math.sqrt(high)) ** 2)


def travels(session: Session) -> Float64:
    """The ball's parameters in slider travel."""
    material = session.material("ball")
    assert material is not None
    unknowns = unknowns_of({"ball": material}, session.state, ["ball"], None, CurveOptions())
    return np.concatenate([item.read(session.state["ball"]) for item in unknowns])


@dataclass(frozen=True)
class Recovery:
    """errors: of the numbers that the fit calls determined, in travel. ratio: the fit's image
    error over the error at the true parameters."""

    errors: Float64
    ratio: float
    fit: Fit


def recover(place: Studio, seed: int, spp: int = 64) -> Recovery:
    """Trace one random material, start from another, fit."""
    session = place.session()
    randomise(session, 2 * seed)
    target = place.traced(session, spp, seed)
    true, own = travels(session), session.frame()
    randomise(session, 2 * seed + 1)
    found = burnish.fit(session, target, objects=["ball"])
    assert session.frame().shape == target.shape
    determined = np.array([item.determined for item in found.numbers])
    ratio = np.linalg.norm(session.frame() - target) / np.linalg.norm(own - target)
    return Recovery(np.abs(travels(session) - true)[determined], float(ratio), found)
