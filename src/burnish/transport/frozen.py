"""The frozen form: data in which only a set of target objects is still symbolic.

This is the waist of burnish. Baked bundles, live passes and relighting each make one;
`burnish.runtime` turns it into images and gradients without knowing which.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from burnish.core.types import Float32, Float64, Int32
from burnish.materials.lights import mix
from burnish.transport.basis import Basis, ColumnSlice, State
from burnish.transport.contraction import meet_tails, with_tails
from burnish.transport.expansion import Expansion
from burnish.transport.rows import Rows
from burnish.transport.stack import Stack


@dataclass
class FrozenPart:
    """Rows that meet one object first (object -1: any, added up), with everything but the
    targets contracted.

    pixel: int32 [r], unique within the part. F is float32 [3, r, columns · powers] with
    columns those of `slice` when the object is a target, else [3, r, powers] (2008's F and
    V; the powers run fastest). With an `expansion` F has its directions instead of rows, and
    what F is contracted to is expanded to the rows. cos_theta_o: float32 [r], for the
    slice's outgoing factor.
    """

    object: int
    indirect: bool
    pixel: Int32
    F: Float32
    cos_theta_o: Float32
    slice: ColumnSlice | None
    """None for rows of an object that is not a target."""
    expansion: Expansion | None = None

    @property
    def nbytes(self) -> int:
        """What a frame reads of it."""
        return self.F.nbytes + (self.expansion.nbytes if self.expansion else 0)

    def dense(self) -> FrozenPart:
        """Itself; see `FoldedPart.dense`."""
        return self


@dataclass
class FoldedPart:
    """Rows of a target as their blocks hold them, with no F of their own: a frame reads the
    blocks, which are smaller than F would be, and a freeze need not make it.

    slice: the columns of the stack. factors: float32 [z, powers, 3], what each tail adds to
    each power. tails: float32 [3, powers, tail directions], the stack's S times them; None
    where the powers are so many that it would be larger than S.
    """

    stack: Stack
    slice: ColumnSlice
    factors: Float32
    tails: Float32 | None

    @property
    def object(self) -> int:
        return self.stack.object

    @property
    def indirect(self) -> bool:
        return self.stack.indirect

    @property
    def pixel(self) -> Int32:
        return self.stack.pixel

    @property
    def cos_theta_o(self) -> Float32:
        return self.stack.cos_theta_o

    @property
    def nbytes(self) -> int:
        """What a frame reads of it."""
        tails = self.stack.S if self.tails is None else self.tails
        return self.stack.core.nbytes + tails.nbytes + self.stack.expansion.nbytes

    @staticmethod
    def of(stack: Stack, piece: ColumnSlice, factors: Float32) -> FoldedPart:
        """A stack with the factors of its tails."""
        few = 3 * factors.shape[1] < len(factors)
        return FoldedPart(stack, piece, factors, _tails(stack, factors) if few else None)

    def tails_under(self, powers: Float64) -> Float32:
        """The tail directions for powers [n, 3]: float32 [3, tail directions]."""
        narrow = powers.astype(np.float32)
        if self.tails is None:
            return meet_tails(self.stack, np.einsum("znh,nh->zh", self.factors, narrow))
        return np.asarray(np.einsum("hnb,nh->hb", self.tails, narrow))

    def dense(self) -> FrozenPart:
        """The same with F, in the blocks' row directions."""
        F = with_tails(self.stack, _tails(self.stack, self.factors))
        return FrozenPart(
            self.object,
            self.indirect,
            self.pixel,
            F.reshape(*F.shape[:2], -1),
            self.cos_theta_o,
            self.slice,
            self.stack.expansion,
        )


def _tails(stack: Stack, factors: Float32) -> Float32:
    """S times the factors of the tails: float32 [3, powers, tail directions]."""
    z, n, _ = factors.shape
    return meet_tails(stack, factors.transpose(0, 2, 1).reshape(z, 3 * n)).reshape(3, n, -1)


@dataclass
class Powers:
    """Which tails are still symbolic: each a product of target variables, of one light group
    where the mix of the lights is symbolic too.

    exponents: int32 [powers, target variables]; variables: int32, indices into
    `Basis.variables`; coarse: int32 [powers], index into `Basis.coarse` of the target's
    coarse column, or -1 for none. lights: int32 [powers], index into `Basis.lights`; empty
    where the mix is not symbolic.
    """

    exponents: Int32
    variables: Int32
    coarse: Int32
    lights: Int32 = field(default_factory=lambda: np.zeros(0, np.int32))

    def evaluate(self, basis: Basis, state: State) -> Float64:
        """The factor of each power: float64 [powers, 3]."""
        albedos = basis.albedos(state)[self.variables]
        result = (albedos[None, :, :] ** self.exponents[:, :, None]).prod(axis=1)
        with_coarse = self.coarse >= 0
        if with_coarse.any():
            result[with_coarse] *= basis.coarse_values(state)[self.coarse[with_coarse]]
        if len(self.lights):
            result *= mix(basis.lights, state)[self.lights]
        return np.asarray(result)


@dataclass
class Frozen:
    """B = base + Σ_parts s(θo) · Σ_c Σ_n F[:, c, n] · coefficient_c · power_n (2008, eq. 28).

    base: float32 [pixels, 3]: light with nothing symbolic in it, directly seen emission
    included. revision grows while the estimate refines. targets: object indices. in_place:
    newer estimates are written over F, and the next form's lies where this one's does.
    """

    basis: Basis
    targets: tuple[int, ...]
    width: int
    height: int
    base: Float32
    powers: Powers
    parts: list[FrozenPart | FoldedPart] = field(default_factory=list)
    revision: int = 0
    in_place: bool = False


class Transport(Protocol):
    """Where frozen forms come from: a bundle's view, a live estimate, relighting."""

    @property
    def basis(self) -> Basis: ...
    @property
    def rows(self) -> Rows: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def emission(self) -> Float32:
        """Directly seen emission: float32 [height, width, 3], linear RGB; for each light group
        [lights, height, width, 3] where the basis tells them apart."""
        ...

    @property
    def revision(self) -> int: ...
    def freeze(self, targets: tuple[int, ...], state: State, fine: tuple[int, ...] = ()) -> Frozen:
        """fine: further objects whose rows that are met first keep their columns."""
        ...
