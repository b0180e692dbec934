"""Object freezing: contract everything that the chosen targets do not keep symbolic.

2008, section 5.2, eq. 27–28, for any set of targets and for the slower series of eq. 29.
With A[z, n] the product of the *other* objects' factors of tail z (a product, never the
quotient d^z / d_i^n, so that an albedo of 0 is an ordinary value),

    F[r, c, n] = Σ_z T[r, c, z] A[z, n],        V[r, n] = Σ_c s_c(r) coefficient_c F[r, c, n],

F for rows that first meet a target and V for all others. Both are contracted in
compressed form: the tails through S, then the columns, and the rows at the end; a target's
rows stay in the directions of their blocks, for a frame to expand.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np

from burnish.core.errors import InvalidValue, TooLarge
from burnish.core.parallel import parallel_map
from burnish.core.types import Float32, Int32
from burnish.transport.basis import Basis, ColumnSlice, State
from burnish.transport.expansion import Expansion
from burnish.transport.frozen import Frozen, FrozenPart, Powers
from burnish.transport.lights import base_under, over_lights
from burnish.transport.pack import BlockSource, Pack
from burnish.transport.rows import Rows

_CHUNK = 1 << 15
"""Entries of a pack's last axis that are widened to float32 at a time, to stay in cache."""


@dataclass
class BakedTransport:
    """A `Transport` over stored blocks: freezing contracts them.

    memory: the bytes of F that a freeze may make; None for half of the machine's.
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

    def freeze(self, targets: tuple[int, ...], state: State) -> Frozen:
        return freeze(self.source, targets, state, self.memory)


def freeze(
    source: BlockSource,
    targets: Sequence[int],
    state: State,
    memory: int | None = None,
) -> Frozen:
    """Freeze a view for a set of targets (indices into `Basis.objects`, in any order).

    state: the materials of all objects; those of the targets do not matter.
    Raises InvalidValue for a target out of range, TooLarge when F would need more than
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
    rows = source.rows
    alike: dict[tuple[int, bool, int], list[Pack]] = {}
    for pack in source.packs():
        alike.setdefault((pack.object, pack.indirect, pack.start), []).append(pack)
    _check_memory(basis, list(alike.values()), chosen, len(powers.exponents), memory)

    base, parts = base_under(basis, powers, source.base, state)
    for (index, _, _), members in sorted(alike.items()):
        contract = _keep_columns if index in chosen else _contract_columns
        parts.append(contract(basis, rows, members, factors, state))
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


def _contract_tails(pack: Pack, factors: Float32) -> Float32:
    """S · A of every block of a pack: float32 [3, Σ b, powers]."""
    z, n, _ = factors.shape
    product = pack.S.astype(np.float32) @ factors.transpose(0, 2, 1).reshape(z, 3 * n)
    return np.ascontiguousarray(product.reshape(-1, 3, n).transpose(1, 0, 2))


def _columns_of(basis: Basis, pack: Pack) -> ColumnSlice:
    """The columns of a pack, as a run of its object's that shares one outgoing factor."""
    slices = basis.indirect_slices if pack.indirect else basis.slices
    whole = next(piece for piece in slices(pack.object) if pack.start < piece.stop)
    return replace(whole, start=pack.start, stop=pack.start + len(pack.column_scale))


def _keep_columns(
    basis: Basis, rows: Rows, packs: list[Pack], factors: Float32, state: State
) -> FrozenPart:
    """F of a target's rows, for the columns that the packs share.

    In the blocks' own row directions where that is smaller, as it is for wide columns.
    """
    columns = _columns_of(basis, packs[0])
    members, starts = _members(packs)
    n = factors.shape[1]
    by_row, by_direction = _sizes(packs, n)
    expanded = by_row <= by_direction
    if not expanded:
        directions = [int(pack.shape[:, 1].sum()) for pack in packs]
        starts = [0, *accumulate(directions)]
    count = len(members) if expanded else starts.pop()
    F = np.empty((3, count, (columns.stop - columns.start) * n), np.float32)

    def work(pack: Pack, first: int) -> None:
        tails = _contract_tails(pack, factors)
        scale = pack.column_scale[None, :, None, None]
        for k, (r, a, b) in enumerate(pack.shape):
            at, end = pack.offsets[k], pack.offsets[k + 1]
            core = pack.core[:, :, at[2] : end[2]].astype(np.float32).reshape(3, -1, b)
            G = (core @ tails[:, at[3] : end[3]]).reshape(3, -1, a, n)
            G = np.multiply(G, scale, out=G).transpose(0, 2, 1, 3)
            if expanded:
                U = pack.U[at[1] : end[1]].reshape(r, a)
                np.matmul(U, G.reshape(3, a, -1), out=F[:, first : first + r])
            else:
                F[:, first : first + a].reshape(G.shape)[:] = G
            first += r if expanded else a

    parallel_map(work, packs, starts)
    return FrozenPart(
        object=packs[0].object,
        indirect=packs[0].indirect,
        pixel=rows.pixel[members],
        F=F,
        cos_theta_o=rows.cos_theta_o[members],
        slice=columns,
        expansion=None if expanded else Expansion.of(_row_directions(packs)),
    )


