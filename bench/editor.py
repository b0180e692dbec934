"""The editor in a local browser: from a slider's input to changed pixels, and frames a second.

    python -m bench editor

Needs Chromium, as the browser tests do. WebGL runs in software, on the same cores as the
engine: a machine with a graphics card does better.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np

import burnish
from bench.chromium import chromium_page
from bench.report import Goal, Report
from burnish.app.server import EditorServer
from burnish.session import Session
from tests.editor import worlds

SIZE = 512

RECORD = """
window.drawn = [];
const P = WebGL2RenderingContext.prototype, upload = P.texSubImage2D, draw = P.drawArrays;
let fresh = false;
P.texSubImage2D = function (...a) { fresh ||= a[6] === this.RGB; return upload.apply(this, a); };
P.drawArrays = function (...a) {
  const result = draw.apply(this, a);
  if (fresh) { fresh = false; window.drawn.push(performance.now()); }
  return result;
};
const slider = () => document.querySelector('input[type=range][aria-label="Exponent"]');
window.named = (kind, text) =>
  [...document.querySelectorAll(kind)].find((element) => element.textContent.includes(text));
window.hold = () => slider().dispatchEvent(new PointerEvent('pointerdown', { bubbles: true }));
window.release = () => window.dispatchEvent(new PointerEvent('pointerup', { bubbles: true }));
window.slide = (value) => {
  slider().value = value;
  slider().dispatchEvent(new Event('input', { bubbles: true }));
};
"""

LATENCY = """async (repeats) => {
  const pause = (ms) => new Promise((done) => setTimeout(done, ms)), result = [];
  window.hold();
  for (let i = 0; i < repeats; i++) {
    const before = window.drawn.length, start = performance.now();
    window.slide(300 + 5 * (i % 60));
    while (window.drawn.length === before && performance.now() < start + 3000) await pause(1);
    result.push((window.drawn[before] ?? performance.now()) - start);
    await pause(250 + 40 * Math.random());
  }
  window.release();
  return result;
}"""

RATE = """async (ms) => {
  window.hold();
  const before = window.drawn.length, start = performance.now();
  for (let i = 0; performance.now() < start + ms; i++) {
    window.slide(200 + ((3 * i) % 600));
    await new Promise(requestAnimationFrame);
  }
  const rate = (1000 * (window.drawn.length - before)) / (performance.now() - start);
  window.release();
  return rate;
}"""


@dataclass(frozen=True)
class Found:
    """One session's figures."""

    engine: float
    latencies: Any
    shown: float


def run(quick: bool) -> Report:
    """Measure on a made-up view and on a live session, both of 512 × 512 pixels."""
    made_up = measure(Session({"front": worlds.world(SIZE, SIZE)}, name="bench"), "ball", quick)
    with burnish.edit("cornell-box", resolution=(SIZE, SIZE)) as session:
        session.set("large-box.specular.weight", 0.5)
        live = measure(session, "large-box", quick)
    rows, goals = [], []
    for name, found in (("made up", made_up), ("live", live)):
        median, late = (float(np.percentile(found.latencies, q)) for q in (50, 95))
        rows.append(
            {
                "session": name,
                "engine frames/s": found.engine,
                "latency median ms": median,
                "latency p95 ms": late,
                "shown frames/s": found.shown,
            }
        )
        goals += [
            Goal(f"{name}: median latency, ms", median, 50.0),
            Goal(f"{name}: p95 latency, ms", late, 100.0),
            Goal(f"{name}: frames shown a second", found.shown, 30.0, at_least=True),
        ]
    return Report(
        name="editor",
        title="The editor in a local browser",
        notes=(
            f"{SIZE} × {SIZE} pixels, WebGL in software. Latency is from a slider's input event "
            "to the draw call that shows its frame; frames are those shown while the slider is "
            "held and moves. Made up: a small scene with no tracer. Live: the Cornell box, passes "
            "going on; one picture a second is a new estimate's, and counts as an answer too."
        ),
        rows=rows,
        goals=goals,
        data={
            "latency_ms": {
                row["session"]: [round(float(x), 2) for x in found.latencies]
                for row, found in zip(rows, (made_up, live), strict=True)
            }
        },
    )


def measure(session: Session, name: str, quick: bool) -> Found:
    """Drag the exponent of an object's gloss, in the engine alone and from the page."""
    session.select(name)
    session.frame()
    values, start, frames = count(10), time.perf_counter(), 40
    for _ in range(frames):
        session.set(f"{name}.specular.exponent", float(next(values)))
        session.frame()
    engine = frames / (time.perf_counter() - start)
    with EditorServer(session) as server, chromium_page() as page:
        page.open(server.url, RECORD, 1280, 720)
        page.wait("document.querySelector('canvas') && !document.querySelector('.waiting')")
        page.wait(f"named('[role=option]', {name!r})")
        page.evaluate(f"named('[role=option]', {name!r}).click()")
        page.wait("document.querySelector('.ball img')")
        page.evaluate("named('button:enabled', 'Denoise at rest')?.click()")
        time.sleep(1.5)
        milliseconds = np.array(page.evaluate(f"({LATENCY})({20 if quick else 100})"))
        rate = float(page.evaluate(f"({RATE})({3000 if quick else 10000})"))
    return Found(engine, milliseconds, rate)
