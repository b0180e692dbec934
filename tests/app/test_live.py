"""Live sessions, through the real worker process."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import cast

import numpy as np
import pytest

import burnish
from burnish.app.live import LiveStudio, LiveView
from burnish.core.errors import BurnishError, SceneError
from burnish.materials.layer import MaterialState
from burnish.session import Session

WAIT_SECONDS = 120.0


def until(condition: Callable[[], bool]) -> None:
    """Wait for something that the worker does in its own time."""
    end = time.monotonic() + WAIT_SECONDS
    while not condition():
        assert time.monotonic() < end, "the worker did not get there"
        time.sleep(0.02)


def studio_of(session: Session) -> LiveStudio:
    assert isinstance(session.truth, LiveStudio)
    return session.truth


def view_of(session: Session) -> LiveView:
    view = next(iter(session.views.values()))
    assert isinstance(view, LiveView)
    return view


@pytest.fixture(scope="module")
def live() -> Iterator[Session]:
    with burnish.edit("cornell-box", resolution=(48, 48)) as session:
        yield session


def test_an_edit_keeps_every_sample(live: Session) -> None:
    live.select("back")
    live.frame()
    until(lambda: view_of(live).samples >= 13)
    before = view_of(live).samples
    live.set("back.diffuse.color", (0.1, 0.1, 0.1))
    dark = live.frame().mean()
    live.set("back.diffuse.color", (0.9, 0.9, 0.9))
    assert live.frame().mean() > 1.05 * dark
    assert view_of(live).samples >= before
    live.undo()
    live.undo()


def test_converges_to_the_path_tracer(live: Session) -> None:
    live.set("floor.diffuse.color", (0.7, 0.3, 0.1))
    live.set("back.specular.weight", 1.0)
    live.set("back.specular.exponent", 30.0)
    live.select("back")
    live.frame()
    until(lambda: view_of(live).samples >= 600)
    emission = view_of(live).emission.max(axis=2) > 0
    image = live.frame()
    halves = [live.path_trace(spp=512, seed=seed) for seed in (1, 2)]
    truth = (halves[0] + halves[1]) / 2
    blocks = [_blocks(np.where(emission[..., None], 0, x)) for x in (image, truth, *halves)]
    noise = np.abs(blocks[2] - blocks[3]).mean() / 2
    # Averages over 6 x 6 pixels: the noise of both, with room for its spread, and the bias
    # of further encounters with the wall as an albedo, which is below 1 % here
    assert np.abs(blocks[0] - blocks[1]).mean() < 3 * noise + 0.01 * blocks[1].mean()
    live.reset()


def _blocks(image: np.ndarray) -> np.ndarray:
    return np.asarray(image.reshape(8, 6, 8, 6, 3).mean(axis=(1, 3)))


def test_the_denoiser_takes_noise_and_keeps_the_light(live: Session) -> None:
    pytest.importorskip("pyoidn")
    live.select("floor")
    live.frame()
    until(lambda: view_of(live).samples >= 29)
    noisy, clean = live.frame(), live.denoised()
    assert clean.shape == noisy.shape
    # The ceiling is one smooth surface: neighbours differ by their noise
    rough = [np.abs(np.diff(x[2:5, 8:18], axis=1)).mean() for x in (noisy, clean)]
    assert rough[1] < rough[0]
    lit = view_of(live).emission.max(axis=2) == 0
    assert clean[lit].mean() == pytest.approx(noisy[lit].mean(), rel=0.05)


def test_what_cannot_be_sent_fails_and_the_next_is_sent(live: Session) -> None:
    studio = studio_of(live)
    local = cast(MaterialState, lambda: None)
    with pytest.raises(SceneError, match="cannot be told"):
        studio.render({"back": local}, view_of(live).name, spp=1)
    live.select("back")
    with pytest.raises(SceneError, match="cannot be told"):
        view_of(live).freeze((), {**live.state, "left": local})
    assert np.isfinite(live.frame()).all()
    assert np.isfinite(live.path_trace(spp=2)).all()


def test_another_object_and_none(live: Session) -> None:
    live.select("small-box")
    first = live.frame()
    live.select()
    second = live.frame()
    assert first.shape == second.shape == (48, 48, 3)
    assert np.isfinite(first).all()
    assert np.isfinite(second).all()


def test_editing_an_object_selects_it(live: Session) -> None:
    live.select("back")
    live.frame()
    live.set("left.diffuse.color", (0.0, 0.0, 0.0))
    assert live.selected == ("left",)
    assert np.isfinite(live.frame()).all()
    live.undo()


def test_a_moved_light_is_traced_anew(live: Session) -> None:
    """The picture comes to be the path tracer's, and is what it was when the light is back."""
    live.select("back")
    live.frame()
    until(lambda: view_of(live).samples >= 61)
    before = _blocks(live.frame())
    live.set("light:light.position", (4.4, 3.0, 2.0))
    live.set("light:light.direction", (-1.0, -1.0, 0.0))
    live.set("light:light.size", 2.0)
    live.frame()
    until(lambda: view_of(live).samples >= 61)
    samples = view_of(live).samples
    live.set("back.diffuse.color", (0.2, 0.4, 0.7))
    moved = _blocks(live.frame())
    assert view_of(live).samples >= samples
    truth = _blocks(live.path_trace(spp=256, seed=1))
    assert np.abs(moved - truth).mean() < 0.25 * np.abs(before - truth).mean()
    live.reset()
    live.frame()
    until(lambda: view_of(live).samples >= 61)
    assert np.abs(_blocks(live.frame()) - before).mean() < 0.25 * np.abs(before - truth).mean()


