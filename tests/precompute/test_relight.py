"""Gather samples and their transfer: known answers, and Mitsuba for a light that has moved."""

from __future__ import annotations

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

import burnish
from burnish.app.relight import relight_session, without_lamps
from burnish.compare.metrics import metrics
from burnish.core.types import Float32
from burnish.materials.lights import each
from burnish.materials.names import resolve
from burnish.precompute.plan import basis_for
from burnish.precompute.relight.build import Settings, precompute
from burnish.precompute.relight.studio import RelitScene
from burnish.reference.truth import PathTracedTruth
from burnish.runtime.relight.light import cell_light
from burnish.runtime.relight.rows import apply, indirect
from burnish.runtime.relight.transport import RelightView
from burnish.runtime.renderer import Renderer
from burnish.scene import Scene
from burnish.scene.device import activate
from burnish.transport.basis import State, initial_state
from burnish.transport.gather import GatherData

SETTINGS = Settings(samples=2048, rays=256, bounce_rays=256)


def box(*, albedo: float = 0.5) -> Scene:
    """A closed box of one colour, with a lamp of no size in it and the camera inside."""
    activate()
    walls = {"type": "cube", "flip_normals": True, "bsdf": _matte(albedo)}
    block = {
        "type": "cube",
        "to_world": _moved((0.4, -0.6, 0.3), 0.3),
        "bsdf": _matte(albedo),
    }
    return burnish.load(
        {
            "type": "scene",
            "walls": walls,
            "block": block,
            "lamp": {"type": "point", "position": [0.0, 0.5, 0.0], "intensity": _grey(3.0)},
            "view": {
                "type": "perspective",
                "to_world": _looking((0.0, 0.2, -0.9), (0.0, -0.1, 1.0)),
                "fov": 70,
                "film": {"type": "hdrfilm", "width": 40, "height": 40},
            },
        }
    )


def _grey(value: float) -> dict[str, object]:
    return {"type": "rgb", "value": [value, value, value]}


def _matte(albedo: float) -> dict[str, object]:
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": _grey(albedo)}}


def _moved(place: tuple[float, float, float], scale: float) -> object:
    return mi.ScalarTransform4f().translate(list(place)).scale(scale)


def _looking(origin: tuple[float, float, float], target: tuple[float, float, float]) -> object:
    return mi.ScalarTransform4f().look_at(list(origin), list(target), [0.0, 1.0, 0.0])


@pytest.fixture(scope="module")
def relit() -> tuple[Scene, RelitScene]:
    scene = box()
    basis = basis_for(scene, series=(16, 1, 1, 1))
    return scene, RelitScene(scene, precompute(scene, basis, settings=SETTINGS))


def indirect_of(relit: RelitScene, state: State) -> Float32:
    data = relit.data
    light = cell_light(data, relit.irradiance(state, 8), relit.emission(state), state)
    return indirect(data, data.views["view"], light.radiance[0], state)


def indirect_truth(scene: Scene, state: State, spp: int) -> tuple[Float32, Float32]:
    """Halves of the light of all bounces but the first."""
    every, first = (
        PathTracedTruth(scene, bounces).estimate(state, spp=spp).halves for bounces in (4, 1)
    )
    return every[0] - first[0], every[1] - first[1]


def test_cells_cover_the_surfaces(relit: tuple[Scene, RelitScene]) -> None:
    samples = relit[1].data.samples
    # A cube of side 2, and one of side 0.6; the block's lower face lies below the floor's
    area = 6 * 4.0 + 6 * 0.36
    # Even points are counted: 32 a sample, so their number in all is known to 0.4 %
    assert samples.area.sum() == pytest.approx(area, rel=0.02)
    assert np.allclose(np.linalg.norm(samples.normal, axis=1), 1, atol=1e-5)
    share = samples.glossy.mean()
    # Nothing here is glossy, and the six to one is of what asks for it
    assert share == 0


def test_light_in_a_closed_box_is_kept(relit: tuple[Scene, RelitScene]) -> None:
    """Every ray lands, so the rows of M add up to one."""
    data = relit[1].data
    ones = np.ones((data.tree.cells, 1), np.float32)
    gathered = apply(data.bounce, data.tree.means(ones), np.ones((1, 1), np.float32))
    # Rows are smooth combinations of directions and not exact; 256 rays land all
    assert gathered.mean() == pytest.approx(1.0, abs=0.005)
    assert gathered.std() < 0.03


def test_white_light_on_all_cells_is_seen_as_albedo(relit: tuple[Scene, RelitScene]) -> None:
    """Under cells of radiance 1 everywhere a matte wall sends its albedo."""
    data = relit[1].data
    state = initial_state(data.basis.objects)
    view = data.views["view"]
    seen = indirect(data, view, np.ones((data.tree.cells, 3), np.float32), state)
    assert seen.mean() == pytest.approx(0.5, rel=0.005)


