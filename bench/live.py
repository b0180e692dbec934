"""Live sessions beside Mitsuba, at equal time: the noise of what is on the screen.

    python -m bench live

A live session serves every look of the selected object, Mitsuba's `path` is given the one look.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

import burnish
from bench.report import Goal, Report
from burnish.app.live import LiveView
from burnish.core.types import Bool, Float32, Float64
from burnish.precompute.prepass import dilate
from burnish.reference.truth import edited_bsdf
from burnish.session import Session
from burnish.transport.basis import State

PASS_SPP = 4
"""Samples per pixel of one of Mitsuba's passes: the step in which its time can end."""
REFERENCE_SPP = 64
SETTLED = 48
"""Samples per pixel after which a live session's passes have their full size."""


@dataclass(frozen=True)
class Subject:
    """A scene, what is selected in it, and the looks that are dragged through.

    looks: value of `path` one after the other; the last is the one that is judged.
    """

    scene: str
    object: str
    path: str
    looks: tuple[float, ...]
    also: tuple[tuple[str, object], ...] = ()
    series: tuple[int, ...] = (64, 1, 1, 1)


SUBJECTS = (
    Subject(
        "cornell-box",
        "large-box",
        "large-box.specular.exponent",
        (20.0, 400.0, 50.0, 800.0, 200.0),  # the last like α = 0.1
        (("large-box.specular.weight", 0.5), ("large-box.diffuse.weight", 0.5)),
    ),
    Subject("teatray", "teapot", "teapot.specular.roughness", (0.3, 0.06, 0.4, 0.2, 0.1)),
    Subject(
        "ring",
        "ring",
        "ring.specular.roughness",
        (0.3, 0.06, 0.4, 0.2, 0.1),
        series=(64, 16),
    ),
)


def run(quick: bool) -> Report:
    """Each subject after some times, and after five edits over ten seconds."""
    size, spp = (64, 1024) if quick else (256, 4096)
    times = (2.0, 5.0) if quick else (2.0, 10.0, 60.0)
    rows, goals = [], []
    for subject in SUBJECTS:
        found = measure(subject, size, spp, times)
        rows += found
        for row in found:
            edits = row["edits"]
            text = f"{subject.scene}, {row['seconds']:g} s"
            text += f", {edits} edits" if edits > 1 else ""
            goals.append(Goal(f"{text}: live / Mitsuba", row["ratio"], 1.0 if edits > 1 else 2.0))
    notes = (
        f"{size} × {size} pixels. rel. RMSE against {spp} samples per pixel of `path`, the "
        "reference's own noise taken out, lamps in view left out; denoiser off. Live bias: what "
        "two independent estimates are both off by. Live: from a new selection with compiled "
        "kernels, series (64,1,1,1), for the ring the (64,16) of the 2008 paper's table. Mitsuba: "
        "`path` with the same depth and the look's materials, its kernel compiled, passes of "
        f"{PASS_SPP} samples. With edits: one every two seconds, the last two seconds before the "
        "end; Mitsuba has two seconds for the last look."
    )
    return Report("live", "Live sessions at equal time", notes, rows, goals)


def measure(
    subject: Subject, size: int, spp: int, times: tuple[float, ...]
) -> list[dict[str, Any]]:
    """One subject's rows."""
    with burnish.edit(subject.scene, resolution=(size, size), series=subject.series) as session:
        for path, value in subject.also:
            session.set(path, value)
        session.select(subject.object)
        session.set(subject.path, subject.looks[-1])
        settle(session)  # compiles
        live = [(seconds, 1, *live_frame(session, subject, (0.0,), seconds)) for seconds in times]
        spread = tuple(2.0 * k for k in range(len(subject.looks)))
        live.append((10.0, len(spread), *live_frame(session, subject, spread, 10.0)))
        state, bounces = dict(session.state), next(iter(session.views.values())).basis.bounces
    peer = Peer(subject.scene, size, state, bounces)
    mask = ~peer.lamp
    halves = peer.reference(spp)
    truth = (halves[0] + halves[1]) / 2
    noise = float(np.linalg.norm((halves[0] - halves[1])[mask]) / 2)
    scale = float(np.linalg.norm(truth[mask]))

    def error(image: Float32) -> float:
        off = float(np.linalg.norm((image.reshape(-1, 3) - truth)[mask]))
        return float(np.sqrt(max(off**2 - noise**2, 0.0))) / scale

    # What two independent estimates are both off by is no noise
    off = [(image.reshape(-1, 3) - truth)[mask].ravel() for _, _, image, _ in live[-2:]]
    bias = float(np.sqrt(max(float(off[0] @ off[1]) - noise**2, 0.0))) / scale
    rows = []
    for seconds, edits, image, samples in live:
        other, other_spp = peer.render(seconds / edits)
        ours, theirs = error(image), error(other)
        rows.append(
            {
                "scene": subject.scene,
                "seconds": seconds,
                "edits": edits,
                "live %": 100 * ours,
                "live bias %": 100 * bias,
                "live spp": samples,
                "Mitsuba %": 100 * theirs,
                "Mitsuba spp": other_spp,
                "ratio": ours / theirs,
            }
        )
    return rows


