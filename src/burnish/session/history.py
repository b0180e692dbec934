"""Undo and redo: a list of states, since states are values."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from burnish.transport.basis import State


@dataclass(frozen=True)
class _Step:
    label: str
    state: State


class History:
    """States in the order in which they were made, and the place among them.

    Inside a gesture all changes make one step; a gesture that ends where it began makes
    none. A change after an undo forgets what was undone.
    """

    def __init__(self, start: State) -> None:
        self._start = start
        self._steps: list[_Step] = []
        self._position = 0
        self._depth = 0
        self._open = False

    @property
    def state(self) -> State:
        """The present state."""
        return self._steps[self._position - 1].state if self._position else self._start

    @property
    def labels(self) -> list[str]:
        """What each step did, oldest first, undone ones included."""
        return [step.label for step in self._steps]

    @property
    def position(self) -> int:
        """How many of the steps are in force."""
        return self._position

    def record(self, label: str, state: State) -> bool:
        """Make `state` the present one; False when it already is."""
        if state == self.state:
            return False
        if self._open:
            self._position -= 1
            if state == self.state:
                # The gesture is back where it began
                del self._steps[self._position :]
                self._open = False
                return True
        del self._steps[self._position :]
        self._steps.append(_Step(label, state))
        self._position += 1
        self._open = self._depth > 0
        return True

    def undo(self) -> bool:
        """Go one step back; False at the beginning."""
        self._open = False
        if self._position == 0:
            return False
        self._position -= 1
        return True

    def redo(self) -> bool:
        """Go one step forth; False at the end."""
        self._open = False
        if self._position == len(self._steps):
            return False
        self._position += 1
        return True

    @contextmanager
    def gesture(self, done: Callable[[], None] | None = None) -> Iterator[None]:
        """Everything recorded inside is one step. Gestures nest; the outermost counts."""
        self._depth += 1
        try:
            yield
        finally:
            self._depth -= 1
            if self._depth == 0:
                self._open = False
                if done is not None:
                    done()