@pytest.mark.parametrize("place", [(0.0, 0.5, 0.0), (-0.6, -0.4, 0.5)])
def test_a_light_that_has_moved(
    relit: tuple[Scene, RelitScene], place: tuple[float, float, float]
) -> None:
    scene, direct = relit
    state = dict(initial_state(direct.data.basis.objects))
    group = each(scene.lights)[0]
    lamp = group.initial.set("position", place, group.key)
    lamp = replace(lamp, intensity=2.0, tint=(1.0, 0.8, 0.5))
    state[group.key] = lamp
    picture, emission = direct.picture("view", state, (), 64)
    ours = indirect_of(direct, state)
    truth = box()
    found = metrics(ours, indirect_truth(truth, state, 256))
    assert found["rel_rmse_beyond_noise"] < 0.08
    first = PathTracedTruth(truth, 1).estimate(state, spp=256)
    found = metrics(
        picture, first.halves, emission=0 * emission, reference_emission=first.emission_halves
    )
    assert found["rel_rmse_beyond_noise"] < 0.02


def test_an_open_albedo_is_a_polynomial(relit: tuple[Scene, RelitScene]) -> None:
    """L with a variable kept open, evaluated, is L with it settled."""
    direct = relit[1]
    data: GatherData = direct.data
    state = initial_state(data.basis.objects)
    light = direct.irradiance(state, 8), direct.emission(state)
    settled = cell_light(data, *light, state).radiance[0]
    opened = cell_light(data, *light, state, (0,))
    values = opened.monomials.evaluate(data.basis.albedos(state)[[0]])
    summed = np.einsum("zgh,zh->gh", opened.radiance, values.astype(np.float32))
    # Sums of at most four products in float32
    assert np.allclose(summed, settled, rtol=1e-4, atol=1e-6 * settled.max())


def test_a_frozen_form_follows_its_target(relit: tuple[Scene, RelitScene]) -> None:
    """What a target's columns and powers give for another colour is what settling it gives."""
    view = RelightView(relit[1].data, "view", relit[1])
    basis = view.basis
    state = dict(initial_state(basis.objects))
    renderer = Renderer(view.freeze((0,), state))
    item = basis.objects[0]
    address = resolve({item.id: item.material}, f"{item.id}.diffuse.color")
    edited = state | {item.id: address.write(item.material, state[item.id], (0.7, 0.3, 0.1))}
    ours = renderer.image(edited)
    settled = Renderer(view.freeze((), edited)).image(edited)
    # 64 other samples per pixel place the edges of objects and shadows; all else is the same
    assert np.linalg.norm(ours - settled) < 0.02 * np.linalg.norm(settled)
    assert ours.mean(axis=(0, 1)) == pytest.approx(settled.mean(axis=(0, 1)), rel=2e-3)


def test_a_light_that_is_off_is_dark(relit: tuple[Scene, RelitScene]) -> None:
    view = RelightView(relit[1].data, "view", relit[1])
    state = dict(initial_state(view.basis.objects))
    group = each(relit[0].lights)[0]
    state[group.key] = replace(group.initial, on=False)
    assert not Renderer(view.freeze((), state)).image(state).any()


def test_revisions_ask_for_better_pictures_only_where_they_are_wanted(
    relit: tuple[Scene, RelitScene],
) -> None:
    view = RelightView(relit[1].data, "view", relit[1])
    state = dict(initial_state(view.basis.objects))
    frozen = view.freeze((), state)
    assert view.revision == frozen.revision
    group = each(relit[0].lights)[0]
    view.follow({**state, group.key: replace(group.initial, intensity=2.0)})
    assert view.revision > frozen.revision


def test_no_node_stands_for_two_objects(relit: tuple[Scene, RelitScene]) -> None:
    """Nodes above the objects' own trees are opened before all others."""
    data = relit[1].data
    owner, tree = data.samples.object, data.tree
    mixed = [
        n
        for n in np.flatnonzero(tree.child >= 0)
        if len(np.unique(owner[tree.start[n] : tree.stop[n]])) > 1
    ]
    others = np.setdiff1d(np.arange(len(tree.start)), mixed)
    assert len(mixed)
    assert tree.extent[mixed].min() > 1e6 * tree.extent[others].max()


def test_lamps_are_put_away_from_scenes_that_are_not_about_the_origin() -> None:
    activate()
    # Eight times the size of the scene, along each axis, is the middle of it
    x = y = z = 8 * 33**0.5
    scene = burnish.load(
        {
            "type": "scene",
            "floor": {"type": "rectangle", "to_world": _moved((x, y, z), 2.0)},
            "lamp": {
                "type": "rectangle",
                "to_world": _moved((x, y, z + 1), 0.2),
                "emitter": {"type": "area", "radiance": _grey(3.0)},
            },
            "view": {"type": "perspective"},
        }
    )
    (lamp,) = (shape for shape in scene.mi_scene.shapes() if shape.is_emitter())
    box = scene.mi_scene.bbox()
    size = np.linalg.norm(np.asarray(box.extents()))
    before = np.asarray(lamp.bbox().center())
    with without_lamps(scene):
        away = np.linalg.norm(np.asarray(lamp.bbox().center()) - np.asarray(box.center()))
        assert away > 8 * size
    np.testing.assert_array_equal(np.asarray(lamp.bbox().center()), before)


def test_options_reach_a_scene_that_is_loaded_already() -> None:
    scene = box()
    with relight_session(scene, samples=64, rays=16, resolution=(12, 8)) as session:
        view = session.views["view"]
        assert isinstance(view, RelightView)
        assert (view.width, view.height) == (12, 8)
        assert session.path_trace(spp=2).shape == (8, 12, 3)
