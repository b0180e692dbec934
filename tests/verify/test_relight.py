"""At full size: relighting against Mitsuba, light that comes round and direct light apart."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import burnish
from burnish.app.relight import relight_session
from burnish.compare.metrics import Metrics, metrics
from burnish.core.types import Float32
from burnish.precompute.relight.build import Settings
from burnish.precompute.relight.paths import Paths
from burnish.precompute.relight.points import PointGather
from burnish.precompute.symbolic import SymbolicMaterials
from burnish.reference import PathTracedTruth
from burnish.runtime.relight.light import cell_light
from burnish.runtime.relight.rows import indirect
from burnish.runtime.relight.transport import RelightView
from burnish.scene import Scene
from burnish.scene.device import activate
from burnish.scene.examples import cornell_box
from burnish.session import Session
from burnish.transport.basis import Basis
from tests.verify.report import Figures

pytestmark = pytest.mark.verify

SIDE, SAMPLES, SPP, COMBINATIONS = 96, 16384, 1024, 10
INDIRECT, DIRECT = 0.08, 0.02

SCENES = ("cornell-gloss", "cornell-gloss-lamp", "tableau", "still-life", "interior")
"""The Cornell box with a glossy floor under a lamp of no size and under its own, and others."""


def glossy_cornell(folder: Path, own_lamp: bool = False) -> dict[str, Any]:
    """The Cornell box, its floor of glossy plastic, with a lamp of no size or its own in it."""
    scene = cornell_box.describe(folder)
    scene["floor"]["bsdf"] = {
        "type": "roughplastic",
        "alpha": 0.1,
        "distribution": "ggx",
        "diffuse_reflectance": {"type": "rgb", "value": [0.4, 0.4, 0.4]},
    }
    if own_lamp:
        return scene
    del scene["light"]
    scene["lamp"] = {
        "type": "point",
        "position": [2.78, 4.2, 2.8],
        "intensity": {"type": "rgb", "value": [12.0, 10.0, 8.0]},
    }
    return scene


def opened(name: str, folder: Path, samples: int) -> tuple[Scene, Session, RelightView]:
    activate()
    boxes = {"cornell-gloss": False, "cornell-gloss-lamp": True}
    source = glossy_cornell(folder, boxes[name]) if name in boxes else name
    scene = burnish.load(source, resolution=(SIDE, SIDE))
    session = relight_session(scene, samples=samples)
    view = next(iter(session.views.values()))
    assert isinstance(view, RelightView)
    return scene, session, view


def rearrange(session: Session, rng: np.random.Generator) -> None:
    """Lights elsewhere and of other colours, materials of other colours and widths."""
    for light in session.lights:
        for name in light.names:
            path = f"{light.key}.{name}"
            if name == "rotation":
                session.set(path, float(rng.uniform(-180, 180)))
            elif name == "tint":
                session.set(path, tuple(rng.uniform(0.5, 1, 3).tolist()))
            elif name == "position":
                place = np.asarray(session.get(path))
                session.set(path, tuple((place - rng.uniform(0, 0.8, 3) * (1, 0.5, 1)).tolist()))
    for item in session.objects:
        material = session.material(item.id)
        if material is None:
            continue
        for layer in material.layers:
            for parameter in material.parameters(layer.name):
                path = f"{item.id}.{layer.name}.{parameter.name}"
                if parameter.name == "color":
                    session.set(path, tuple(rng.uniform(0.1, 0.8, 3).tolist()))
                elif parameter.name == "roughness" and layer.model.lobe == "half":
                    session.set(path, float(rng.uniform(0.1, 0.5)))


def come_round(session: Session, view: RelightView) -> Float32:
    """The light of all bounces but the first, with the session's lights and materials."""
    state, direct = session.state, view.direct
    light = cell_light(view.data, direct.irradiance(state, 32), direct.emission(state), state)
    return indirect(view.data, view.view, light.radiance[0], state)


