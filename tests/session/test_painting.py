"""Painting in a session: strokes from the picture, brushes by model, undo, files."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from burnish.core.errors import InvalidValue, UnknownName
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.models.lambert import Lambert
from burnish.materials.painting.stroke import WEIGHT
from burnish.materials.registry import MODELS
from burnish.session import Session
from burnish.session.brushes import NAMES, Wish, brushes, edits
from burnish.transport.pack import TiledBlocks
from tests.runtime.worlds import basis_of, random_world

WIDTH, HEIGHT = 24, 16
BASIS = basis_of((6, 1, 1))


def flat_world(depth_edge: bool = False) -> TiledBlocks:
    """Random light on objects that lie in the plane of the picture, a pixel a unit.

    depth_edge: the right half lies 50 units behind.
    """
    source, _ = random_world(BASIS, WIDTH, HEIGHT)
    rows = source.rows
    y, x = np.divmod(rows.pixel, WIDTH)
    depth = np.where(depth_edge & (x >= WIDTH // 2), -50.0, 0.0)
    rows.position[:] = np.stack([x + 0.5, y + 0.5, depth], axis=1)
    rows.normal[:] = (0, 0, 1)
    rows.cos_theta_o[:] = np.maximum(rows.cos_theta_o, 0.1)
    return source


def session_of(**options: bool) -> Session:
    return Session({"front": flat_world(**options)}, name="flat")


def rows_of(session: Session, object_id: str) -> np.ndarray:
    """(x, y) of an object's rows."""
    y, x = np.divmod(session.surface(object_id).pixel, WIDTH)
    return np.stack([x + 0.5, y + 0.5], axis=1)


def middle(session: Session, object_id: str) -> tuple[float, float]:
    """A pixel where an object is what one sees, near the middle."""
    index = [item.id for item in BASIS.objects].index(object_id)
    y, x = np.nonzero(session.object_map() == index)
    nearest = np.hypot(x - WIDTH / 2, y - HEIGHT / 2).argmin()
    return float(x[nearest]) + 0.5, float(y[nearest]) + 0.5


def test_a_stroke_changes_the_rows_within_its_radius_on_its_object_alone() -> None:
    session = session_of()
    x, y = middle(session, "box")
    session.select("box")
    before = session.frame()
    assert session.paint("diffuse-color", [(x, y)], color=(1, 0, 0), size=5, falloff=0) == ("box",)
    canvas = session.surface("box").canvas
    session.frame()
    covered = canvas.maps["diffuse", "color"].scale[:-1] == 0
    distance = np.linalg.norm(rows_of(session, "box") - (x, y), axis=1)
    # The size of a pixel is measured from the rows' noisy positions; here they are exact
    np.testing.assert_array_equal(covered, distance <= 5)
    assert not session.surface("lid").canvas.maps
    assert session.undo()
    assert session.frame().tobytes() == before.tobytes()


