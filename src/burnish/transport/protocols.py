"""What a session may ask of a ray tracer, without importing one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from burnish.core.types import Crop, Float32, Progress
from burnish.materials.lights import LightGroup
from burnish.transport.basis import State


class Refiner(Protocol):
    """A live estimate that goes on in a worker process."""

    def select(self, targets: tuple[str, ...], state: State) -> None:
        """Estimate with these objects symbolic and the others as they are in `state`."""
        ...

    def follow(self, state: State) -> None:
        """Let the samples to come follow the current look."""
        ...

    def pause(self, paused: bool = True) -> None:
        """Stop, or go on."""
        ...

    def close(self) -> None:
        """End the worker."""
        ...


class Denoiser(Protocol):
    """Cleans a resting picture; never part of dragged, saved or compared ones."""

    def denoise(self, image: Float32, view: str) -> Float32:
        """float32 [height, width, 3], linear RGB."""
        ...


class LightPictures(Protocol):
    """What each light adds to a picture, path-traced."""

    def light_pictures(
        self, state: State, view: str, groups: Sequence[LightGroup], spp: int, seed: int
    ) -> tuple[Float32, Float32]:
        """All of it, and directly seen emission alone: float32 [groups, height, width, 3]."""
        ...


class DirectLight(Protocol):
    """Direct light of changed lights, traced anew; what was asked last is kept.

    samples: at least so many, per pixel or per point; more are added to those that are there.
    """

    def irradiance(self, state: State, samples: int) -> tuple[Float32, Float32]:
        """At the points of all gather samples: float32 [g, p, 3], linear RGB. Of all lights,
        and of those that cells of the sky and of lamps show themselves."""
        ...

    def emission(self, state: State) -> Float32:
        """What cells of the sky and of lamps show: float32 [g, 3], linear RGB."""
        ...

    def picture(
        self, view: str, state: State, without: tuple[int, ...], samples: int
    ) -> tuple[Float32, Float32]:
        """Direct light with all materials of a state, that on some objects (indices into
        `Basis.objects`) left out, and directly seen emission: float32 [height, width, 3] each."""
        ...

    def columns(self, view: str, index: int, state: State, samples: int) -> Float32:
        """Direct light on the rows of one object by column, coefficients left out: float32
        [rows, columns, 3]."""
        ...


class Truth(Protocol):
    """A path-traced picture with the materials of a state."""

    def render(
        self,
        state: State,
        view: str,
        spp: int,
        seed: int = 0,
        progress: Progress | None = None,
        crop: Crop | None = None,
    ) -> Float32:
        """float32 [height, width, 3], linear RGB; with a crop, of its pixels alone."""
        ...
