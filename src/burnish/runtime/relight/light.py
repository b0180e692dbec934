"""The radiance of cells: L = Σ_n (M_s)^n L_d (2010, eq. 16–17), with M_s = albedo × M.

The albedos of edited objects may stay open: L is then a polynomial in them, one L for each of
its monomials.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from burnish.core.types import AnyArray, Float32, Float64
from burnish.materials.coefficients import albedo, coarse_energies, conserved
from burnish.materials.layer import Layer, Material, MaterialState
from burnish.materials.painting.varied import Mixture
from burnish.runtime.relight.rows import apply
from burnish.transport.basis import Basis, State
from burnish.transport.gather import GatherData, GatherSamples
from burnish.transport.monomials import Monomials


@dataclass(frozen=True)
class CellLight:
    """The radiance of cells, for each monomial z of the open albedos: float32 [z, g, 3].

    Cells of the sky and of lamps show those, cells of surfaces what such cells do not show."""

    monomials: Monomials
    radiance: Float32


def cell_light(
    data: GatherData,
    irradiance: tuple[Float32, Float32],
    emission: Float32,
    state: State,
    open_variables: tuple[int, ...] = (),
) -> CellLight:
    """L of all cells under a direct irradiance at their points.

    irradiance: float32 [g, p, 3] twice, of all lights and of those that cells show themselves;
    emission: float32 [g, 3], what those cells show (`DirectLight`). open_variables: of the
    basis, those whose albedo stays symbolic. Bounces are the basis's: the last one is the row's
    own.
    """
    basis, samples = data.basis, data.samples
    further = basis.bounces - 2
    monomials = Monomials(len(open_variables), max(basis.bounces - 1, 0))
    albedos = basis.albedos(state)
    reflected = _Reflection(samples, albedos, open_variables, monomials)
    shape = len(monomials), len(samples), 3
    if further < 0:
        return CellLight(monomials, np.zeros(shape, np.float32))
    every, shown = (part / np.float32(np.pi) for part in irradiance)
    light = reflected.direct(every, np.zeros(shape, np.float32))
    total = light.copy()
    for _ in range(further):
        light = reflected.again(_gathered(data, light))
        total += light
    if emission.any():
        # What is shown along glossy layers is no part of what they scatter
        share = 1 - matte_shares(basis, state)
        glossy = _Reflection(samples, albedos, open_variables, monomials, share)
        total -= glossy.direct(shown, np.zeros(shape, np.float32))
        seen = samples.through >= 0
        total[0][seen] += emission[seen] * _glossier(basis, state)[samples.through[seen]]
    return CellLight(monomials, total)


def matte_shares(basis: Basis, state: State) -> Float64:
    """The share of each variable's albedo that is of layers without a highlight, 1 where the
    albedo is none: [variables, 3]."""
    result = np.ones((len(basis.variables), 3))
    for v, (i, group) in enumerate(basis.variables):
        item = basis.objects[i]
        own = layer_albedos(item.material, state[item.id])
        layers = list(zip(item.material.layers, own, strict=True))
        total = sum((d for layer, d in layers if layer.group == group), np.zeros(3))
        matte = sum(
            (d for layer, d in layers if layer.group == group and not _is_glossy(layer)),
            np.zeros(3),
        )
        np.divide(matte, total, out=result[v], where=total > 0)
    return result


def _glossier(basis: Basis, state: State) -> Float64:
    """How much more than in the scene each object's highlights reflect: [objects, 3]."""
    result = np.zeros((len(basis.objects), 3))
    for i, item in enumerate(basis.objects):
        glossy = [_is_glossy(layer) for layer in item.material.layers]
        now, then = (
            layer_albedos(item.material, of)[glossy].sum(axis=0)
            for of in (state[item.id], item.material.initial)
        )
        # What is traced is of all channels together
        result[i] = now / max(float(then.mean()), 1e-6)
    return result


def layer_albedos(material: Material, state: MaterialState) -> Float64:
    """Equivalent albedo d of each layer, whose sums are the basis's: float64 [layers, 3].

    Of a material that varies it is the mean over the surface, by one coarse bin's coefficient
    and energy (`coarse_coefficients`).
    """
    if isinstance(state, Mixture):
        energy = np.concatenate([coarse_energies(layer, 1) for layer in material.layers])
        return np.asarray(state.coarse(1) * (energy / np.pi)[:, None])
    settled = conserved(material, state)
    return np.stack([albedo(layer, settled.layers[layer.name]) for layer in material.layers])


def _is_glossy(layer: Layer) -> bool:
    return layer.model.lobe == "half"


class _Reflection:
    """M_s's albedos: what cells make of the light that they receive."""

    def __init__(
        self,
        samples: GatherSamples,
        albedos: Float64,
        open_variables: tuple[int, ...],
        monomials: Monomials,
        share: Float64 | None = None,
    ) -> None:
        """share: of each albedo that counts, float64 [variables, 3]; then of variables alone."""
        self.samples, self.monomials = samples, monomials
        self._alone = share is not None
        share = np.ones_like(albedos) if share is None else share
        position = {v: k for k, v in enumerate(open_variables)}
        # By group: a number for each cell and, where the albedo is open, which variable
        self.numbers, self.open = [], []
        for k in range(samples.variable.shape[1]):
            variable = samples.variable[:, k]
            values = np.zeros((len(samples), 3), np.float32)
            known = variable >= 0
            values[known] = albedos[variable[known]] * share[variable[known]]
            which = np.array([position.get(int(v), -1) for v in range(len(albedos))], np.int32)
            symbolic = np.where(variable >= 0, which[variable], -1)
            values[symbolic >= 0] = share[variable[symbolic >= 0]]
            self.numbers.append(values)
            self.open.append(symbolic)
        self.mean = samples.reflects.mean(axis=1)
        self.fixed = samples.fixed.mean(axis=1)

    def direct(self, light: Float32, result: Float32) -> Float32:
        """Of light [g, p, 3] at the points, which the weight maps meet point by point."""
        points = light.shape[1]
        if not self._alone:
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

    def _deposit(self, result: Float32, z: int, symbolic: AnyArray, own: Float32) -> None:
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
