"""Drafts of a session: for the eye while something is dragged, never in what is kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from burnish.runtime import drafts as module
from burnish.runtime.drafts import Choice
from burnish.session import Session
from burnish.transport.basis import Basis
from tests.runtime.worlds import glossy, matte, random_world

PATH = "box.specular.exponent"


def view_session() -> Session:
    basis = Basis((glossy("box", 128), matte("floor")), (128, 1), indirect_bins=2)
    return Session({"front": random_world(basis)[0]}, name="drafted")


@pytest.fixture
def session(monkeypatch: pytest.MonkeyPatch) -> Session:
    """A session on a machine where drafts are faster."""
    measured = module.measured

    def told(*arguments: object) -> Choice:
        return replace(measured(*arguments), plain=1.0, incremental=0.1)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "measured", told)
    return view_session()


def test_a_drag_is_drafted_after_a_pause_and_ends_in_the_frame(session: Session) -> None:
    session.select("box")
    before = session.frame()
    assert session.draft().frame
    assert session.draft_choices() == ()
    session.prepare_drafts()
    (choice,) = session.draft_choices()
    assert (choice.object, choice.layer, choice.drafts) == ("box", "specular", True)
    session.set(PATH, 400.0)
    drafts = [session.draft()]
    while not drafts[-1].exact:
        drafts.append(session.draft())
    assert 2 <= len(drafts) <= 10
    assert not any(item.frame for item in drafts)
    exact = session.frame()
    np.testing.assert_allclose(drafts[-1].image, exact, rtol=2e-4, atol=1e-5 * exact.max())
    assert np.abs(drafts[0].image - before).max() > 0


def test_frames_are_those_of_a_session_that_drafts_nothing(session: Session) -> None:
    other = view_session()
    for value in (30.0, 300.0, 90.0):
        session.set(PATH, value)
        session.prepare_drafts()
        session.draft()
    other.set(PATH, 90.0)
    np.testing.assert_array_equal(session.frame(), other.frame())
    session.undo()
    other.set(PATH, 300.0)
    session.draft()
    np.testing.assert_array_equal(session.frame(), other.frame())


def test_another_selection_leaves_no_draft_behind(session: Session) -> None:
    session.set(PATH, 50.0)
    session.frame()
    session.prepare_drafts()
    session.set("floor.diffuse.color", (0.1, 0.9, 0.4))
    draft = session.draft()
    assert draft.frame
    np.testing.assert_array_equal(draft.image, session.frame())
    session.prepare_drafts()
    assert session.draft_choices() == ()
    session.set(PATH, 70.0)
    np.testing.assert_array_equal(session.draft().image, session.frame())


def test_a_machine_whose_memory_is_fast_draws_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    measured = module.measured

    def told(*arguments: object) -> Choice:
        return replace(measured(*arguments), plain=0.1, incremental=1.0)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "measured", told)
    session = view_session()
    session.set(PATH, 50.0)
    session.frame()
    session.prepare_drafts()
    assert [choice.drafts for choice in session.draft_choices()] == [False]
    session.set(PATH, 60.0)
    assert session.draft().frame
