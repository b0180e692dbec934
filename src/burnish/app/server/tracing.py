"""The path-traced reference: passes in a thread of their own, averaged as they come."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from burnish.app.messages import Crop, Reference
from burnish.core.errors import BurnishError, InvalidValue
from burnish.core.types import Float32, Float64
from burnish.session import Session
from burnish.transport.basis import State
from burnish.transport.frozen import Transport
from burnish.transport.protocols import Truth

log = logging.getLogger("burnish.editor")

Picture = tuple[str, Float32, tuple[int, int]]
"""A view, linear RGB, and the view's pixel that its first one lies on."""
_LEAST_SIDE = 16
"""Pixels of a crop's shorter side: what FLIP's filters need."""
_LEAST_PASS = 2
"""Samples per pixel that a path tracer needs to tell its own noise."""
_LARGEST_SPP = 65536


class _Cancelled(Exception):
    """Raised through the path tracer's progress when the user has stopped it."""


@dataclass
class _Run:
    view: str
    spp: int
    crop: Crop | None
    state: State
    revision: int
    done: int = 0
    halves: tuple[Float64, Float64] | None = None
    status: str = "running"
    text: str = ""
    compared: tuple[int, int, int] | None = None


class Tracing:
    """Begins, averages and cancels path tracing of the session's state.

    changed: called from the tracing thread with the picture so far, or None when only the
    figures have changed.
    """

    def __init__(self, session: Session, changed: Callable[[Picture | None], None]) -> None:
        self._session = session
        self._changed = changed
        self._run: _Run | None = None
        self._metrics: dict[str, float] = {}
        self._cancel = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def unavailable(self) -> str:
        """Why nothing can be path-traced here, or ""."""
        if self._session.truth is None:
            return "This bundle was opened without its scene or without a ray tracer."
        return ""

    @property
    def image(self) -> Picture | None:
        """The view and the mean of the passes so far."""
        run = self._run
        if run is None or run.halves is None:
            return None
        return run.view, _mean(run), _corner(run)

    def begin(self, view: str, spp: int, crop: Crop | None = None) -> None:
        """Path-trace the present state, inside a crop where one is given.

        Raises InvalidValue; a run in progress is stopped.
        """
        truth = self._session.truth
        if truth is None:
            raise InvalidValue(f"no reference: {self.unavailable}")
        least = 2 * _LEAST_PASS
        if not least <= spp <= _LARGEST_SPP:
            raise InvalidValue(f"spp must lie in [{least}, {_LARGEST_SPP}]; got {spp}")
        if crop is not None:
            _check_crop(crop, self._session.views[view])
        self.cancel()
        if self._thread is not None:
            self._thread.join()
        self._cancel.clear()
        self._metrics = {}
        run = _Run(view, spp, crop, dict(self._session.state), self._session.revision)
        self._run = run
        self._thread = threading.Thread(
            target=self._trace, args=(truth, run), name="burnish-reference", daemon=True
        )
        self._thread.start()

    def cancel(self) -> None:
        """Stop after the pass in progress."""
        self._cancel.set()

    def message(self, revision: int) -> Reference:
        """Where it stands, seen from a revision of the session."""
        run = self._run
        if run is None:
            return Reference("", None, "none", 0.0, 0, False, {}, "")
        return Reference(
            view=run.view,
            crop=run.crop,
            status=run.status,  # type: ignore[arg-type]
            fraction=run.done / run.spp,
            spp=run.done,
            stale=run.revision != revision,
            metrics={k: v for k, v in self._metrics.items() if math.isfinite(v)},
            text=run.text,
        )

    @property
    def compared_view(self) -> str | None:
        """The view of a finished reference, or None."""
        run = self._run
        done = run is not None and run.halves is not None and run.status != "running"
        return run.view if run is not None and done else None

    def compare_at_rest(
        self, revision: int, quality: int, frame_of: Callable[[str], Float32]
    ) -> None:
        """Measure the session's picture against the reference, once per pair.

        quality: a number that changes when the picture of one revision becomes a better one.
        """
        run = self._run
        if run is None or run.halves is None or run.status == "running":
            return
        if run.compared == (revision, quality, run.done):
            return
        run.compared = (revision, quality, run.done)
        from burnish.compare import metrics

        inside = _inside(run)
        image = frame_of(run.view)[inside]
        first, second = (half.astype(np.float32) for half in run.halves)
        emission = self._session.emission(run.view)[inside]
        try:
            figures = metrics(image, (first, second), emission=emission)
            self._metrics = {
                name: float(value)
                for name, value in figures.items()
                if isinstance(value, (int, float))
            }
        except (BurnishError, ArithmeticError) as error:
            self._metrics = {}
            run.text = f"The two pictures could not be compared: {error}"
        self._changed(None)

    def _trace(self, truth: Truth, run: _Run) -> None:
        """Passes of growing size, each for two independent halves."""
        sums: list[Float64] = []
        try:
            size, number = _LEAST_PASS, 0
            while run.done < run.spp and not self._cancel.is_set():
                size = max(min(size, (run.spp - run.done) // 2), _LEAST_PASS)
                for half in range(2):
                    image = truth.render(
                        run.state,
                        run.view,
                        size,
                        seed=7919 * run.revision + 2 * number + half,
                        progress=self._check_cancelled,
                        crop=run.crop,
                    )
                    weighted = image.astype(np.float64) * size
                    if len(sums) < 2:
                        sums.append(weighted)
                    else:
                        sums[half] = sums[half] + weighted
                number += 1
                run.done += 2 * size
                run.halves = sums[0] * (2 / run.done), sums[1] * (2 / run.done)
                size = min(size * 2, 64)
                self._changed((run.view, _mean(run), _corner(run)))
            run.status = "done"
            run.text = "" if run.done >= run.spp else "stopped"
        except _Cancelled:
            run.status, run.text = "done", "stopped"
        except Exception as error:
            log.exception("path tracing failed")
            run.status = "failed"
            run.text = str(error) if isinstance(error, BurnishError) else repr(error)
        self._changed(None)

    def _check_cancelled(self, fraction: float, what: str) -> None:
        if self._cancel.is_set():
            raise _Cancelled


def _check_crop(crop: Crop, view: Transport) -> None:
    """Raises InvalidValue for a crop that does not lie in the view or is too small."""
    left, top, width, height = crop
    if left < 0 or top < 0 or left + width > view.width or top + height > view.height:
        raise InvalidValue(
            f"a crop must lie inside the picture of {view.width} × {view.height} pixels; got "
            f"{width} × {height} at ({left}, {top})"
        )
    if min(width, height) < _LEAST_SIDE:
        raise InvalidValue(
            f"a crop must have at least {_LEAST_SIDE} × {_LEAST_SIDE} pixels; got "
            f"{width} × {height}: draw a larger one"
        )


def _inside(run: _Run) -> tuple[slice, slice]:
    """Rows and columns of the run's pixels in its view."""
    if run.crop is None:
        return slice(None), slice(None)
    left, top, width, height = run.crop
    return slice(top, top + height), slice(left, left + width)


def _corner(run: _Run) -> tuple[int, int]:
    return (0, 0) if run.crop is None else run.crop[:2]


def _mean(run: _Run) -> Float32:
    assert run.halves is not None
    first, second = run.halves
    return ((first + second) * 0.5).astype(np.float32)
