"""The mix of the lights where the transport does not tell them apart: by pictures of each.

The picture that a transport gives holds the light of all. A ray tracer gives, for the same
materials, what each light adds to every pixel, and so the light's share s_g of the pixel; the
shares of a pixel sum to one. The mixed picture is

    Σ_g m_g s_g · picture,        s_g = image_g / Σ_g' image_g',

which is exact, up to the noise of the shares, as long as the materials are those of the
images; lies between the smallest and the largest factor times the picture, whatever the noise;
is black where every light is off; and sums over the lights to the picture itself. The images
of a pixel come from the same paths, so that much of their noise goes in the division.

With other materials the old shares stay until new ones are there: an approximation, which
`LightMix.notice` says. In a session that is asked for pictures only, they are traced first.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from burnish.core.errors import BurnishError, MissingRayTracer, SceneError
from burnish.core.types import Float32, Float64
from burnish.materials.layer import MaterialState
from burnish.materials.lights import LightGroup, mix, unmixed
from burnish.transport.basis import State
from burnish.transport.protocols import LightPictures

PASS_SAMPLES = 16
"""Samples per pixel after which new shares are shown: a second's work at most."""

RETRY_SECONDS = 5.0
"""After so long what failed is tried again, and then after twice as long each time."""

WAITED_SAMPLES = 64
"""Samples per pixel of shares that a picture waits for."""

ENOUGH_SAMPLES = 256
"""Samples per pixel up to which shares are refined in the background."""


@dataclass(frozen=True)
class _Images:
    """What each light adds to a view: float32 [lights, height, width, 3], and of that the
    directly seen emission; of so many samples, for these materials."""

    materials: dict[str, MaterialState]
    samples: int
    images: Float32
    emission: Float32

    def joined(self, other: _Images) -> _Images:
        """The mean of both by their samples."""
        total = self.samples + other.samples
        a, b = np.float32(self.samples / total), np.float32(other.samples / total)
        return _Images(
            self.materials,
            total,
            a * self.images + b * other.images,
            a * self.emission + b * other.emission,
        )


@dataclass(frozen=True)
class _Ratio:
    """Σ_g m_g s_g of a view, and what it was made of."""

    images: _Images
    factors: Float64
    values: Float32


