"""Object freezing: contract everything that the chosen targets do not keep symbolic.

2008, section 5.2, eq. 27–28, for any set of targets and for the slower series of eq. 29.
With A[z, n] the product of the *other* objects' factors of tail z (a product, never the
quotient d^z / d_i^n, so that an albedo of 0 is an ordinary value),

    F[r, c, n] = Σ_z T[r, c, z] A[z, n],        V[r, n] = Σ_c s_c(r) coefficient_c F[r, c, n],

F for rows that first meet a target and V for all others. All is contracted in compressed
form: the tails through S, then the columns, and the rows at the end. F itself is never made:
a target's blocks are smaller, and a frame contracts their columns as fast (`FoldedPart`).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from burnish.core.errors import InvalidValue, TooLarge
from burnish.core.parallel import parallel_map
from burnish.core.types import Float32, Float64
from burnish.transport.basis import Basis, ColumnSlice, State
from burnish.transport.contraction import Contracted, contract, fold, meet_tails
from burnish.transport.expansion import blank, flattened
from burnish.transport.frozen import FoldedPart, Frozen, FrozenPart, Powers
from burnish.transport.lights import base_under, over_lights
from burnish.transport.pack import BlockSource
from burnish.transport.rows import Rows
from burnish.transport.stack import Stack

_LINES = 32
"""Lines of a picture that one task transposes."""


@dataclass
class BakedTransport:
    """A `Transport` over stored blocks: freezing contracts them.

    memory: the bytes that a freeze may make; None for half of the machine's.
    """

    source: BlockSource
    memory: int | None = None

    @property
    def basis(self) -> Basis:
        return self.source.basis

    @property
    def rows(self) -> Rows:
        return self.source.rows

    @property
    def width(self) -> int:
        return self.source.width

    @property
    def height(self) -> int:
        return self.source.height

    @property
    def emission(self) -> Float32:
        return self.source.emission

    @property
    def revision(self) -> int:
        return self.source.revision

    def freeze(self, targets: tuple[int, ...], state: State, fine: tuple[int, ...] = ()) -> Frozen:
        return freeze(self.source, targets, state, self.memory, fine)


def freeze(
    source: BlockSource,
    targets: Sequence[int],
    state: State,
    memory: int | None = None,
    fine: Sequence[int] = (),
) -> Frozen:
    """Freeze a view for a set of targets (indices into `Basis.objects`, in any order).

    state: the materials of all objects; those of the targets do not matter. fine: objects
    whose own rows keep their columns though they are numbers from the second encounter on.
    Raises InvalidValue for a target out of range, TooLarge when V would need more than
    `memory` bytes (None: half of the machine's memory).
    """
    basis = source.basis
    chosen = tuple(sorted(set(targets)))
    if any(not 0 <= target < len(basis.objects) for target in chosen):
        raise InvalidValue(
            f"targets must lie in [0, {len(basis.objects) - 1}]; got {tuple(targets)}"
        )
    powers, factors = tail_factors(basis, chosen, state)
    powers, factors = over_lights(basis, powers, factors, state, symbolic=not chosen)
    stacks = source.stacks()
    kept = [
        stack.object in chosen or (stack.object in fine and not stack.indirect) for stack in stacks
    ]
    others = [stack for stack, own in zip(stacks, kept, strict=True) if not own]
    pixels = source.width * source.height
    if others:
        _check_memory(basis, chosen, len(powers.exponents), pixels, memory)

    base, first = base_under(basis, powers, source.base, state)
    own = [stack for stack, own in zip(stacks, kept, strict=True) if own]
    parts: list[FrozenPart | FoldedPart] = list(first)
    parts += parallel_map(
        lambda stack: FoldedPart.of(stack, _columns_of(basis, stack), factors), own
    )
    if others:
        parts.append(
            _contract_columns(basis, others, factors, state, (source.width, source.height))
        )
    return Frozen(
        basis=basis,
        targets=chosen,
        width=source.width,
        height=source.height,
        base=base,
        powers=powers,
        parts=parts,
        revision=source.revision,
    )


def tail_factors(basis: Basis, targets: tuple[int, ...], state: State) -> tuple[Powers, Float32]:
    """What stays symbolic of each tail, and the number that the rest of it becomes.

    Returns the distinct powers n and A: float32 [light_tails, powers, 3], with one power of
    each tail not zero: the product of the factors that belong to no target.
    """
    ours = np.array([v for v, (i, _) in enumerate(basis.variables) if i in targets], np.int32)
    others = np.ones((len(basis.variables), 3))
    albedos = basis.albedos(state)
    is_other = np.ones(len(basis.variables), bool)
    is_other[ours] = False
    others[is_other] = albedos[is_other]

    # Split each monomial into the targets' exponents and the others' product
    exponents = basis.monomials.exponents[:, ours]
    numbers = basis.monomials.evaluate(others)
    coarse = np.full(len(exponents), -1, np.int32)

    # Put a coarse column in front where the series has them; tail 0 then stands for 1
    if basis.coarse:
        values = basis.coarse_values(state)
        symbolic = np.array([i in targets for i, _, _ in basis.coarse])
        values[symbolic] = 1.0
        column = np.where(symbolic, np.arange(len(values)), -1)
        monomials, columns = len(exponents), len(values)
        exponents = np.concatenate(
            [np.zeros((1, len(ours)), np.int32), np.tile(exponents, (columns, 1))]
        )
        numbers = np.concatenate(
            [np.ones((1, 3)), (values[:, None] * numbers[None]).reshape(-1, 3)]
        )
        coarse = np.concatenate([[-1], np.repeat(column, monomials)]).astype(np.int32)

    keys = np.concatenate([coarse[:, None], exponents], axis=1)
    distinct, where = np.unique(keys, axis=0, return_inverse=True)
    factors = np.zeros((len(keys), len(distinct), 3), np.float32)
    factors[np.arange(len(keys)), where.ravel()] = numbers
    powers = Powers(
        exponents=distinct[:, 1:].astype(np.int32),
        variables=ours,
        coarse=distinct[:, 0].astype(np.int32),
    )
    return powers, factors


def _columns_of(basis: Basis, stack: Stack) -> ColumnSlice:
    """The columns of a stack, as a run of its object's that shares one outgoing factor."""
    slices = basis.indirect_slices if stack.indirect else basis.slices
    whole = next(piece for piece in slices(stack.object) if stack.start < piece.stop)
    return replace(whole, start=stack.start, stop=stack.start + stack.columns)


def _contract_columns(
    basis: Basis,
    stacks: list[Stack],
    factors: Float32,
    state: State,
    size: tuple[int, int],
) -> FrozenPart:
    """V of all rows that first meet an object that is no target, added up by pixel.

    size: width and height of the view.
    """
    width, height = size
    z, n, _ = factors.shape
    lit: list[tuple[Stack, ColumnSlice, Float64]] = []
    for stack in stacks:
        piece = _columns_of(basis, stack)
        own = basis.column_coefficients(stack.object, state, stack.indirect)
        # A layer without weight adds nothing
        if own[piece.start : piece.stop].any():
            lit.append((stack, piece, own[piece.start : piece.stop]))
    by_channel = factors.transpose(0, 2, 1).reshape(z, 3 * n)

    def folded(stack: Stack, found: Contracted) -> Float32:
        cells, peak = found
        tails = meet_tails(stack, by_channel).reshape(3, n, -1)
        tails *= peak[:, None, None]
        return fold(stack, cells, tails).reshape(3 * n, -1)

    cells = contract([stack for stack, _, _ in lit], [weights for _, _, weights in lit])
    latents = parallel_map(folded, [stack for stack, _, _ in lit], cells)
    picture = blank(width, height, 3 * n)
    for (stack, piece, _), latent in zip(lit, latents, strict=True):
        stack.expansion.add(latent, picture, _outgoing(basis, stack, piece, state, n))
    planes = _planes(flattened(picture)[:height, :width])
    return FrozenPart(
        object=-1,
        indirect=False,
        pixel=np.arange(width * height, dtype=np.int32),
        F=planes.reshape(3, n, -1).transpose(0, 2, 1),
        cos_theta_o=np.ones(width * height, np.float32),
        slice=None,
    )


def _outgoing(
    basis: Basis, stack: Stack, piece: ColumnSlice, state: State, powers: int
) -> Float32 | None:
    """s(θo) of a stack's rows, once for every power: float32 [r, 3 · powers], or None for 1."""
    if stack.indirect:
        return None
    cosines = stack.cos_theta_o.astype(np.float64)
    factor = basis.outgoing_factor(stack.object, state, piece, cosines)
    if factor is None:
        return None
    by_row = np.broadcast_to(factor, (len(factor), 3)).astype(np.float32)
    return np.repeat(by_row, powers, axis=1)


def _planes(picture: Float32) -> Float32:
    """Pixel by pixel [height, width, q] to plane by plane: float32 [q, height, width]."""
    height, width, q = picture.shape
    result = np.empty((q, height, width), np.float32)

    def work(start: int) -> None:
        # A line at a time stays in cache
        for y in range(start, min(start + _LINES, height)):
            result[:, y] = picture[y].T

    parallel_map(work, range(0, height, _LINES))
    return result


def _check_memory(
    basis: Basis, targets: tuple[int, ...], powers: int, pixels: int, memory: int | None
) -> None:
    """Refuse a freeze whose V, made once by pixel and once by power, would not fit."""
    need = 24 * powers * pixels
    limit = memory if memory is not None else machine_memory() // 2
    if need > limit:
        names = ", ".join(basis.objects[target].id for target in targets)
        raise TooLarge(
            f"selecting {names} together needs {need / 1e9:.1f} GB and at most "
            f"{limit / 1e9:.1f} GB may be used: select fewer objects at a time"
        )


def machine_memory() -> int:
    """Bytes of the machine's memory."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return 8 << 30
