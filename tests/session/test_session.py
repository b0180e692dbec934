"""Sessions: edits and pictures belong together, and every step can be taken back."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from burnish.core.errors import (
    CannotWrite,
    InvalidValue,
    MissingFile,
    MissingRayTracer,
    TooLarge,
    UnknownName,
)
from burnish.core.types import Float32, Progress
from burnish.materials.curve import Curve
from burnish.runtime.freeze import BakedTransport
from burnish.session import ObjectInfo, Session
from burnish.transport.basis import State, initial_state
from burnish.transport.frozen import Frozen
from tests.runtime.worlds import basis_of, plain_image, random_world

BASIS = basis_of((6, 1, 1))
SOURCE, TILES = random_world(BASIS)
ROUND = Curve(points=(0.0, 0.5, 1.0), values=((2.0, 1.0, 1.0), (1.0, 1.0, 1.0), (0.0, 0.0, 0.5)))


@dataclass
class CountingTransport(BakedTransport):
    """Counts how often it was frozen; its revision can be moved on."""

    frozen: int = 0
    passes: int = 0

    @property
    def revision(self) -> int:
        return self.passes

    def freeze(self, targets: tuple[int, ...], state: State, fine: tuple[int, ...] = ()) -> Frozen:
        self.frozen += 1
        return replace(super().freeze(targets, state, fine), revision=self.passes)


def session_of(**options: object) -> Session:
    return Session({"front": SOURCE}, name="test", **options)  # type: ignore[arg-type]


def assert_shows_its_state(session: Session) -> None:
    expected = plain_image(BASIS, TILES, session.state, SOURCE.width, SOURCE.height)
    np.testing.assert_allclose(session.frame(), expected, rtol=2e-5)


def test_every_edit_of_every_object_shows() -> None:
    session = session_of()
    assert_shows_its_state(session)
    session.set("box.specular.exponent", 100.0)
    assert session.selected == ("box",)
    assert_shows_its_state(session)
    session.set("floor.diffuse.color", "#ff0000")
    assert session.selected == ("floor",)
    assert session.get("floor.diffuse.color") == (1.0, 0.0, 0.0)
    assert_shows_its_state(session)
    session.set_curve("lid.specular", ROUND)
    assert_shows_its_state(session)
    session.set_enabled("box.diffuse", False)
    session.set_weight("lid.diffuse", 0.25)
    session.set_conserve("lid", True)
    assert_shows_its_state(session)
    session.select("box", "lid")
    session.set("lid.diffuse.color", 0.3)
    assert session.selected == ("box", "lid")
    assert_shows_its_state(session)
    session.reset("lid.diffuse.color")
    session.reset("lid.specular")
    session.reset("box")
    assert_shows_its_state(session)
    session.reset()
    assert session.state == initial_state(BASIS.objects)
    assert_shows_its_state(session)
    labels, position = session.history
    assert position == len(labels) == 11
    assert labels[0] == "Set box.specular.exponent to 100"
    while session.undo():
        assert_shows_its_state(session)
    while session.redo():
        pass
    assert_shows_its_state(session)


def test_only_what_must_be_is_frozen_again() -> None:
    transport = CountingTransport(SOURCE)
    session = Session({"front": transport})
    session.select("box")
    session.frame()
    for exponent in (10.0, 20.0, 30.0):
        session.set("box.specular.exponent", exponent)
        session.frame()
    assert transport.frozen == 1
    session.set("floor.diffuse.color", 0.9)
    session.frame()
    assert transport.frozen == 2
    session.undo()
    session.frame()
    assert transport.frozen == 2
    transport.passes += 1
    session.frame()
    session.frame()
    assert transport.frozen == 3


def test_a_gesture_is_one_step() -> None:
    session = session_of()
    with session.gesture():
        for exponent in (2.0, 3.0, 4.0):
            session.set("box.specular.exponent", exponent)
        with session.gesture():
            session.set("box.specular.color", 0.1)
    assert len(session.history[0]) == 1
    session.undo()
    assert session.state == initial_state(BASIS.objects)
    assert not session.undo()
    with session.gesture():
        session.set("box.specular.exponent", 2.0)
        session.set("box.specular.exponent", 20.0)
    assert session.history == ([], 0)
    with session.gesture():
        session.set("box.specular.exponent", 2.0)
        session.undo()
        session.set("box.specular.exponent", 3.0)
    assert session.history == (["Set box.specular.exponent to 3"], 1)


def test_setting_the_same_value_is_no_step() -> None:
    session = session_of()
    revision = session.revision
    session.set("box.specular.exponent", 20)
    assert session.history == ([], 0)
    assert session.revision == revision


def test_undo_selects_what_it_changed() -> None:
    session = session_of()
    session.set("box.specular.exponent", 5.0)
    session.set("floor.diffuse.color", 0.1)
    session.undo()
    assert session.selected == ("floor",)
    session.undo()
    assert session.selected == ("box",)


ACTIONS = st.one_of(
    st.tuples(st.just("set"), st.sampled_from(["box", "lid"]), st.floats(1.0, 5000.0)),
    st.tuples(st.just("weight"), st.sampled_from(["box", "floor"]), st.floats(0.0, 2.0)),
    st.tuples(st.just("enabled"), st.sampled_from(["box", "lid"]), st.booleans()),
    st.tuples(st.just("reset"), st.sampled_from(["box", "floor", "lid"]), st.none()),
    st.tuples(st.sampled_from(["undo", "redo"]), st.just(""), st.none()),
)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.lists(ACTIONS, max_size=20))
def test_undo_and_redo_walk_the_same_path(actions: list[tuple[str, str, object]]) -> None:
    session = session_of()
    path = [dict(session.state)]
    for kind, name, value in actions:
        before = session.history[1]
        if kind == "set":
            session.set(f"{name}.specular.exponent", value)
        elif kind == "weight":
            session.set_weight(f"{name}.diffuse", value)  # type: ignore[arg-type]
        elif kind == "enabled":
            session.set_enabled(f"{name}.specular", bool(value))
        elif kind == "reset":
            session.reset(name)
        elif kind == "undo":
            assert session.undo() == (before > 0)
        else:
            assert session.redo() == (before < len(session.history[0]))
        now = session.history[1]
        if kind not in ("undo", "redo") and now > before:
            path[now:] = [dict(session.state)]
        assert dict(session.state) == path[now]
        assert len(path) == len(session.history[0]) + 1
    while session.undo():
        pass
    assert dict(session.state) == path[0]
    while session.redo():
        pass
    assert dict(session.state) == path[-1]


def test_edits_are_saved_small_and_read_back(tmp_path: Path) -> None:
    session = session_of()
    session.set("box.specular.exponent", 0.1 + 0.2 + 77.0)
    session.set_curve("box.specular", ROUND)
    session.set_enabled("lid.diffuse", False)
    session.set_weight("lid.specular", 0.5)
    session.set_conserve("floor", True)
    session.save(tmp_path / "look.json")
    data = json.loads((tmp_path / "look.json").read_text())
    assert set(data["objects"]) == {"box", "lid", "floor"}
    assert data["objects"]["lid"] == {"diffuse": {"enabled": False}, "specular": {"weight": 0.5}}
    other = session_of()
    other.set("floor.diffuse.color", 0.0)
    other.load(tmp_path / "look.json")
    assert other.state == session.state
    assert other.edits_text() == session.edits_text()
    assert other.history[0][-1] == "Loaded look.json"
    other.undo()
    assert other.get("floor.diffuse.color") == (0.0, 0.0, 0.0)
    session.reset()
    session.save(tmp_path / "none.json")
    assert json.loads((tmp_path / "none.json").read_text())["objects"] == {}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["look.json", "none.json"]


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("{", InvalidValue, "not JSON"),
        ("[]", InvalidValue, "not a burnish edits file"),
        ('{"format": "burnish-edits", "version": 9}', InvalidValue, "newer burnish"),
        ('{"bax": {}}', UnknownName, "nearest: 'box'"),
        ('{"box": 3}', InvalidValue, "must be an object in braces"),
        ('{"box": {"specula": {}}}', UnknownName, "nearest: 'look.json: box.specular'"),
        ('{"box": {"specular": {"shape": 1}}}', UnknownName, "entry"),
        ('{"box": {"specular": {"parameters": {"exponnt": 1}}}}', UnknownName, "exponent"),
        (
            '{"box": {"specular": {"parameters": {"exponent": -1}}}}',
            InvalidValue,
            r"box.specular.exponent must lie in \[1, 5000\]; got -1",
        ),
        ('{"box": {"specular": {"weight": -1}}}', InvalidValue, r"weight must lie in \[0, 100\]"),
        ('{"box": {"specular": {"enabled": 1}}}', InvalidValue, "true or false"),
        ('{"box": {"specular": {"curve": {}}}}', InvalidValue, "curve"),
        ('{"box": {"conserve": "yes"}}', InvalidValue, "true or false"),
    ],
)
def test_bad_edits_change_nothing(
    tmp_path: Path, text: str, error: type[Exception], message: str
) -> None:
    if not text.startswith(('{"format', "[", "{\n")) and text != "{":
        text = '{"format": "burnish-edits", "version": 1, "objects": ' + text + "}"
    path = tmp_path / "look.json"
    path.write_text(text)
    session = session_of()
    session.set("lid.specular.exponent", 3.0)
    before = session.state
    with pytest.raises(error, match=message):
        session.load(path)
    assert session.state == before


def test_missing_and_unreadable_files(tmp_path: Path) -> None:
    session = session_of()
    with pytest.raises(MissingFile, match="cannot be read"):
        session.load(tmp_path / "none.json")
    (tmp_path / "picture.json").write_bytes(b"\xff\xfe\xff")
    with pytest.raises(InvalidValue, match="UTF-8"):
        session.load(tmp_path / "picture.json")
    with pytest.raises(MissingFile, match="create it first"):
        session.save(tmp_path / "no" / "look.json")
    (tmp_path / "folder").mkdir()
    with pytest.raises(CannotWrite, match="cannot be written"):
        session.save(tmp_path / "folder")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["folder", "picture.json"]


def test_unknown_names_come_with_the_nearest() -> None:
    session = session_of(
        objects=[ObjectInfo("box"), ObjectInfo("lens", False, "glass is not editable")]
    )
    with pytest.raises(UnknownName, match=r"nearest: 'box\.specular\.exponent'"):
        session.set("box.specular.exponant", 3)
    with pytest.raises(UnknownName, match=r"'box\.specular'"):
        session.set_enabled("box.speclar", False)
    with pytest.raises(UnknownName, match="layer"):
        session.set_curve("box.specular.exponent", None)
    with pytest.raises(UnknownName, match="'box'"):
        session.select("bocks")
    with pytest.raises(InvalidValue, match="glass is not editable"):
        session.select("lens")
    with pytest.raises(UnknownName, match="front"):
        session.frame("back")
    with pytest.raises(InvalidValue, match=r"\[1, 5000\]"):
        session.set("box.specular.exponent", 0.5)
    with pytest.raises(InvalidValue, match="#rrggbb"):
        session.set("floor.diffuse.color", "#12")
    with pytest.raises(InvalidValue, match=r"box\.specular\.weight must lie in \[0, 100\]"):
        session.set_weight("box.specular", float("nan"))
    assert session.history == ([], 0)


def test_openpbr_names_are_paths_too() -> None:
    session = session_of()
    session.set("floor.base_color", 0.25)
    assert session.get("floor.diffuse.color") == (0.25, 0.25, 0.25)
    session.set("box.specular.weight", 0.5)
    assert session.state["box"].layers["specular"].weight == 0.5
    session.reset("floor.base_color")
    session.reset("box.specular.weight")
    assert session.state == initial_state(BASIS.objects)


def test_ids_may_hold_dots() -> None:
    from burnish.transport.basis import Basis

    basis = Basis(
        (
            replace(BASIS.objects[0], id="a"),
            replace(BASIS.objects[1], id="a.diffuse"),
        ),
        (6, 1),
    )
    source, _ = random_world(basis)
    session = Session({"front": source})
    session.set("a.diffuse.diffuse.color", 0.1)
    session.set("a.specular.exponent", 7.0)
    assert session.get("a.diffuse.diffuse.color") == (0.1, 0.1, 0.1)
    assert session.selected == ("a",)


def test_pick_finds_the_object_of_most_weight() -> None:
    session = session_of()
    rows = SOURCE.rows
    for y in range(SOURCE.height):
        for x in range(SOURCE.width):
            here = np.flatnonzero((rows.pixel == y * SOURCE.width + x) & ~rows.indirect)
            best = here[np.argmax(rows.weight[here])] if len(here) else None
            expected = None if best is None else BASIS.objects[rows.object[best]].id
            assert session.pick(x, y) == expected
    with pytest.raises(InvalidValue, match="pixel must lie"):
        session.pick(SOURCE.width, 0)


def test_too_many_selected_keeps_the_selection() -> None:
    session = Session({"front": BakedTransport(SOURCE, memory=25_000)})
    session.select("box")
    session.frame()
    with pytest.raises(TooLarge, match="select fewer"):
        session.select("box", "floor")
    assert session.selected == ("box",)
    session.frame()


def test_warnings_name_objects_that_make_light() -> None:
    session = session_of()
    assert session.warnings() == []
    session.set("floor.diffuse.color", 1.0)
    assert session.warnings() == []
    session.set_weight("floor.diffuse", 1.5)
    (warning,) = session.warnings()
    assert warning.startswith("floor reflects more light than it receives (albedo 1.50 in red)")
    session.set_conserve("floor", True)
    assert session.warnings() == []


def test_listeners_hear_of_every_change() -> None:
    session = session_of()
    heard: list[int] = []
    end = session.on_change(lambda: heard.append(session.revision))
    session.set("box.specular.exponent", 3.0)
    session.set("box.specular.exponent", 3.0)
    session.undo()
    session.restore(session.state)
    end()
    session.redo()
    assert heard == [1, 2]


def test_path_tracing_goes_to_the_truth() -> None:
    class Grey:
        def render(
            self,
            state: State,
            view: str,
            spp: int,
            seed: int = 0,
            progress: Progress | None = None,
        ) -> Float32:
            assert (view, spp, seed) == ("front", 4, 1)
            return np.full((12, 20, 3), state["box"].layers["specular"].weight, np.float32)

    session = session_of(truth=Grey())
    session.set_weight("box.specular", 0.5)
    assert (session.path_trace(spp=4, seed=1) == 0.5).all()
    with pytest.raises(MissingRayTracer, match="pip install mitsuba"):
        session_of().path_trace()


def test_a_session_needs_a_view() -> None:
    with pytest.raises(InvalidValue, match="at least one view"):
        Session({})


@dataclass
class RemodellingTransport(CountingTransport):
    """Takes other models, as a live view does; its pictures are those of the scene's own."""

    remodels: bool = True

    def freeze(self, targets: tuple[int, ...], state: State, fine: tuple[int, ...] = ()) -> Frozen:
        self.frozen += 1
        return super().freeze(targets, initial_state(BASIS.objects))


