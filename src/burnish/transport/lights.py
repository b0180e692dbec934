"""Light groups in stored transport: one more axis, outermost on the tails, contracted first.

Tail g · Z + z is tail z of light group g, so T[g] has the shape of a transport without groups,
and T = Σ_g m_g T[g] is the transport under the mix m. With a material still symbolic, the mix
goes into the factors of the tails, and what is frozen is no larger than without groups. With
nothing else symbolic, the mix itself stays so: a power for each group, to be mixed per frame.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from burnish.core.types import Float32
from burnish.materials.lights import mix
from burnish.transport.basis import Basis, State
from burnish.transport.frozen import FrozenPart, Powers


def over_lights(
    basis: Basis, powers: Powers, factors: Float32, state: State, symbolic: bool
) -> tuple[Powers, Float32]:
    """Factors of all tails from those of one light group's.

    factors: float32 [light_tails, powers, 3]. symbolic: keep a power for each group instead
    of taking the mix from `state`. Returns the powers and float32 [tails, powers, 3].
    """
    count = len(basis.lights)
    if count == 0:
        return powers, factors
    z, n, _ = factors.shape
    if not symbolic:
        mixed = mix(basis.lights, state).astype(np.float32)[:, None, None, :] * factors[None]
        return powers, mixed.reshape(count * z, n, 3)
    apart = np.zeros((count, z, count, n, 3), np.float32)
    apart[np.arange(count), :, np.arange(count)] = factors
    return of_each_light(powers, count), apart.reshape(count * z, count * n, 3)


def of_each_light(powers: Powers, count: int) -> Powers:
    """The powers once for every light group, group by group."""
    return replace(
        powers,
        exponents=np.tile(powers.exponents, (count, 1)),
        coarse=np.tile(powers.coarse, count),
        lights=np.repeat(np.arange(count, dtype=np.int32), len(powers.coarse)),
    )


def mixed(basis: Basis, by_light: Float32, state: State) -> Float32:
    """Pictures of each light group [lights, height, width, 3] as one [height, width, 3]."""
    factors = mix(basis.lights, state).astype(np.float32)
    return np.asarray(np.einsum("ghwc,gc->hwc", by_light, factors))


def base_under(
    basis: Basis, powers: Powers, base: Float32, state: State
) -> tuple[Float32, list[FrozenPart]]:
    """Light with no material symbolic in it, under the mix: float32 [pixels, 3], and parts.

    base: float32 [height, width, 3], or [lights, height, width, 3]. Where the mix is symbolic
    it is one part of a frozen form, and nothing else.
    """
    if not basis.lights:
        return base.reshape(-1, 3), []
    if not len(powers.lights):
        return mixed(basis, base, state).reshape(-1, 3), []
    by_light = base.reshape(len(basis.lights), -1, 3)
    pixels = by_light.shape[1]
    V = np.zeros((3, pixels, len(powers.coarse)), np.float32)
    plain = (powers.coarse < 0) & ~powers.exponents.any(axis=1)
    V[:, :, plain] = by_light[powers.lights[plain]].transpose(2, 1, 0)
    part = FrozenPart(
        object=-1,
        indirect=True,
        pixel=np.arange(pixels, dtype=np.int32),
        F=V,
        cos_theta_o=np.ones(pixels, np.float32),
        slice=None,
    )
    return np.zeros((pixels, 3), np.float32), [part]