def truth_of(scene: Scene, session: Session) -> tuple[tuple[Float32, Float32], ...]:
    """Halves of the light that comes round, of direct light, and of directly seen emission."""
    every, first = (
        PathTracedTruth(scene, bounces).estimate(session.state, spp=SPP) for bounces in (4, 1)
    )
    rest = every.halves[0] - first.halves[0], every.halves[1] - first.halves[1]
    return rest, first.halves, first.emission_halves


def compared(
    figures: Figures, folder: Path, name: str, combinations: int
) -> Iterator[tuple[str, Metrics, Metrics]]:
    """The scene as it is and random arrangements: indirect and direct light against Mitsuba's."""
    scene, session, view = opened(name, folder, SAMPLES)
    rng = np.random.default_rng(5)
    for number in range(combinations + 1):
        if number:
            rearrange(session, rng)
        rest, first, emission = truth_of(scene, session)
        round_about = metrics(come_round(session, view), rest)
        one, two = (
            view.direct.picture(view.name, session.state, (), 256 * (k + 1))[0] for k in range(2)
        )
        # The second holds the first and as many samples again
        halves = one, np.asarray(2 * two - one)
        straight = metrics(halves, first, emission=np.zeros_like(one), reference_emission=emission)
        yield f"{name}, {number or 'as in the scene'}", round_about, straight


@pytest.mark.parametrize("name", SCENES)
def test_lights_and_materials_together(figures: Figures, tmp_path: Path, name: str) -> None:
    """The scene as it is and ten random arrangements of its lights and materials."""
    for what, indirect_part, direct_part in compared(figures, tmp_path, name, COMBINATIONS):
        figures.note(f"{what}: noise of its reference", indirect_part["noise"])
        error = indirect_part["rel_rmse_beyond_noise"]
        figures.at_most(f"{what}: indirect", error, INDIRECT)
        figures.at_most(f"{what}: direct", direct_part["rel_rmse_beyond_noise"], DIRECT)
    figures.settle()


def test_more_samples_come_closer(figures: Figures, tmp_path: Path) -> None:
    """The error of the glossy box falls with the number of gather samples."""
    errors = []
    for samples in (1024, 4096, 16384):
        scene, session, view = opened("cornell-gloss", tmp_path, samples)
        rest, _, _ = truth_of(scene, session)
        errors.append(metrics(come_round(session, view), rest)["rel_rmse_beyond_noise"])
        figures.note(f"{samples} gather samples", errors[-1])
    figures.at_most("16,384 over 1,024 samples", errors[-1] / errors[0], 1.0)
    figures.settle()


def test_sub_areas_on_a_glossy_floor(figures: Figures, tmp_path: Path) -> None:
    """Figure 2: at equal gather samples, one point for each and points all over its area."""
    scene, session, view = opened("cornell-gloss", tmp_path, 4096)
    state, data = session.state, view.data
    rest, _, _ = truth_of(scene, session)
    light = cell_light(
        data, view.direct.irradiance(state, 32), view.direct.emission(state), state
    ).radiance[0]
    ours = indirect(data, view.view, light, state).reshape(-1, 3)
    floor = view.basis.index("floor")
    own = view.rows.pixel[(view.rows.object == floor) & (view.rows.weight > 0.99)]
    materials = SymbolicMaterials(
        scene, Basis((), (16, 1, 1)), {item.id: state[item.id] for item in view.basis.objects}
    )
    gather = PointGather(Paths(scene, materials), scene.view(), data.samples, light)
    truth = tuple(half.reshape(-1, 3)[own][None] for half in rest)
    errors = {}
    for what, found in (
        ("samples alone", gather.picture(own, 1, 16, 3)),
        ("16 points on the disk of each", gather.picture(own, 16, 16, 3)),
        ("rays", ours[own]),
    ):
        errors[what] = metrics(found[None], truth)["rel_rmse_beyond_noise"]
        figures.note(f"glossy floor: {what}", errors[what])
    figures.at_most("rays over samples alone", errors["rays"] / errors["samples alone"], 0.5)
    figures.settle()


def test_settings_are_the_paper_s() -> None:
    """16k gather samples where nothing else is asked."""
    assert Settings().samples == SAMPLES
