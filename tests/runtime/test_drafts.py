"""Drafts close in on the frame, never touch it, and are chosen by what was measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from burnish.materials.curve import Curve
from burnish.runtime import drafts as module
from burnish.runtime.drafts import Choice, Drafts
from burnish.runtime.freeze import freeze
from burnish.runtime.renderer import Renderer
from burnish.transport.basis import Basis, State, initial_state
from burnish.transport.pack import TiledBlocks
from tests.runtime.worlds import edited, glossy, matte, random_world


def view(bins: int = 96, series: tuple[int, ...] = (6, 1)) -> tuple[Basis, TiledBlocks]:
    basis = Basis((glossy("box", bins), matte("floor")), series, indirect_bins=2)
    return basis, random_world(basis)[0]


def bumped(state: State, centre: float) -> State:
    t = np.linspace(0.0, 1.0, 24)
    gain = 1 + 2 * np.exp(-(((t - centre) / 0.1) ** 2))
    curve = Curve(tuple(t.tolist()), tuple((g, 1.0, 2 - g / 2) for g in gain.tolist()))
    box = state["box"]
    layers = {**box.layers, "specular": replace(box.layers["specular"], curve=curve)}
    return {**state, "box": replace(box, layers=layers)}


def test_drafts_come_closer_and_are_the_frame_at_last() -> None:
    basis, source = view()
    start = initial_state(basis.objects)
    renderer = Renderer(freeze(source, (0,), start))
    exact = Renderer(freeze(source, (0,), start)).image(bumped(start, 0.4))
    source.stacks()[0].kept.clear()
    drafts = Drafts(renderer)
    drafts.prepare(start, force=True)
    assert drafts.useful
    (choice,) = drafts.choices.values()
    assert choice.budget == int(np.ceil(choice.terms * 30 / 256))
    for stack in source.stacks():
        stack.kept.clear()
    errors, reached = [], False
    while not reached:
        picture, reached = drafts.image(bumped(start, 0.4))
        errors.append(float(np.linalg.norm(picture - exact) / np.linalg.norm(exact)))
    # Ten frames of a tenth of the terms and more
    assert len(errors) <= 10
    assert errors[-1] < errors[0]
    np.testing.assert_allclose(picture, exact, rtol=2e-5)


def test_the_frame_itself_is_the_same_whatever_was_drafted() -> None:
    basis, source = view()
    start = initial_state(basis.objects)
    renderer = Renderer(freeze(source, (0,), start))
    drafts = Drafts(renderer)
    drafts.prepare(start, force=True)
    for centre in (0.1, 0.5, 0.7):
        drafts.image(bumped(start, centre))
    found = renderer.image(bumped(start, 0.7))
    other = view()[1]
    np.testing.assert_array_equal(
        found, Renderer(freeze(other, (0,), start)).image(bumped(start, 0.7))
    )


def test_a_colour_that_is_dragged_is_exact_at_once() -> None:
    basis, source = view()
    start = initial_state(basis.objects)
    renderer = Renderer(freeze(source, (0,), start))
    drafts = Drafts(renderer)
    drafts.prepare(start, force=True)
    dyed = edited(start, "box", color=(0.9, 0.1, 0.4))
    picture, exact = drafts.image(dyed)
    assert exact
    np.testing.assert_array_equal(picture, renderer.image(dyed))


def test_few_bins_are_left_to_the_plain_product() -> None:
    basis, source = view(bins=16)
    start = initial_state(basis.objects)
    renderer = Renderer(freeze(source, (0,), start))
    drafts = Drafts(renderer)
    drafts.prepare(start)
    assert not drafts.choices
    picture, exact = drafts.image(bumped(start, 0.3))
    assert exact
    np.testing.assert_array_equal(picture, renderer.image(bumped(start, 0.3)))


def test_terms_need_room_beside_those_of_other_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    basis = Basis((glossy("box", 96), glossy("globe", 96)), (6, 1), indirect_bins=2)
    source = random_world(basis)[0]
    start = initial_state(basis.objects)
    drafts = Drafts(Renderer(freeze(source, (0, 1), start)))
    drafts.prepare(start, force=True)
    sizes = [ready.product.T.nbytes for ready in drafts._ready.values()]
    assert len(sizes) == 2
    assert all(choice.fits for choice in drafts.choices.values())
    # Room for each of them, not for both
    monkeypatch.setattr(module, "machine_memory", lambda: 8 * (max(sizes) + min(sizes) // 2))
    drafts = Drafts(Renderer(freeze(source, (0, 1), start)))
    drafts.prepare(start, force=True)
    assert sorted(choice.fits for choice in drafts.choices.values()) == [False, True]


@pytest.mark.parametrize(("plain", "drafted"), [(1.0, True), (0.1, False)])
def test_the_measured_choice_decides(
    plain: float, drafted: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    measured = module.measured

    def told(*arguments: object) -> Choice:
        found = measured(*arguments)  # type: ignore[arg-type]
        assert found.plain > 0
        assert found.incremental > 0
        assert (found.object, found.layer, found.columns, found.terms) == (
            "box",
            "specular",
            96,
            96,
        )
        return replace(found, plain=plain, incremental=0.5)

    monkeypatch.setattr(module, "measured", told)
    basis, source = view()
    start = initial_state(basis.objects)
    drafts = Drafts(Renderer(freeze(source, (0,), start)))
    drafts.prepare(start)
    assert drafts.useful == drafted
    (choice,) = drafts.choices.values()
    assert choice.drafts == drafted
    assert not replace(choice, fits=False).drafts
