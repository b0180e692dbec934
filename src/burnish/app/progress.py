"""Progress on the terminal: a bar with the time left, on stderr so that pipes stay clean."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from burnish.core.types import Progress


@contextmanager
def progress_bar(title: str) -> Iterator[Progress]:
    """A bar for as long as the block runs; it yields what to report progress to.

    Where stderr is no terminal (a log, a pipe) it writes one line per tenth instead. Ctrl+C
    in the block is a KeyboardInterrupt wherever it strikes.
    """
    with _interruptible(), _bar(title) as report:
        yield report


@contextmanager
def _interruptible() -> Iterator[None]:
    """Dr.Jit makes a RuntimeError of what is raised inside a loop that it traces."""
    try:
        yield
    except RuntimeError as error:
        cause: BaseException | None = error
        while cause is not None:
            if isinstance(cause, KeyboardInterrupt):
                raise KeyboardInterrupt from error
            cause = cause.__cause__ or cause.__context__
        raise


@contextmanager
def _bar(title: str) -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )
    from rich.progress import Progress as Bars

    console = Console(stderr=True)
    if not console.is_terminal:
        tenth = -1

        def report_line(fraction: float, what: str) -> None:
            nonlocal tenth
            if int(fraction * 10) > tenth:
                tenth = int(fraction * 10)
                console.print(f"{title}: {fraction:4.0%} {what}", highlight=False, soft_wrap=True)

        yield report_line
        return

    columns = (
        TextColumn("[bold]{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
        TextColumn("{task.fields[what]}"),
    )
    with Bars(*columns, console=console, speed_estimate_period=120.0) as bars:
        task = bars.add_task(title, total=1.0, what="")

        def report(fraction: float, what: str) -> None:
            bars.update(task, completed=fraction, what=what)

        yield report