class LightMix:
    """Mixes the pictures of a session's views.

    groups: what can be mixed. tracer: None where nothing can be traced. background: trace in
    a thread and answer with the last shares meanwhile, as an editor wants, instead of waiting.
    revision: grows when there are better shares.
    """

    def __init__(self, groups: Sequence[LightGroup], tracer: LightPictures | None) -> None:
        self.groups = tuple(groups)
        self.tracer = tracer
        self.background = False
        self.revision = 0
        self._images: dict[str, _Images] = {}
        self._ratios: dict[tuple[str, bool], _Ratio] = {}
        self._changed = threading.Condition()
        self._busy = False
        self._next_pass = 0.0
        self._failure: tuple[dict[str, MaterialState], str] | None = None
        self._patience = RETRY_SECONDS

    def factors(self, state: State) -> Float64 | None:
        """The mix of a state, float64 [lights, 3], or None where every light is as it was."""
        found = mix(self.groups, state)
        return None if (found == 1.0).all() else found

    def ready(self, view: str, state: State) -> bool:
        """Whether `applied` answers at once; begins what it would wait for."""
        if self.factors(state) is None or not self.background:
            return True
        materials = unmixed(self.groups, state)
        self._refine(view, materials)
        with self._changed:
            return view in self._images or self._failed(materials) is not None

    def prepare(self, view: str, state: State) -> None:
        """Trace in the background what the first change of the mix will want."""
        if self.background and self.tracer is not None and len(self.groups) > 1:
            with self._changed:
                begun = (
                    view in self._images or self._failed(unmixed(self.groups, state)) is not None
                )
            if not begun:
                self._refine(view, unmixed(self.groups, state))

    def notice(self, view: str, state: State) -> str:
        """What is not exact about a mixed picture, in a sentence, or ""."""
        images = self._images.get(view)
        if self.factors(state) is None:
            return ""
        if images is None:
            return "What each light adds is being traced; the picture waits for it."
        if images.materials != unmixed(self.groups, state):
            return "Lights are mixed by their shares under earlier materials; new ones are traced."
        return ""

    def applied(self, view: str, picture: Float32, state: State, emission: bool = False) -> Float32:
        """A picture under the mix of a state: float32 [height, width, 3], linear RGB.

        emission: the picture is of directly seen emission alone. Raises MissingRayTracer
        where no shares can be traced, and what tracing raises.
        """
        factors = self.factors(state)
        if factors is None:
            return picture
        return picture * self._ratio(view, factors, self._for(view, state), emission)

    # -- shares -----------------------------------------------------------------------------

    def _ratio(self, view: str, factors: Float64, images: _Images, emission: bool) -> Float32:
        """Σ_g m_g s_g, kept from frame to frame: float32 [height, width, 3]."""
        known = self._ratios.get((view, emission))
        if known is None or known.images is not images or (known.factors != factors).any():
            of = images.emission if emission else images.images
            known = _Ratio(images, factors, ratio(of, factors))
            self._ratios[view, emission] = known
        return known.values

    def _for(self, view: str, state: State) -> _Images:
        """The images to mix by: of these materials, or in the background the latest."""
        materials = unmixed(self.groups, state)
        if self.background:
            self._refine(view, materials)
            with self._changed:
                self._changed.wait_for(lambda: view in self._images or not self._busy)
                failure, images = self._failed(materials), self._images.get(view)
            if failure is not None:
                raise SceneError(failure)
            if images is not None:
                return images
        images = self._images.get(view)
        if images is None or images.materials != materials:
            images = self._images[view] = self._traced(view, materials, WAITED_SAMPLES, 0)
        return images

    def _traced(
        self, view: str, materials: dict[str, MaterialState], spp: int, seed: int
    ) -> _Images:
        if self.tracer is None:
            raise MissingRayTracer(
                "mixing the lights of this bundle needs its scene and Mitsuba, to trace what each "
                "light adds; or bake it with --light-groups"
            )
        found = self.tracer.light_pictures(materials, view, self.groups, spp, seed)
        return _Images(materials, spp, *found)

    def _failed(self, materials: dict[str, MaterialState]) -> str | None:
        """Why images of these materials could not be traced."""
        failure = self._failure
        return failure[1] if failure is not None and failure[0] == materials else None

    # -- in the background ------------------------------------------------------------------

    def _refine(self, view: str, materials: dict[str, MaterialState]) -> None:
        """Begin a pass in a thread where one is due and none is going on."""
        with self._changed:
            images = self._images.get(view)
            same = images is not None and images.materials == materials
            enough = same and images is not None and images.samples >= ENOUGH_SAMPLES
            later = same and time.monotonic() < self._next_pass
            waits = self._failed(materials) is not None and time.monotonic() < self._next_pass
            if self._busy or enough or later or waits:
                return
            self._busy = True
            samples = images.samples if same and images is not None else 0
        self._start(lambda: self._pass(view, materials, samples))

    @staticmethod
    def _start(work: Callable[[], None]) -> None:
        threading.Thread(target=work, name="burnish-lights", daemon=True).start()

    def _pass(self, view: str, materials: dict[str, MaterialState], seed: int) -> None:
        failure, fresh, start = "", None, time.monotonic()
        try:
            fresh = self._traced(view, materials, PASS_SAMPLES, seed)
        except BurnishError as error:
            failure = str(error)
        except Exception as error:  # noqa: BLE001 - a thread's end: the session says it
            failure = f"{type(error).__name__}: {error}"
        with self._changed:
            self._busy = False
            # What only refines leaves two thirds of the time to the picture itself
            self._next_pass = 3 * time.monotonic() - 2 * start
            if fresh is None:
                # A tracing process that ended comes back; a scene that is gone rarely does
                self._next_pass = time.monotonic() + self._patience
                self._patience *= 2
                self._failure = materials, failure
            else:
                self._patience = RETRY_SECONDS
                known = self._images.get(view)
                if known is not None and known.materials == materials:
                    fresh = known.joined(fresh)
                self._images[view] = fresh
                self._failure = None
            self.revision += 1
            self._changed.notify_all()


def ratio(images: Float32, factors: Float64) -> Float32:
    """Σ_g m_g s_g with s_g each light's share: float32 [height, width, 3].

    images: float32 [lights, height, width, 3]; negative values, which some filters make, count
    as 0. Where there is no light at all, the shares are those of the whole picture.
    """
    light = np.maximum(images, 0.0)
    total = light.sum(axis=0)
    narrow = factors.astype(np.float32)
    mixed = np.einsum("ghwc,gc->hwc", light, narrow)
    whole = light.sum(axis=(1, 2), dtype=np.float64)
    all_of_it = whole.sum(axis=0)
    shares = np.divide(whole, all_of_it, out=np.zeros_like(whole), where=all_of_it > 0)
    # A channel without any light has no shares: all lights count alike
    shares[:, all_of_it <= 0] = 1 / len(factors)
    usual = (shares * factors).sum(axis=0).astype(np.float32)
    result = np.broadcast_to(usual, mixed.shape).copy()
    np.divide(mixed, total, out=result, where=total > 0)
    return result