def _row_directions(packs: Sequence[Pack]) -> Iterator[Float32]:
    """U of every block: float32 [r, a]."""
    for pack in packs:
        for k, (r, a, _) in enumerate(pack.shape):
            yield pack.U[pack.offsets[k, 1] : pack.offsets[k + 1, 1]].reshape(r, a)


def _sizes(packs: Sequence[Pack], powers: int) -> tuple[int, int]:
    """Bytes of F by rows, and by the blocks' row directions with what expands them."""
    r = sum(int(pack.shape[:, 0].sum()) for pack in packs)
    a = sum(int(pack.shape[:, 1].sum()) for pack in packs)
    width = 12 * powers * packs[0].core.shape[1]
    return r * width, a * width + sum(pack.U.nbytes for pack in packs)


def _contract_columns(
    basis: Basis, rows: Rows, packs: list[Pack], factors: Float32, state: State
) -> FrozenPart:
    """V of rows that first meet an object that is no target, for columns that packs share."""
    first, columns = packs[0], _columns_of(basis, packs[0])
    members, starts = _members(packs)
    # The columns' coefficients, with their weights undone
    values = basis.column_coefficients(first.object, state, first.indirect)
    values = values[columns.start : columns.stop] * first.column_scale[:, None]
    weights = np.ascontiguousarray(values.T, dtype=np.float32)
    V = np.empty((3, len(members), factors.shape[1]), np.float32)

    def work(pack: Pack, start: int) -> None:
        contracted = _apply_columns(pack.core, weights)
        tails = _contract_tails(pack, factors)
        for k, (r, a, b) in enumerate(pack.shape):
            at, end = pack.offsets[k], pack.offsets[k + 1]
            row = start + int(at[0])
            U = pack.U[at[1] : end[1]].reshape(r, a)
            core = contracted[:, at[2] : end[2]].reshape(3, a, b)
            np.matmul(U, core @ tails[:, at[3] : end[3]], out=V[:, row : row + r])

    parallel_map(work, packs, starts)
    cosines = rows.cos_theta_o[members]
    if not first.indirect:
        factor = basis.outgoing_factor(first.object, state, columns, cosines.astype(np.float64))
        if factor is not None:
            V *= factor.T.astype(np.float32)[:, :, None]
    return FrozenPart(first.object, first.indirect, rows.pixel[members], V, cosines, None)


def _apply_columns(core: np.ndarray, weights: Float32) -> Float32:
    """Σ_c weights[h, c] core[h, c, N], widened chunk by chunk: float32 [3, N]."""
    length = core.shape[2]
    result = np.empty((3, length), np.float32)
    for h in range(3):
        for start in range(0, length, _CHUNK):
            part = core[h, :, start : start + _CHUNK].astype(np.float32)
            result[h, start : start + _CHUNK] = weights[h] @ part
    return result


def _members(packs: Sequence[Pack]) -> tuple[Int32, list[int]]:
    """The rows of all packs in their order, and where each pack starts among them."""
    counts = [len(pack.rows) for pack in packs]
    starts = np.concatenate([[0], np.cumsum(counts)])[:-1]
    return np.concatenate([pack.rows for pack in packs]), [int(start) for start in starts]


def _check_memory(
    basis: Basis,
    alike: Sequence[list[Pack]],
    targets: tuple[int, ...],
    powers: int,
    memory: int | None,
) -> None:
    """Refuse a freeze whose F would not fit."""
    need = 0
    for packs in alike:
        if packs[0].object in targets:
            need += min(_sizes(packs, powers))
        else:
            need += 12 * powers * sum(len(pack.rows) for pack in packs)
    limit = memory if memory is not None else _machine_memory() // 2
    if need > limit:
        names = ", ".join(basis.objects[target].id for target in targets)
        raise TooLarge(
            f"selecting {names} together needs {need / 1e9:.1f} GB and at most "
            f"{limit / 1e9:.1f} GB may be used: select fewer objects at a time"
        )


def _machine_memory() -> int:
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return 8 << 30
