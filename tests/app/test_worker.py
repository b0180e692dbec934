"""What the worker of a live session publishes, and when."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from burnish.app.worker import ENOUGH_SAMPLES, _Sent, _Worker


def test_the_last_samples_are_published_though_nothing_is_due() -> None:
    """No others follow them, and who waits for them would wait for ever."""
    messages: list[Any] = []
    estimate = SimpleNamespace(
        samples=ENOUGH_SAMPLES - 2,
        base=lambda: (np.zeros(3, np.float32), np.zeros(3, np.float32)),
        write=lambda arrays: None,
    )

    def step() -> None:
        estimate.samples += 1

    estimate.step = step
    worker = object.__new__(_Worker)
    worker.pipe = SimpleNamespace(send=messages.append)  # type: ignore[assignment]
    worker.estimates = {"front": estimate}
    worker.files = {"front": (np.zeros(6, np.float32), [])}
    worker.published = {"front": _Sent(64, float("inf"), float("inf"))}
    worker.watched, worker.paused, worker.serial, worker.began = (), False, 1, 0.0
    worker._refine()
    assert not messages
    worker._refine()
    assert [message.samples for message in messages] == [ENOUGH_SAMPLES]
    worker._refine()
    assert len(messages) == 1
