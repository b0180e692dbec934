"""Pictures straight from the raw tensor, with error bars from independent passes.

No compression, no tiles, no freezing: T is multiplied out as the polynomial is written.
What these pictures say about bias is said about the path tracer alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np
from scipy import stats

from burnish.compare import ZTest, ztest
from burnish.core.types import Float32, Float64
from burnish.materials.coefficients import (
    albedo,
    coarse_coefficients,
    coarse_energies,
    conserved,
)
from burnish.precompute.accumulate import Accumulator, Rectangle
from burnish.precompute.bake import tile_seed
from burnish.precompute.prepass import find_rows
from burnish.precompute.symbolic import SymbolicMaterials
from burnish.precompute.tracer import Tracer
from burnish.reference import Estimate
from burnish.scene import Scene
from burnish.transport.basis import Basis, State, coarse_count, initial_state
from burnish.transport.lights import mixed


@dataclass(frozen=True)
class Picture:
    """The mean over passes and the variance of that mean: float64 [height, width, 3].

    Directly seen emission is left out. lost: samples that found no row. passes: float32
    [passes, height, width, 3].
    """

    mean: Float64
    variance: Float64
    emission: Float64
    lost: int
    passes: Float32


def accumulator(
    scene: Scene, basis: Basis, seed: int = 0, follow: State | None = None
) -> Accumulator:
    """An empty tensor over the whole first view."""
    view = scene.view()
    tracer = Tracer(scene, view, SymbolicMaterials(scene, basis, follow=follow))
    rows = find_rows(tracer, tile_seed(seed, view.name, -1, 0)).rows
    return Accumulator(tracer, Rectangle(0, 0, view.width, view.height), rows)


def clear(tensor: Accumulator) -> None:
    """Start again with no samples."""
    target = tensor.target
    for name in ("transport", "fixed", "emission"):
        setattr(target, name, dr.zeros(mi.Float, dr.width(getattr(target, name))))
    dr.eval(target.transport, target.fixed, target.emission)
    tensor.samples = 0


@dataclass(frozen=True)
class Look:
    """A state of the materials, and the tails of its polynomial where they are not the
    state's own: float64 [tails, 3]."""

    state: State
    tails: Float64 | None = None


def polynomial(tensor: Accumulator, state: State) -> Float64:
    """B without directly seen emission, term by term: float64 [height, width, 3]."""
    return polynomials(tensor, [Look(state)])[0]


def polynomials(tensor: Accumulator, looks: Sequence[Look]) -> Float64:
    """The same for several looks: float64 [look, height, width, 3]."""
    basis, area = tensor.tracer.basis, tensor.rectangle
    images = np.zeros((len(looks), area.width * area.height, 3))
    fixed = tensor.image(tensor.target.fixed).astype(np.float64)
    groups: list[list[int]] = []
    for i, item in enumerate(looks):
        alike = [group for group in groups if looks[group[0]].state is item.state]
        if alike:
            alike[0].append(i)
        else:
            groups.append([i])
    for group in groups:
        state = looks[group[0]].state
        base = mixed(basis, fixed, state) if basis.lights else fixed
        images[group] += base.reshape(-1, 3)
        own = basis.tail_values(state)
        tails = np.stack([own if looks[i].tails is None else looks[i].tails for i in group])
        for run, light in zip(
            tensor.layout.runs, after_first_encounter(tensor, state), strict=True
        ):
            pixel = tensor.rows.pixel[run.start : run.stop]
            for h in range(3):
                # A run has one row for a pixel
                images[np.ix_(group, pixel, [h])] += (tails[..., h] @ light[..., h].T)[..., None]
    return images.reshape(len(looks), area.height, area.width, 3)


def after_first_encounter(tensor: Accumulator, state: State) -> list[Float64]:
    """T summed over the columns, of each run of rows: float64 [rows, tails, 3]."""
    basis, result = tensor.tracer.basis, []
    for run, T in zip(tensor.layout.runs, tensor.sums(), strict=True):
        c = basis.column_coefficients(run.object, state, run.indirect)
        pieces = (basis.indirect_slices if run.indirect else basis.slices)(run.object)
        # A row of numbers for each piece and channel, zero outside the piece
        numbers = np.zeros((len(pieces), 3, len(c)), np.float32)
        for k, piece in enumerate(pieces):
            numbers[k, :, piece.start : piece.stop] = c[piece.start : piece.stop].T
        rows, columns, tails, _ = T.shape
        every = numbers.reshape(-1, columns) @ T[..., :3].reshape(rows, columns, -1)
        every = every.reshape(rows, len(pieces), 3, tails, 3)
        light = np.einsum("rkhzh->rkzh", every).copy()
        if not run.indirect:
            cosine = tensor.rows.cos_theta_o[run.start : run.stop].astype(np.float64)
            for k, factor in enumerate(basis.outgoing_factors(run.object, state, cosine)):
                if factor is not None:
                    light[:, k] *= factor[:, None, :]
        result.append(light.sum(axis=1, dtype=np.float64) / max(tensor.samples, 1))
    return result