def settle(session: Session) -> None:
    """Wait until passes of every size have been made: each is a kernel of its own."""
    session.frame()
    view = live_view(session)
    while view.samples < SETTLED:
        time.sleep(0.05)


def live_view(session: Session) -> LiveView:
    """The only view."""
    view = next(iter(session.views.values()))
    assert isinstance(view, LiveView)
    return view


def live_frame(
    session: Session, subject: Subject, edits: tuple[float, ...], seconds: float
) -> tuple[Float32, int]:
    """The picture `seconds` after a new selection, edited at the given times on the way.

    The last look of the subject is the one at the end. Gives it with its samples per pixel.
    """
    session.select()
    session.frame()
    session.select(subject.object)
    start = time.perf_counter()
    for when, value in zip(edits, subject.looks[-len(edits) :], strict=True):
        time.sleep(max(start + when - time.perf_counter(), 0.0))
        session.set(subject.path, value)
        session.ready()
    time.sleep(max(start + seconds - time.perf_counter(), 0.0))
    image = session.frame()
    return image, live_view(session).samples


class Peer:
    """Mitsuba's path tracer on one look."""

    def __init__(self, name: str, size: int, state: State, bounces: int) -> None:
        scene = burnish.load(name, resolution=(size, size))
        changed = {
            item.id: edited_bsdf(item, state[item.id])
            for item in scene.editable()
            if item.material is not None and state[item.id] != item.material.initial
        }
        self.scene = scene.with_bsdfs(changed)
        self.integrator = mi.load_dict(
            {"type": "path", "max_depth": bounces + 1, "rr_depth": bounces + 2}
        )
        self._pass(0)  # compiles
        direct = mi.load_dict({"type": "path", "max_depth": 1})
        emission = np.array(direct.render(self.scene, self.scene.sensors()[0], seed=0, spp=64))
        seen = emission[..., :3].max(axis=2, keepdims=True) > 0
        self.lamp: Bool = dilate(seen).ravel()

    def _pass(self, seed: int, spp: int = PASS_SPP) -> Float64:
        image = self.integrator.render(self.scene, self.scene.sensors()[0], seed=seed, spp=spp)
        dr.eval(image)
        dr.sync_thread()
        return np.array(image, np.float64)[..., :3].reshape(-1, 3)

    def render(self, seconds: float) -> tuple[Float32, int]:
        """What passes within a time make: float32 [pixels, 3] and the samples per pixel."""
        end, total, passes = time.perf_counter() + seconds, np.zeros((self.lamp.size, 3)), 0
        while passes == 0 or time.perf_counter() < end:
            total += self._pass(1000 + passes)
            passes += 1
        return np.asarray(total / passes, np.float32), passes * PASS_SPP

    def reference(self, spp: int) -> tuple[Float64, Float64]:
        """Two independent halves of so many samples per pixel: float64 [pixels, 3]."""
        halves = []
        for half in range(2):
            count = max(spp // (2 * REFERENCE_SPP), 1)
            seeds = (2_000_000 + 2 * number + half for number in range(count))
            halves.append(sum(self._pass(seed, REFERENCE_SPP) for seed in seeds) / count)
        return np.asarray(halves[0]), np.asarray(halves[1])
