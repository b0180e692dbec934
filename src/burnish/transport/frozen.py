"""The frozen form: data in which only a set of target objects is still symbolic.

This is the waist of burnish. Baked bundles, live passes and relighting each make one;
`burnish.runtime` turns it into images and gradients without knowing which.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from burnish.core.types import Float32, Float64, Int32
from burnish.transport.basis import Basis, ColumnSlice, State
from burnish.transport.expansion import Expansion
from burnish.transport.rows import Rows


@dataclass
class FrozenPart:
    """Rows that meet one object first, with everything but the targets contracted.

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


@dataclass
class Powers:
    """Which tails are still symbolic: each a product of target variables.

    exponents: int32 [powers, target variables]; variables: int32, indices into
    `Basis.variables`; coarse: int32 [powers], index into `Basis.coarse` of the target's
    coarse column, or -1 for none.
    """

    exponents: Int32
    variables: Int32
    coarse: Int32

    def evaluate(self, basis: Basis, state: State) -> Float64:
        """The factor of each power: float64 [powers, 3]."""
        albedos = basis.albedos(state)[self.variables]
        result = (albedos[None, :, :] ** self.exponents[:, :, None]).prod(axis=1)
        with_coarse = self.coarse >= 0
        if with_coarse.any():
            result[with_coarse] *= basis.coarse_values(state)[self.coarse[with_coarse]]
        return np.asarray(result)


@dataclass
class Frozen:
    """B = base + Σ_parts s(θo) · Σ_c Σ_n F[:, c, n] · coefficient_c · power_n (2008, eq. 28).

    base: float32 [pixels, 3]: light with nothing symbolic in it, directly seen emission
    included. revision grows while the estimate refines. targets: object indices.
    """

    basis: Basis
    targets: tuple[int, ...]
    width: int
    height: int
    base: Float32
    powers: Powers
    parts: list[FrozenPart] = field(default_factory=list)
    revision: int = 0


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
        """Directly seen emission: float32 [height, width, 3], linear RGB."""
        ...

    @property
    def revision(self) -> int: ...
    def freeze(self, targets: tuple[int, ...], state: State) -> Frozen: ...