ROOM = """<scene version="3.0.0">
<sensor type="perspective"><transform name="to_world">
  <lookat origin="0, -4, 0" target="0, 0, 0" up="0, 0, 1"/></transform></sensor>
<shape type="sphere" id="ball"><bsdf type="diffuse"/></shape>
<emitter type="envmap" id="sky"><string name="filename" value="grey.exr"/></emitter>
</scene>"""


def test_surroundings_are_replaced_and_a_file_that_is_none_is_said(tmp_path: Path) -> None:
    from burnish.app.pictures import write_picture
    from burnish.runtime.tonemap import ToneMap

    for name, light in (("grey", 0.5), ("bright", 1.5)):
        picture = np.full((4, 8, 3), light, np.float32)
        write_picture(tmp_path / f"{name}.exr", picture, ToneMap())
    (tmp_path / "broken.exr").write_text("nothing")
    (tmp_path / "room.xml").write_text(ROOM)
    with burnish.edit(tmp_path / "room.xml", resolution=(16, 16), series=(1, 1)) as session:
        # A few hundred samples of the ball, each within half of the mean: some percent
        before = session.frame().mean()
        session.set("light:sky.file", str(tmp_path / "bright.exr"))
        assert session.frame().mean() == pytest.approx(3 * before, rel=0.15)
        session.set("light:sky.file", str(tmp_path / "broken.exr"))
        with pytest.raises(BurnishError, match="cannot be read as an environment map"):
            session.frame()
        session.undo()
        assert session.frame().mean() == pytest.approx(3 * before, rel=0.15)
        session.reset()
        assert session.frame().mean() == pytest.approx(before, rel=0.15)


def test_a_killed_worker_comes_back(live: Session) -> None:
    live.select("floor")
    live.frame()
    studio, view = studio_of(live), view_of(live)
    assert studio._process.pid is not None
    os.kill(studio._process.pid, signal.SIGKILL)
    shown = live.frame()
    assert np.isfinite(shown).all()
    until(lambda: studio.restarts == 1)
    revision = view.revision
    until(lambda: view.revision > revision)
    assert np.isfinite(live.frame()).all()


def test_closing_leaves_nothing() -> None:
    session = burnish.edit("cornell-box", resolution=(16, 16))
    session.frame()
    studio = studio_of(session)
    session.close()
    assert not studio._process.is_alive()
    assert not studio._folder.exists()
    session.close()


def test_a_bad_scene_is_an_error_in_words(tmp_path: Path) -> None:
    with pytest.raises(BurnishError, match="nowhere"):
        burnish.edit(tmp_path / "nowhere.xml")
    with pytest.raises(BurnishError, match="teatray"):
        burnish.edit("teatrey")


@pytest.mark.parametrize("light_groups", [None, ("each",)], ids=["shares", "groups"])
def test_mixing_lights_restarts_nothing(light_groups: tuple[str, ...] | None) -> None:
    with burnish.edit(
        "ring", resolution=(32, 24), series=(8, 1), light_groups=light_groups
    ) as session:
        session.select("ring")
        session.frame()
        until(lambda: view_of(session).samples >= 30)
        studio_of(session).pause()
        # The worker answers in order: with this picture it has paused, and told of all before
        session.path_trace(spp=2)
        samples, whole = view_of(session).samples, session.frame()
        total = np.zeros_like(whole)
        for light in ("lamp", "studio"):
            session.set(f"light:{light}.solo", True)
            alone = session.frame()
            assert alone.mean() < 0.95 * whole.mean()
            total += alone
            session.undo()
        np.testing.assert_allclose(total, whole, rtol=1e-4, atol=1e-6 * whole.max())
        session.set("light:lamp.on", False)
        session.set("light:studio.on", False)
        session.set("ring.specular.roughness", 0.3)
        assert not session.frame().any()
        assert view_of(session).samples == samples
