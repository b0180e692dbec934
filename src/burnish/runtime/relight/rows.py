"""What rows receive: I = D L + c(γ)ᵀ T L (2010, eq. 7), block by block.

Blocks are small enough to be read as they are in every frame: nothing needs to be frozen for
a light that moves.
"""

from __future__ import annotations

import numpy as np

from burnish.core.parallel import parallel_map
from burnish.core.types import Float32
from burnish.transport.basis import Basis, State
from burnish.transport.gather import Blocks, GatherData, GatherView, RowTransfer, Transfer

_AT_ONCE = 32
"""Blocks that one task contracts."""


def apply(transfer: Transfer, nodes: Float32, coefficients: Float32) -> Float32:
    """Σ_c coefficient_c T_c L: float32 [rows, q].

    nodes: L's means over nodes [n, q]. coefficients: float32 [columns, q].
    """
    result = np.zeros((transfer.rows + 1, nodes.shape[1]), np.float32)

    def work(blocks: Blocks, start: int) -> None:
        some = slice(start, start + _AT_ONCE)
        light = nodes[blocks.node[some]]
        light *= coefficients[blocks.column[some]]
        result[blocks.rows[some]] = blocks.U[some] @ (blocks.S[some] @ light)

    tasks = [
        (blocks, start) for blocks in transfer.blocks for start in range(0, len(blocks.U), _AT_ONCE)
    ]
    if tasks:
        parallel_map(work, *zip(*tasks, strict=True))
    return result[:-1]


def apply_open(transfer: Transfer, nodes: Float32) -> Float32:
    """T L with the columns apart: float32 [rows, columns, q]."""
    q = nodes.shape[1]
    result = np.zeros((transfer.rows + 1, transfer.columns, q), np.float32)

    def work(blocks: Blocks, start: int) -> None:
        for k in range(start, min(start + _AT_ONCE, len(blocks.U))):
            light = nodes[blocks.node[k]]
            bounds = np.searchsorted(blocks.column[k], np.arange(transfer.columns + 1))
            latent = np.zeros((blocks.U.shape[2], transfer.columns, q), np.float32)
            for c in range(transfer.columns):
                own = slice(int(bounds[c]), int(bounds[c + 1]))
                if own.start < own.stop:
                    latent[:, c] = blocks.S[k, :, own] @ light[own]
            flat = blocks.U[k] @ latent.reshape(len(latent), -1)
            result[blocks.rows[k]] = flat.reshape(-1, transfer.columns, q)

    tasks = [
        (blocks, start) for blocks in transfer.blocks for start in range(0, len(blocks.U), _AT_ONCE)
    ]
    if tasks:
        parallel_map(work, *zip(*tasks, strict=True))
    return result[:-1]


def indirect(data: GatherData, view: GatherView, light: Float32, state: State) -> Float32:
    """Indirect light of a view with all materials as in a state: float32 [h, w, 3].

    light: L of the cells, float32 [g, 3].
    """
    nodes = data.tree.means(light)
    picture = np.zeros((view.height * view.width, 3), np.float32)
    for part in view.parts:
        received = row_light(data.basis, view, part, nodes, state)
        pixel = part.row if part.object < 0 else view.rows.pixel[part.row]
        # A row of an object is a pixel's only one
        picture[pixel] += received
    return picture.reshape(view.height, view.width, 3)


def row_light(
    basis: Basis, view: GatherView, part: RowTransfer, nodes: Float32, state: State
) -> Float32:
    """What the rows of a part send to the camera: float32 [r, 3]."""
    if part.object < 0:
        return apply(part.transfer, nodes, np.eye(3, dtype=np.float32))
    cosines = view.rows.cos_theta_o[part.row].astype(np.float64)
    whole = basis.column_coefficients(part.object, state).astype(np.float32)
    own = [piece for piece in basis.slices(part.object) if piece.layer == part.layer]
    first = own[0].start
    result = np.zeros((len(part.row), 3), np.float32)
    factors = [basis.outgoing_factor(part.object, state, piece, cosines) for piece in own]
    if all(factor is None for factor in factors):
        c = whole[first : own[-1].stop]
        if not c.any():
            return result
        return apply(part.transfer, nodes, c) * part.tint
    for piece, factor in zip(own, factors, strict=True):
        c = np.zeros((part.transfer.columns, 3), np.float32)
        c[piece.start - first : piece.stop - first] = whole[piece.start : piece.stop]
        if not c.any():
            continue
        light = apply(part.transfer, nodes, c)
        result += light if factor is None else light * factor.astype(np.float32)
    return result * part.tint