def test_a_stroke_stays_on_its_side_of_a_depth_edge() -> None:
    session = session_of(depth_edge=True)
    index = [item.id for item in BASIS.objects].index("box")
    y, x = np.nonzero(session.object_map() == index)
    left = np.flatnonzero(x < WIDTH // 2)
    start = left[np.argmax(x[left])]
    point = (x[start] + 0.5, y[start] + 0.5)
    session.paint("blur", [point], size=6)
    session.frame()
    changed = session.surface("box").canvas.maps["specular", "exponent"].shift[:-1, 0] != 0
    assert changed.any()
    assert (rows_of(session, "box")[changed, 0] < WIDTH // 2).all()


def test_objects_named_or_all_ignore_borders() -> None:
    session = session_of()
    way = [(1, HEIGHT / 2), (WIDTH - 1, HEIGHT / 2)]
    assert len(session.paint("diffuse-color", way, color="#ff0000", size=3)) == 1
    found = session.paint("diffuse-color", way, color="#ff0000", size=3, objects="all")
    assert set(found) == {"box", "floor", "lid"}
    assert session.paint("blur", way, size=3, objects=["lid"]) == ("lid",)
    assert session.selected == ()
    assert session.frame().shape == (HEIGHT, WIDTH, 3)


def test_a_full_stroke_over_an_object_is_the_global_edit() -> None:
    for brush, options, path, value in (
        ("diffuse-color", {"color": (0.9, 0.2, 0.1)}, "lid.diffuse.color", (0.9, 0.2, 0.1)),
        ("specular-color", {"color": (0.1, 0.6, 0.1)}, "lid.specular.color", (0.1, 0.6, 0.1)),
        ("specular-intensity", {"amount": 0.25}, "lid.specular.weight", 0.25),
        ("sharpen", {"amount": 0.3}, "lid.specular.exponent", 20.0 * 5000**0.3),
        ("blur", {"amount": 0.2}, "lid.specular.exponent", 20.0 * 5000**-0.2),
    ):
        session = session_of()
        session.select("lid")
        before = session.frame()
        session.set(path, value)
        expected = session.frame()
        assert np.abs(expected - before).max() > 1e-3
        session.undo()
        session.paint_whole(brush, **options)
        np.testing.assert_allclose(session.frame(), expected, rtol=2e-6)
        session.undo()
        # The same by a brush that is larger than the picture
        session.paint(brush, [middle(session, "lid")], size=100, falloff=0, **options)
        tolerance = 5e-4 if brush in ("sharpen", "blur") else 2e-6
        np.testing.assert_allclose(session.frame(), expected, rtol=tolerance)


def test_two_hundred_strokes_and_undos_return_the_original() -> None:
    session = session_of()
    session.select("box", "floor", "lid")
    rng = np.random.default_rng(5)
    first, states = session.frame(), [session.state]
    for number in range(200):
        brush = ("diffuse-color", "blur", "sharpen", "specular-intensity", "metallic",
                 "specular-color", "eraser", "clone")[number % 8]  # fmt: skip
        points = rng.random((3, 3)) * (WIDTH, HEIGHT, 1)
        options = {"color": tuple(rng.random(3))} if brush.endswith("color") else {}
        if brush == "clone":
            options = {"source": tuple(rng.random(2) * (WIDTH, HEIGHT))}
        target = ["box" if number % 3 else "lid"]
        session.paint(brush, points, objects=target, size=1 + 8 * rng.random(),
                      strength=rng.random(), **options)  # fmt: skip
        states.append(session.state)
    drawn = len(session.history[0])
    assert drawn > 150  # the others met no object, or found nothing to erase or to copy
    last = session.frame()
    while session.undo():
        session.surface("box").canvas.show(session.state["box"].strokes)
    assert session.frame().tobytes() == first.tobytes()
    while session.redo():
        pass
    assert session.history[1] == drawn
    assert session.frame().tobytes() == last.tobytes()


def test_a_stroke_drawn_bit_by_bit_is_one_step_and_shows_on_the_way() -> None:
    session = session_of()
    way = [(3.5, 8.5), (9.0, 8.0), (15.5, 6.5, 0.5)]
    pictures = []
    with session.stroke("diffuse-color", color="#20c040", size=3, objects=["lid"]) as drawn:
        for point in way:
            drawn.extend([point])
            pictures.append(session.frame())
    assert (pictures[0] != pictures[1]).any()
    assert session.history[1] == 1
    whole = session_of()
    whole.paint("diffuse-color", way, color="#20c040", size=3, objects=["lid"])
    assert whole.state == session.state
    assert whole.frame().tobytes() == pictures[2].tobytes()


def test_straight_lines_run_from_the_first_point_to_the_last() -> None:
    options = {"color": (0.9, 0.1, 0.1), "size": 2.0, "objects": ["lid"]}
    bent, straight, line = session_of(), session_of(), session_of()
    way = [(2.5, 2.5), (12.5, 14.5), (22.5, 2.5)]
    bent.paint("diffuse-color", way, **options)
    straight.paint("diffuse-color", way, straight=True, **options)
    line.paint("diffuse-color", [way[0], way[2]], **options)
    assert straight.state == line.state
    assert straight.state != bent.state


def test_the_eraser_gives_back_the_material() -> None:
    session = session_of()
    session.select("box")
    before = session.frame()
    x, y = middle(session, "box")
    session.paint("blur", [(x, y)], size=4)
    session.paint("diffuse-color", [(x, y)], size=3, color="#123456")
    assert session.frame().tobytes() != before.tobytes()
    session.paint("eraser", [(x, y)], size=30, falloff=0)
    assert session.state["box"].strokes
    np.testing.assert_allclose(session.frame(), before, rtol=1e-6)
    session.paint_whole("eraser")
    assert not session.state["box"].strokes
    assert session.frame().tobytes() == before.tobytes()
    # Nothing there to erase is no step
    steps = len(session.history[0])
    session.paint("eraser", [(x, y)], size=3)
    assert len(session.history[0]) == steps


def test_paint_survives_a_file_and_a_smaller_bake(tmp_path: Path) -> None:
    session = session_of()
    session.set("box.specular.exponent", 300.0)
    session.paint("diffuse-color", [(5, 5), (15, 9)], color="#ff8000", size=4, objects="all")
    session.paint("sharpen", [(15, 9), (5, 5)], size=3, strength=0.5)
    session.save(tmp_path / "painted.json")
    assert json.loads(session.edits_text())["version"] == 2
    other = session_of()
    other.load(tmp_path / "painted.json")
    assert dict(other.state) == dict(session.state)
    other.select(*session.selected)
    assert other.frame().tobytes() == session.frame().tobytes()
    # The same strokes on other rows: nothing in them belongs to one picture
    coarse, _ = random_world(BASIS, 12, 8, seed=9)
    y, x = np.divmod(coarse.rows.pixel, 12)
    coarse.rows.position[:] = np.stack([2 * x + 1, 2 * y + 1, 0 * x], axis=1)
    coarse.rows.normal[:] = (0, 0, 1)
    small = Session({"front": coarse}, name="flat")
    small.load_text(session.edits_text())
    small.frame()
    for name in ("box", "lid"):
        fine, rough = (s.surface(name) for s in (session, small))
        for place, item in rough.canvas.maps.items():
            same = (fine.position[:, None] == rough.position[None]).all(axis=2)
            assert not same.any()  # their rows lie elsewhere
            near = np.linalg.norm(fine.position[:, None] - rough.position[None], axis=2)
            value = fine.canvas.maps[place].scale[near.argmin(axis=0)]
            assert np.abs(value - item.scale[:-1]).mean() < 0.15
    # A file without paint stays readable to older versions
    session.reset()
    assert json.loads(session.edits_text())["version"] == 1


def test_wrong_paint_says_what_is_wrong() -> None:
    session = session_of()
    where = [middle(session, "lid")]
    for brush, options, words in (
        ("smudge", {}, "brush"),
        ("diffuse-color", {}, "needs a color"),
        ("diffuse-color", {"color": (2, 0, 0)}, "color must lie in [0, 1]"),
        ("stretch", {}, "no anisotropy"),
        ("blur", {"amount": 3.0}, "amount of the blur brush"),
        ("blur", {"size": 0}, "size must lie above 0"),
        ("blur", {"strength": 1.5}, "strength must lie in [0, 1]"),
        ("blur", {"layer": "coat"}, "layer for the blur brush"),
        ("clone", {}, "needs a source"),
    ):
        with pytest.raises((InvalidValue, UnknownName)) as caught:
            session.paint(brush, where, **options)
        assert words in str(caught.value)
    with pytest.raises(InvalidValue, match="pressure"):
        session.paint("blur", [(3, 3, 2)])
    with pytest.raises(InvalidValue, match="a point must be"):
        session.paint("blur", [(3,)])
    with pytest.raises(InvalidValue, match="no specular layer"):
        session.paint_whole("blur", ["floor"])
    session.paint("blur", where)
    with pytest.raises(InvalidValue, match="painted"):
        session.gradient(lambda image: (0.0, image), ["lid"])
    assert len(session.history[0]) == 1
    assert session.paint("blur", [(-5, -5), (999, 3)]) == ()


@pytest.mark.parametrize("name", sorted(MODELS))
def test_brushes_follow_from_the_models_parameters(name: str) -> None:
    model = MODELS[name]()
    values = {item.name: item.validate(item.default) for item in model.parameters}
    layer = Layer.starting_at("own", model, values, bins=16)
    under = Layer("diffuse", Lambert(), bins=1)
    state = MaterialState({"own": LayerState(values), "diffuse": LayerState({"color": (0.2,) * 3})})
    material = Material((layer, under), state)
    found = brushes(material, state)
    assert tuple(found) == NAMES
    for item in found.values():
        assert item.available == (not item.reason) == bool(item.layers)
    widths = {"roughness", "exponent", "sigma", "clearcoat_gloss", "ratio"}
    has_width = (
        model.lobe == "half"
        and model.coordinate_name != "none"
        and any(
            item.name in widths - ({"ratio"} if model.anisotropic else set())
            for item in model.parameters
        )
    )
    assert ("own" in found["blur"].layers) == has_width
    assert ("own" in found["stretch"].layers) == (
        model.anisotropic and "ratio" in {item.name for item in model.parameters}
    )
    if has_width:
        (blur,) = edits(found["blur"], material, state, Wish(layer="own"))
        (sharpen,) = edits(found["sharpen"], material, state, Wish(layer="own"))
        assert blur.parameter == sharpen.parameter
        assert blur.value == tuple(-x for x in sharpen.value)
        sharper = {"exponent", "clearcoat_gloss"}
        assert (blur.value[0] < 0) == (blur.parameter in sharper)


def test_metallic_moves_energy_and_keeps_it() -> None:
    session = session_of()
    session.paint_whole("metallic", ["lid"], amount=0.4)
    (edit,) = session.state["lid"].strokes[0].edits
    assert (edit.source, edit.layer, edit.parameter) == ("diffuse", "specular", WEIGHT)
    plain = session.views["front"].basis.albedos(
        {**session.state, "lid": replace(session.state["lid"], strokes=())}
    )
    session.frame()
    picture = session._pictures["front"]
    mean = picture._varied[2].at(session.state["lid"]).mean.albedos
    np.testing.assert_allclose(mean.mean(), plain[-1].mean(), rtol=1e-6)
    back = edits(session.brushes("lid")["metallic"], session.material("lid"),  # type: ignore[arg-type]
                 session.state["lid"], Wish(amount=-0.4))  # fmt: skip
    assert (back[0].source, back[0].layer) == ("specular", "diffuse")
