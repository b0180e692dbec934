"""Clocks: interleaved peers, memory bandwidth, and children with their peak memory."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from burnish.core.parallel import core_count, parallel_map


def seconds(action: Callable[[], object]) -> float:
    """The time of one call."""
    start = time.perf_counter()
    action()
    return time.perf_counter() - start


def interleaved(actions: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """The median seconds of each action, called in turns after one call that is not timed."""
    for action in actions.values():
        action()
    times: dict[str, list[float]] = {name: [] for name in actions}
    for _ in range(repeats):
        for name, action in actions.items():
            times[name].append(seconds(action))
    return {name: statistics.median(values) for name, values in times.items()}


def reader(size: int) -> Callable[[], object]:
    """Reads an array of `size` bytes once with all cores: what memory bandwidth alone costs."""
    width = 1024
    data = np.ones((max(size // (4 * width), 1), width), np.float32)
    pieces = np.array_split(data, 4 * core_count())
    ones = np.ones(width, np.float32)
    return lambda: parallel_map(lambda piece: piece @ ones, pieces)


def forget(folder: Path) -> None:
    """Drop a folder's files from the system's page cache, so that the next read is cold."""
    for path in folder.rglob("*"):
        if path.is_file():
            handle = os.open(path, os.O_RDONLY)
            try:
                os.fsync(handle)
                os.posix_fadvise(handle, 0, 0, os.POSIX_FADV_DONTNEED)
            finally:
                os.close(handle)


def child(module: str, *arguments: object) -> tuple[dict[str, Any], float]:
    """Run `python -m module …` and read the JSON of its last line of output.

    Returns it with the child's peak memory in bytes.
    """
    command = [sys.executable, "-m", module, *map(str, arguments)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    output = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with {process.returncode}")
    unit = 1 if sys.platform == "darwin" else 1024
    return json.loads(output.strip().splitlines()[-1]), float(usage.ru_maxrss * unit)
