"""Strokes on points of a surface: where they reach, what they make, and how all goes back."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from burnish.core.errors import InvalidValue
from burnish.materials.coefficients import coefficients
from burnish.materials.layer import Layer, LayerState
from burnish.materials.painting.canvas import Canvas, gaussian
from burnish.materials.painting.stroke import Dab, Edit, Stroke, narrow
from burnish.materials.painting.varied import interpolation
from burnish.materials.registry import MODELS
from burnish.materials.travel import Travel

SIDE = 40
UP = (0.0, 0.0, 1.0)
TARGET = Edit("set", "diffuse", "color", (0.8, 0.1, 0.3))
HALVE = Edit("scale", "specular", "weight", (0.5,))
BLUR = Edit("add", "specular", "roughness", (0.25,), base=0.5)


def plane(height: float = 0.0) -> np.ndarray:
    """Points of a grid of 40 × 40 in the unit square."""
    x, y = np.meshgrid(*(2 * [(np.arange(SIDE) + 0.5) / SIDE]))
    return np.stack([x, y, np.full_like(x, height)], axis=2).reshape(-1, 3).astype(np.float32)


def flat(positions: np.ndarray) -> Canvas:
    return Canvas(positions, np.broadcast_to(np.float32(UP), positions.shape))


def dab(x: float, y: float, z: float = 0.0, radius: float = 0.2, pressure: float = 1.0) -> Dab:
    return Dab((x, y, z), UP, radius, pressure)


def random_strokes(count: int, seed: int = 4) -> list[Stroke]:
    rng = np.random.default_rng(seed)
    kinds = (
        TARGET,
        HALVE,
        BLUR,
        Edit("add", "specular", "roughness", (-0.4,), base=0.5),
        Edit("move", "specular", "weight", (0.5, 1.5), source="diffuse"),
        Edit("erase"),
        Edit("clone"),
    )
    result = []
    for number in range(count):
        edit = kinds[number % len(kinds)]
        dabs = []
        for x, y, a, b in rng.random((rng.integers(1, 12), 4)):
            source = ((a, b, 0.0), UP) if edit.kind == "clone" else (None, None)
            dabs.append(Dab((x, y, 0.0), UP, 0.05 + 0.2 * a, narrow(b), *source))
        result.append(
            Stroke(
                "any",
                (edit,),
                tuple(dabs),
                narrow(rng.random()),
                (0.0, 0.6)[number % 2],
                everywhere=number % 29 == 0 and edit.kind != "clone",
            )
        )
    return result


def contents(canvas: Canvas) -> dict[tuple[str, str], bytes]:
    return {
        place: item.scale.tobytes() + item.shift.tobytes() for place, item in canvas.maps.items()
    }


def test_the_falloff_is_one_at_the_centre_and_falls_to_zero_at_the_radius() -> None:
    distance = np.linspace(0, 1.2, 500)
    for falloff in (0.2, 0.6, 3.0):
        weight = gaussian(distance, falloff)
        assert weight[0] == 1
        assert (np.diff(weight) <= 0).all()
        assert (weight[distance >= 1] == 0).all()
        assert np.abs(np.diff(weight)).max() < 0.05  # no step anywhere
    np.testing.assert_array_equal(gaussian(distance, 0.0), distance <= 1)


def test_a_stroke_reaches_the_points_within_its_radius_and_no_others() -> None:
    positions = plane()
    canvas = flat(positions)
    canvas.show([Stroke("b", (TARGET,), (dab(0.3, 0.4), dab(0.5, 0.4)), 1.0, 0.0)])
    centres = np.array([[0.3, 0.4, 0], [0.5, 0.4, 0]])
    distance = np.linalg.norm(positions[:, None] - centres, axis=2).min(axis=1)
    item = canvas.maps["diffuse", "color"]
    np.testing.assert_array_equal(item.scale[:-1] == 0, distance <= 0.2)
    assert (item.shift[:-1][distance <= 0.2] == np.float32(TARGET.value)).all()
    assert (item.shift[:-1][distance > 0.2] == 0).all()
    assert item.scale[-1] == 1


def test_distance_is_measured_on_the_object_not_on_the_screen() -> None:
    # Two sheets that overlap in the picture, and the back of the first
    near, far = plane(), plane(1.0)
    positions = np.concatenate([near, far, near])
    normals = np.concatenate([near * 0 + UP, far * 0 + UP, near * 0 - UP]).astype(np.float32)
    canvas = Canvas(positions, normals)
    canvas.show([Stroke("b", (TARGET,), (dab(0.5, 0.5),), 1.0, 0.6)])
    scale = canvas.maps["diffuse", "color"].scale[:-1].reshape(3, -1)
    assert (scale[0] < 1).any()
    assert (scale[1:] == 1).all()


def test_overlapping_dabs_do_not_add_and_pressure_weakens() -> None:
    canvas = flat(plane())
    for dabs, expected in (
        ((dab(0.5, 0.5),) * 5, 0.3),
        ((dab(0.5, 0.5, pressure=0.5),), 0.65),
        ((dab(0.5, 0.5, pressure=0.5), dab(0.5, 0.5, pressure=0.25)), 0.65),
    ):
        canvas.show([Stroke("b", (TARGET,), dabs, narrow(0.7), 0.0)])
        scale = canvas.maps["diffuse", "color"].scale
        assert scale.min() == pytest.approx(expected, abs=1e-6)


def test_two_hundred_strokes_and_undos_return_every_bit() -> None:
    canvas = flat(plane())
    strokes = random_strokes(200)
    steps = [contents(canvas)]
    for count in range(1, 201):
        canvas.show(strokes[:count])
        steps.append(contents(canvas))
    for count in range(199, -1, -1):
        canvas.show(strokes[:count])
        assert contents(canvas) == steps[count]
    assert not canvas.maps
    # All at once is the same as one by one
    fresh = flat(plane())
    fresh.show(strokes)
    assert contents(fresh) == steps[200]
    # And history holds what strokes touched, not copies of the maps
    whole = 200 * sum(item.scale.nbytes + item.shift.nbytes for item in fresh.maps.values())
    assert fresh.nbytes < whole


def test_a_stroke_drawn_bit_by_bit_is_the_stroke_drawn_at_once() -> None:
    for edit in (TARGET, HALVE, BLUR, Edit("erase")):
        rng = np.random.default_rng(2)
        before = random_strokes(3)
        dabs = tuple(dab(x, y, radius=0.1) for x, y in rng.random((30, 2)))
        grown = flat(plane())
        for count in range(1, 31):
            grown.show([*before, Stroke("b", (edit,), dabs[:count], 0.5, 0.6)])
        whole = flat(plane())
        whole.show([*before, Stroke("b", (edit,), dabs, 0.5, 0.6)])
        assert contents(grown) == contents(whole)
        grown.show(before)
        other = flat(plane())
        other.show(before)
        assert contents(grown) == contents(other)


def test_erasing_gives_back_the_materials_own_exactly() -> None:
    canvas = flat(plane())
    eraser = Stroke("eraser", (Edit("erase"),), (dab(0.5, 0.5, radius=0.3),), 1.0, 0.0)
    canvas.show([*random_strokes(20), eraser])
    inside = np.linalg.norm(plane() - (0.5, 0.5, 0.0), axis=1) <= 0.3
    for item in canvas.maps.values():
        assert (item.scale[:-1][inside] == 1).all()
        assert item.shift[:-1][inside].tobytes() == bytes(item.shift[:-1][inside].nbytes)
        assert (item.scale[:-1][~inside] != 1).any() or (item.shift[:-1][~inside] != 0).any()


def test_the_clone_stamp_copies_with_its_offset() -> None:
    positions = plane()
    canvas = flat(positions)
    colours = [Edit("set", "diffuse", "color", (x, 1 - x, 0.2)) for x in (0.1, 0.9)]
    before = [
        Stroke("b", (edit,), (dab(0.2 + x, 0.25, radius=0.08),), 1.0, 0.6)
        for edit, x in zip(colours, (0.0, 0.1), strict=True)
    ]
    canvas.show(before)
    old = canvas.maps["diffuse", "color"].shift[:-1].reshape(SIDE, SIDE, 3).copy()
    # 20 points down and 10 to the right
    way = [(0.45 + x, 0.75) for x in np.linspace(0.0, 0.2, 9)]
    dabs = tuple(Dab((x, y, 0.0), UP, 0.12, 1.0, (x - 0.25, y - 0.5, 0.0), UP) for x, y in way)
    canvas.show([*before, Stroke("clone", (Edit("clone"),), dabs, 1.0, 0.0)])
    new = canvas.maps["diffuse", "color"].shift[:-1].reshape(SIDE, SIDE, 3)
    distance = np.linalg.norm(positions[:, None, :2] - np.array(way), axis=2).min(axis=1)
    covered = (distance <= 0.12).reshape(SIDE, SIDE)
    expected = old.copy()
    shifted = np.roll(old, (20, 10), axis=(0, 1))
    expected[covered] = shifted[covered]
    np.testing.assert_array_equal(new, expected)
    assert new[25:].any()


def test_what_one_layer_loses_the_other_gains() -> None:
    canvas = flat(plane())
    move = Edit("move", "specular", "weight", (0.6, 2.5), source="diffuse")
    canvas.show([Stroke("metallic", (move,), (dab(0.5, 0.5),), 1.0, 0.6)])
    loss, gain = (
        (canvas.maps[name, "weight"].scale + canvas.maps[name, "weight"].shift[:, 0]) - 1
        for name in ("diffuse", "specular")
    )
    np.testing.assert_allclose(gain, -2.5 * loss, atol=1e-6)
    assert loss.min() == pytest.approx(-0.6, abs=0.02)


def test_strokes_survive_a_file() -> None:
    strokes = random_strokes(14)
    for stroke in strokes:
        rounded = tuple(
            Dab(*(tuple(map(narrow, f)) if isinstance(f, tuple) else f and narrow(f) for f in item))
            for item in stroke.dabs
        )
        kept = Stroke(stroke.brush, stroke.edits, rounded, stroke.strength, stroke.falloff,
                      stroke.everywhere)  # fmt: skip
        assert Stroke.from_json(json.loads(json.dumps(kept.to_json()))) == kept


@pytest.mark.parametrize(
    "change",
    [
        {"dabs": "!!"},
        {"columns": 9},
        {"edits": [{"kind": "smear"}]},
        {"strength": 2},
        {"edits": [{"kind": "set", "layer": "a", "parameter": "b", "value": [1, 2]}]},
        {"falloff": "soft"},
    ],
)
def test_a_damaged_stroke_is_refused(change: dict[str, object]) -> None:
    data = Stroke("b", (TARGET,), (dab(0.5, 0.5),)).to_json() | change
    with pytest.raises(InvalidValue):
        Stroke.from_json(data)


@pytest.mark.parametrize("name", sorted(name for name in MODELS if "measured" not in name))
def test_between_nodes_coefficients_are_interpolated_closely(name: str) -> None:
    model = MODELS[name]()
    values = {item.name: item.validate(item.default) for item in model.parameters}
    layer = Layer.starting_at("own", model, values, bins=32)
    rng = np.random.default_rng(8)
    for item in layer.parameters:
        if item.kind != "scalar":
            continue
        wanted = Travel(item).at(rng.random(5))
        index, share, nodes = interpolation(item, wanted)
        for k, value in enumerate(wanted):
            own = LayerState({**values, item.name: float(value)})
            exact = coefficients(layer, own)
            mixed = sum(
                s * coefficients(layer, replace(own, values={**values, item.name: float(nodes[i])}))
                for i, s in zip(index[k], share[k], strict=True)
            )
            # What docs/painting.md promises, of the largest coefficient
            assert np.abs(mixed - exact).max() <= 5e-4 * np.abs(exact).max()
