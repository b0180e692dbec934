"""Pictures straight from the raw tensor, with error bars from independent passes.

No compression, no tiles, no freezing: T is multiplied out as the polynomial is written.
What these pictures say about bias is said about the path tracer alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.compare import ZTest, ztest
from burnish.core.types import Float32, Float64
from burnish.precompute.accumulate import Accumulator, Rectangle
from burnish.precompute.bake import tile_seed
from burnish.precompute.prepass import find_rows
from burnish.precompute.symbolic import SymbolicMaterials
from burnish.precompute.tracer import Tracer
from burnish.reference import Estimate
from burnish.scene import Scene
from burnish.transport.basis import Basis, State, initial_state
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


Look = Callable[[Accumulator], Float64]
"""Makes a picture, float64 [height, width, 3], of what has been accumulated."""


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


def polynomial(tensor: Accumulator, state: State, tails: Float64 | None = None) -> Float64:
    """B without directly seen emission, term by term: float64 [height, width, 3].

    tails: other values of the tails than the state's.
    """
    basis, rows, area = tensor.tracer.basis, tensor.rows, tensor.rectangle
    tails = basis.tail_values(state) if tails is None else tails
    image = np.zeros((area.width * area.height, 3))
    for run, T in zip(tensor.layout.runs, tensor.transport(), strict=True):
        c = basis.column_coefficients(run.object, state, run.indirect)
        pieces = (basis.indirect_slices if run.indirect else basis.slices)(run.object)
        # One product for all: a column of numbers for each piece and channel, zero elsewhere
        numbers = np.zeros((len(c), len(tails), 3, len(pieces), 3), np.float32)
        for k, piece in enumerate(pieces):
            own = slice(piece.start, piece.stop)
            for h in range(3):
                numbers[own, :, h, k, h] = np.outer(c[own, h], tails[:, h])
        light = T.reshape(len(T), -1) @ numbers.reshape(-1, len(pieces) * 3)
        light = light.reshape(len(T), len(pieces), 3).astype(np.float64)
        if not run.indirect:
            cosine = rows.cos_theta_o[run.start : run.stop].astype(np.float64)
            for k, factor in enumerate(basis.outgoing_factors(run.object, state, cosine)):
                if factor is not None:
                    light[:, k] *= factor
        np.add.at(image, rows.pixel[run.start : run.stop], light.sum(axis=1))
    fixed = tensor.image(tensor.target.fixed)
    if basis.lights:
        fixed = mixed(basis, fixed, state)
    return fixed.astype(np.float64) + image.reshape(fixed.shape)


def look(state: State) -> Look:
    """The picture in a state of the materials."""
    return lambda tensor: polynomial(tensor, state)


def mistaken(
    state: State, variable: tuple[int, str] | None = None, coarse: int | None = None
) -> Look:
    """The same with one number of the tails 2 % too large: the albedo of a variable, or a
    coarse coefficient. Either is what a wrong e_j would do."""

    def picture(tensor: Accumulator) -> Float64:
        basis = tensor.tracer.basis
        albedos = basis.albedos(state).copy()
        if variable is not None:
            albedos[basis.variables.index(variable)] *= 1.02
        tails = basis.monomials.evaluate(albedos)
        if basis.coarse:
            values = basis.coarse_values(state).copy()
            if coarse is not None:
                values[coarse] *= 1.02
            products = (values[:, None] * tails[None]).reshape(-1, 3)
            tails = np.concatenate([np.ones((1, 3)), products])
        return polynomial(tensor, state, tails)

    return picture


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
    looks = [look(initial_state(basis.objects))] if looks is None else looks
    tensor = accumulator(scene, basis, seed, follow)
    found: list[list[Float64]] = [[] for _ in looks]
    count, emission = spp // per_pass, 0.0
    for number in range(count):
        clear(tensor)
        tensor.run(per_pass, tile_seed(seed, scene.view().name, 0, number))
        emission = emission + tensor.image(tensor.target.emission) / count
        for images, make in zip(found, looks, strict=True):
            images.append(make(tensor))
    lost = int(np.array(tensor.target.lost)[0])
    return [
        Picture(
            np.mean(images, axis=0),
            np.var(images, axis=0, ddof=1) / count,
            np.asarray(emission),
            lost,
            np.array(images, np.float32),
        )
        for images in found
    ]


def same(ours: Picture, theirs: Estimate) -> ZTest:
    """The Z-test of a picture against a reference, directly seen emission left out."""
    return ztest(ours.mean, ours.variance, theirs.reflected, theirs.variance)


def against(ours: Picture, answer: Float64 | float) -> ZTest:
    """The Z-test of a picture against a known answer, which has no noise."""
    known = np.broadcast_to(np.asarray(answer, np.float64), ours.mean.shape)
    return ztest(ours.mean, ours.variance, known, np.zeros_like(ours.mean))
