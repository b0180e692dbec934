"""Pictures under changed lights and materials at once: the evaluation of `GatherData`.

    L = Σ_n (M_s)^n L_d        (2010, eq. 16–17),        I = D L + c(γ)ᵀ T L        (eq. 7)

The albedos of edited objects may stay open: L is then a polynomial in them, one L for each of
its monomials, and so is the frozen form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from burnish.core.parallel import parallel_map
from burnish.core.types import Float32, Float64
from burnish.transport.basis import Basis, State
from burnish.transport.gather import (
    Blocks,
    GatherData,
    GatherSamples,
    GatherView,
    RowTransfer,
    Transfer,
)
from burnish.transport.monomials import Monomials

_AT_ONCE = 32
"""Blocks that one task contracts."""


@dataclass(frozen=True)
class CellLight:
    """The radiance of cells, for each monomial z of the open albedos: float32 [z, g, 3]."""

    monomials: Monomials
    radiance: Float32


def cell_light(
    data: GatherData, irradiance: Float32, state: State, open_variables: tuple[int, ...] = ()
) -> CellLight:
    """L of all cells under a direct irradiance float32 [g, p, 3] at their points.

    open_variables: of the basis, those whose albedo stays symbolic. Bounces are the basis's: the
    last one is the row's own.
    """
    basis, samples = data.basis, data.samples
    further = basis.bounces - 2
    monomials = Monomials(len(open_variables), max(basis.bounces - 1, 0))
    albedos = basis.albedos(state)
    reflected = _Reflection(samples, albedos, open_variables, monomials)
    if further < 0:
        return CellLight(monomials, np.zeros((len(monomials), len(samples), 3), np.float32))
    direct = np.zeros((len(monomials), len(samples), 3), np.float32)
    light = reflected.direct(irradiance / np.float32(np.pi), direct)
    total = light.copy()
    for _ in range(further):
        light = reflected.again(_gathered(data, light))
        total += light
    return CellLight(monomials, total)


class _Reflection:
    """M_s's albedos: what cells make of the light that they receive."""

    def __init__(
        self,
        samples: GatherSamples,
        albedos: Float64,
        open_variables: tuple[int, ...],
        monomials: Monomials,
    ) -> None:
        self.samples, self.monomials = samples, monomials
        position = {v: k for k, v in enumerate(open_variables)}
        # By group: a number for each cell and, where the albedo is open, which variable
        self.numbers, self.open = [], []
        for k in range(samples.variable.shape[1]):
            variable = samples.variable[:, k]
            values = np.zeros((len(samples), 3), np.float32)
            values[variable >= 0] = albedos[variable[variable >= 0]]
            which = np.array([position.get(int(v), -1) for v in range(len(albedos))], np.int32)
            symbolic = np.where(variable >= 0, which[variable], -1)
            values[symbolic >= 0] = 1.0
            self.numbers.append(values)
            self.open.append(symbolic)
        self.mean = samples.reflects.mean(axis=1)
        self.fixed = samples.fixed.mean(axis=1)

    def direct(self, light: Float32, result: Float32) -> Float32:
        """Of light [g, p, 3] at the points, which the weight maps meet point by point."""
        points = light.shape[1]
        result[0] += np.einsum("gph,gph->gh", self.samples.fixed, light) / points
        for k, (number, symbolic) in enumerate(zip(self.numbers, self.open, strict=True)):
            own = np.einsum("gph,gph->gh", self.samples.reflects[:, :, k], light) / points * number
            self._deposit(result, 0, symbolic, own)
        return result

    def again(self, light: Float32) -> Float32:
        """Of light [z, g, 3], even over a cell."""
        result = np.zeros_like(light)
        for z in range(len(light)):
            result[z] += self.fixed * light[z]
            for k, (number, symbolic) in enumerate(zip(self.numbers, self.open, strict=True)):
                self._deposit(result, z, symbolic, self.mean[:, k] * number * light[z])
        return result

    def _deposit(self, result: Float32, z: int, symbolic: np.ndarray, own: Float32) -> None:
        settled = symbolic < 0
        result[z][settled] += own[settled]
        for v in range(self.monomials.variables):
            further = int(self.monomials.next[z, v])
            if further >= 0:
                which = symbolic == v
                result[further][which] += own[which]


def _gathered(data: GatherData, light: Float32) -> Float32:
    """M L of light [z, g, 3]: float32 [z, g, 3]."""
    z, g, _ = light.shape
    nodes = data.tree.means(light.transpose(1, 0, 2).reshape(g, 3 * z))
    ones = np.ones((1, 3 * z), np.float32)
    return apply(data.bounce, nodes, ones).reshape(g, z, 3).transpose(1, 0, 2)


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
        return apply(part.transfer, nodes, c) * part.tint
    for piece, factor in zip(own, factors, strict=True):
        c = np.zeros((part.transfer.columns, 3), np.float32)
        c[piece.start - first : piece.stop - first] = whole[piece.start : piece.stop]
        light = apply(part.transfer, nodes, c)
        result += light if factor is None else light * factor.astype(np.float32)
    return result * part.tint
