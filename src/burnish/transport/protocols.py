"""What a session may ask of a ray tracer, without importing one."""

from __future__ import annotations

from typing import Protocol

from burnish.core.types import Float32, Progress
from burnish.transport.basis import State
from burnish.transport.frozen import Transport


class Refiner(Protocol):
    """A live estimate that goes on in a worker process."""

    def select(self, object_ids: tuple[str, ...], state: State) -> Transport: ...
    def pause(self) -> None: ...
    def resume(self) -> None: ...
    def close(self) -> None: ...


class DirectLight(Protocol):
    """Direct light of a changed lighting at the rows of a view."""

    def evaluate(self, view: str, state: State) -> Float32: ...


class Truth(Protocol):
    """A path-traced picture with the materials of a state."""

    def render(
        self,
        state: State,
        view: str,
        spp: int,
        seed: int = 0,
        progress: Progress | None = None,
    ) -> Float32:
        """float32 [height, width, 3], linear RGB."""
        ...
