"""Live views at rest: the noise of their pictures, and cleaned ones for the eye alone."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from burnish.core.errors import BurnishError
from burnish.core.types import Float32
from burnish.session import Session

log = logging.getLogger("burnish.editor")

ENOUGH_SAMPLES = 1000
"""Samples per pixel from which a picture is shown as it is."""

REFRESH_SECONDS = 2.0
"""A cleaned picture of an unchanged state is made anew this often at most."""

_FAILURES = 3


@dataclass(frozen=True)
class Cleaned:
    """A denoised picture, and what it is of: any key that tells states apart."""

    view: str
    key: object
    image: Float32


class Resting:
    """Denoises one picture at a time, in a thread that waits for the worker.

    done: called from that thread with each picture, or the words of what went wrong.
    """

    def __init__(self, session: Session, done: Callable[[Cleaned | str], None]) -> None:
        self._session = session
        self._done = done
        self._busy = False
        self._failures = 0
        self._begun: dict[str, tuple[object, object, float]] = {}
        self.wanted = True
        self.unavailable = "Bundles are as clean as their bake; only live pictures are denoised."
        if session.denoiser is not None:
            self.unavailable = getattr(session.denoiser, "denoiser_missing", "")

    @property
    def active(self) -> bool:
        """Whether pictures are to be cleaned as long as they are noisy."""
        return self.wanted and not self.unavailable

    def due(self, view: str, key: object, revision: object, now: float) -> bool:
        """Whether the view's picture should be cleaned now: at once when its state is a new
        one, else when its estimate has another revision, from time to time."""
        if self._busy:
            return False
        known = self._begun.get(view)
        if known is None or known[0] != key:
            return True
        return known[1] != revision and now - known[2] >= REFRESH_SECONDS

    def begin(self, view: str, key: object, revision: object, image: Float32, now: float) -> None:
        """Clean a picture; ask `due` first."""
        self._begun[view] = key, revision, now
        self._busy = True
        threading.Thread(
            target=self._clean, args=(view, key, image), name="burnish-denoise", daemon=True
        ).start()

    def forget(self) -> None:
        """What was cleaned is not shown any more."""
        self._begun = {}

    def _clean(self, view: str, key: object, image: Float32) -> None:
        denoiser = self._session.denoiser
        assert denoiser is not None
        answer: Cleaned | str
        try:
            answer = Cleaned(view, key, denoiser.denoise(image, view))
        except BurnishError as error:
            answer = str(error)
        except Exception as error:
            log.exception("denoising failed")
            answer = repr(error)
        # A worker that comes back may do it; one that never can is not asked for ever
        self._failures = self._failures + 1 if isinstance(answer, str) else 0
        if self._failures >= _FAILURES and isinstance(answer, str):
            self.unavailable = answer
        self._busy = False
        self._done(answer)


class NoiseMeter:
    """The expected relative error by noise of a view whose samples grow.

    Two pictures of one state, of n₁ and n₂ samples where the second holds the first,
    differ by s²(1/n₁ - 1/n₂) in the mean square: that gives s, and s/√n from then on.
    """

    def __init__(self) -> None:
        self._key: object = None
        self._last: tuple[int, Float32] | None = None
        self._deviation: float | None = None

    def take(self, key: object, samples: int, image: Float32, emission: Float32) -> None:
        """A new picture. key: of what all samples share; directly seen emission is left out."""
        light = image - emission
        if key != self._key:
            self._key, self._last, self._deviation = key, None, None
        if self._last is not None and self._last[0] < samples:
            before, earlier = self._last
            norm = float(np.linalg.norm(light))
            spread = float(np.linalg.norm(light - earlier))
            if norm > 0.0:
                self._deviation = spread / norm / float(np.sqrt(1 / before - 1 / samples))
        self._last = samples, light

    def edited(self, key: object) -> None:
        """The materials have changed, the samples have not: the figure stays for the moment."""
        self._key, self._last = key, None

    def noise(self, samples: int) -> float:
        """Relative root mean square by noise at so many samples; below 0 while unknown."""
        if self._deviation is None or samples < 1:
            return -1.0
        return self._deviation / float(np.sqrt(samples))


def samples_of(transport: Any) -> int:
    """Samples per pixel of a live view, below 0 for a bundle's."""
    return int(getattr(transport, "samples", -1))