def test_another_model_is_an_edit_like_any_other() -> None:
    transport = RemodellingTransport(SOURCE)
    session = Session({"front": transport}, name="test")
    assert session.models_fixed == ""
    session.set("box.specular.exponent", 80.0)
    session.renderer()
    frozen = transport.frozen
    session.set_model("box.specular", "cook-torrance")
    assert session.history[0][-1] == "Made box.specular cook-torrance"
    material = session.material("box")
    assert material is not None
    assert material.layer("specular").model.name == "cook-torrance"
    session.renderer()
    assert transport.frozen > frozen
    session.set("box.specular.roughness", 0.3)
    session.set_outgoing_curve("box.specular", ROUND)
    with pytest.raises(UnknownName):
        session.set("box.specular.exponent", 3.0)

    # Saved and loaded, reset, undone
    there, text = session.state, session.edits_text()
    entry = json.loads(text)["objects"]["box"]["specular"]
    assert entry["model"]["model"]["name"] == "cook-torrance"
    assert entry["parameters"] == {"roughness": 0.3}
    session.reset("box.specular.roughness")
    assert session.get("box.specular.roughness") == pytest.approx(math.sqrt(2 / 82))
    session.reset()
    session.load_text(text)
    assert session.state == there
    session.reset("box.specular")
    assert session.state == initial_state(BASIS.objects)
    session.undo()
    assert session.state == there
    while session.undo():
        pass
    assert session.state == initial_state(BASIS.objects)


def test_a_bake_keeps_its_models() -> None:
    text = '{"format": "burnish-edits", "version": 1, "scene": "", "objects": {"box": '
    live = Session({"front": RemodellingTransport(SOURCE)})
    live.set_model("box.specular", "phong")
    session = session_of()
    assert "bake" in session.models_fixed
    for attempt in (
        lambda: session.set_model("box.specular", "phong"),
        lambda: session.restore(live.state),
        lambda: session.load_text(live.edits_text()),
    ):
        with pytest.raises(InvalidValue, match="open the scene itself"):
            attempt()
    assert session.history == ([], 0)
    broken = '{"specular": {"model": {"model": {"name": "phong"}}}}}}'
    with pytest.raises(InvalidValue):
        live.load_text(text + broken)