def mistaken(basis: Basis, state: State, index: int, layer: int, w: int | None = None) -> Look:
    """The picture when one number of object `index` is 2 % too large: the e_j of a layer, or
    the e_j inside its coarse bin w.

    Both the equivalent albedo Σ c_j e_j / π and the coarse coefficients Σ c_j e_j / e_w know
    it. A matte layer has a single e_j.
    """
    item = basis.objects[index]
    part = item.material.layers[layer]
    own = conserved(item.material, state[item.id]).layers[part.name]
    columns = [n for n, (i, k, _) in enumerate(basis.coarse) if (i, k) == (index, layer)]
    albedos, coarse = basis.albedos(state).copy(), basis.coarse_values(state).copy()
    energy = albedo(part, own)
    if w is not None:
        count = coarse_count(part, basis.coarse_bins)
        energy = coarse_coefficients(part, own, count)[w] * coarse_energies(part, count)[w] / np.pi
        columns = [columns[w]]
    albedos[basis.variables.index((index, part.group))] += 0.02 * energy
    coarse[columns] *= 1.02
    tails = basis.monomials.evaluate(albedos)
    if basis.coarse:
        products = (coarse[:, None] * tails[None]).reshape(-1, 3)
        tails = np.concatenate([np.ones((1, 3)), products])
    return Look(state, tails)


def pictures(
    scene: Scene,
    basis: Basis,
    looks: Sequence[Look] | None = None,
    *,
    spp: int,
    per_pass: int = 16,
    seed: int = 0,
    follow: State | None = None,
) -> list[Picture]:
    """One picture per look, all from the same `spp` samples per pixel.

    looks: the scene's own materials when None. per_pass: samples that are stratified
      together, a power of four; passes are independent.
    """
    looks = [Look(initial_state(basis.objects))] if looks is None else looks
    tensor = accumulator(scene, basis, seed, follow)
    found: list[Float64] = []
    count, emission = spp // per_pass, 0.0
    for number in range(count):
        clear(tensor)
        tensor.run(per_pass, tile_seed(seed, scene.view().name, 0, number))
        emission = emission + tensor.image(tensor.target.emission) / count
        found.append(polynomials(tensor, looks))
    lost = int(np.array(tensor.target.lost)[0])
    return [
        Picture(
            np.mean(images, axis=0),
            np.var(images, axis=0, ddof=1) / count,
            np.asarray(emission),
            lost,
            np.array(images, np.float32),
        )
        for images in np.swapaxes(found, 0, 1)
    ]


def same(ours: Picture, theirs: Estimate) -> ZTest:
    """The Z-test of a picture against a reference, directly seen emission left out.

    Our variance is that of some dozens of passes, so a pixel's difference has Student's
    distribution and not the normal one: with 64 passes five σ come nine times as often. The
    variances are made those with which the normal one gives Student's probabilities, all of
    the variance taken for ours (which asks for a little more than it must).
    """
    total = ours.variance + theirs.variance.astype(np.float64)
    gap = np.abs(ours.mean - theirs.reflected)
    t = np.divide(gap, np.sqrt(total), out=np.zeros_like(gap), where=total > 0)
    # Near 0 the two distributions differ by a factor only; beyond 30 nothing passes anyway
    t = np.clip(t, 0.01, 30.0)
    factor = (t / stats.norm.isf(stats.t.sf(t, len(ours.passes) - 1))) ** 2
    return ztest(ours.mean, ours.variance * factor, theirs.reflected, theirs.variance * factor)


def against(ours: Picture, answer: Float64 | float) -> ZTest:
    """The Z-test of a picture against a known answer, which has no noise."""
    known = np.broadcast_to(np.asarray(answer, np.float64), ours.mean.shape)
    return ztest(ours.mean, ours.variance, known, np.zeros_like(ours.mean))
