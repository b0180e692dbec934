"""The plots beside an object, drawn in a thread of their own so that no drag waits for them."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass

from burnish.app.messages import Appearance, Notice, ServerMessage
from burnish.app.server.appearance import ball, polar
from burnish.app.server.describe import rgb_list
from burnish.materials.layer import Material, MaterialState

log = logging.getLogger("burnish.editor")


@dataclass(frozen=True)
class Subject:
    """What is to be plotted: an object's material as it is now, and the light's angle."""

    name: str
    material: Material
    state: MaterialState
    theta_i: float


class Plots:
    """Draws the newest subject; older ones that still wait are skipped.

    publish: called from the plots' thread with each finished plot.
    """

    def __init__(self, publish: Callable[[ServerMessage], None]) -> None:
        self._publish = publish
        self._changed = threading.Condition()
        self._next: Subject | None = None
        self._stop = False
        self._thread = threading.Thread(target=self._loop, name="burnish-plots", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def draw(self, subject: Subject) -> None:
        """Plot this next."""
        with self._changed:
            self._next = subject
            self._changed.notify()

    def close(self) -> None:
        """End after the plot in progress."""
        with self._changed:
            self._stop = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join(timeout=10.0)

    def _loop(self) -> None:
        while True:
            with self._changed:
                while self._next is None and not self._stop:
                    self._changed.wait()
                if self._stop:
                    return
                subject, self._next = self._next, None
            assert subject is not None
            try:
                self._publish(_plot(subject))
            except Exception as error:
                log.exception("plot of %s failed", subject.name)
                self._publish(Notice("warning", f"The plots could not be drawn: {error!r}"))


def _plot(subject: Subject) -> Appearance:
    theta, radiance = polar(subject.material, subject.state, subject.theta_i)
    return Appearance(
        object=subject.name,
        ball=ball(subject.material, subject.state),
        theta_i=subject.theta_i,
        theta=tuple(theta.tolist()),
        radiance=rgb_list(radiance),
    )
