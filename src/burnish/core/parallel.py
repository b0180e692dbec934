"""Threads: several of ours, each with a BLAS of one thread.

BLAS threads wait for each other by spinning. Beside a busy process (a ray tracer in its
worker) a product of small matrices then takes thirty times as long; threads that share
nothing only take the time that is theirs.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from functools import cache
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

T = TypeVar("T")


def core_count() -> int:
    """Cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(core_count(), thread_name_prefix="burnish")


def plain_blas() -> AbstractContextManager[object]:
    """BLAS with one thread, for products that are too small to share out."""
    limited: AbstractContextManager[object] = _controller().limit(limits=1, user_api="blas")
    return limited


def parallel_map(function: Callable[..., T], *items: Iterable[Any]) -> list[T]:
    """`list(map(function, *items))` on all cores. Do not nest.

    For work that releases the interpreter's lock, as NumPy's does on large arrays. The
    first exception is raised.
    """
    with plain_blas():
        return list(_pool().map(function, *items))
