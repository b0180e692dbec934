"""At full size: the tracer has no error but noise, and the test can see one of 2 %."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from burnish.materials.layer import MaterialState
from burnish.precompute.plan import basis_for
from burnish.precompute.symbolic import NUMERIC_BINS
from burnish.reference import PathTracedTruth
from burnish.scene import Scene, load
from burnish.transport.basis import initial_state
from tests.precompute import worlds
from tests.precompute.machinery import projected, with_materials
from tests.precompute.pictures import look, mistaken, pictures, same
from tests.reference.worlds import blinn, edited, initial, lambert
from tests.verify.report import Figures

pytestmark = pytest.mark.verify

SIDE, SPP = 48, 8192


def test_the_diffuse_cornell_box(figures: Figures) -> None:
    """Cornell box, all diffuse, four bounces, against Mitsuba's `path`."""
    scene = load("cornell-box", resolution=(96, 96))
    truth = PathTracedTruth(scene, bounces=4).estimate(initial(scene), spp=SPP, seed=5)
    basis = basis_for(scene, None, (1, 1, 1, 1))
    state = initial_state(basis.objects)
    names = [item.id for item in basis.objects]
    looks = [look(state)] + [mistaken(state, variable=(i, "")) for i in range(len(names))]
    right, *wrong = pictures(scene, basis, looks, spp=SPP, per_pass=64)
    figures.equal("Z-test", same(right, truth), right.mean, truth.reflected)
    figures.at_most("median relative σ", same(right, truth).relative_sigma, 0.02)
    figures.note("samples that found no row", right.lost)
    for name, picture in zip(names, wrong, strict=True):
        # The boxes light little besides the floor's shadows; the walls must be seen
        if name not in ("small-box", "large-box"):
            figures.different(f"e_j of {name} times 1.02", same(picture, truth))
        else:
            figures.note(f"e_j of {name} times 1.02: p", same(picture, truth).p)
    figures.settle()


def glossy_cornell(scene: Scene) -> dict[str, MaterialState]:
    """Every surface with some gloss, of different sharpness."""
    state = initial(scene)
    exponents = np.geomspace(10, 300, len(state))
    for (name, item), exponent in zip(state.items(), exponents, strict=True):
        state[name] = edited(
            item, "specular", weight=1.0, exponent=float(exponent), color=(0.3, 0.3, 0.3)
        )
    return state


@pytest.mark.parametrize("series", [(64, 1, 1, 1), (16, 8, 1)], ids=str)
def test_the_glossy_cornell_box(figures: Figures, series: tuple[int, ...]) -> None:
    """Seven glossy editable objects against the reference with the same bins and series."""
    scene = load("cornell-box", resolution=(24, 24))
    basis = basis_for(scene, None, series)
    state = glossy_cornell(scene)
    floor = basis.index("floor")
    wrong = mistaken(state, variable=(floor, ""))
    ours, tampered = pictures(scene, basis, [look(state), wrong], spp=SPP, per_pass=64)
    theirs = projected(scene, basis, state, spp=SPP)
    figures.equal("Z-test", same(ours, theirs), ours.mean, theirs.reflected)
    figures.at_most("median relative σ", same(ours, theirs).relative_sigma, 0.02)
    if not basis.coarse:
        figures.different("e_j of floor times 1.02", same(tampered, theirs))
    figures.note("samples that found no row", ours.lost)
    figures.settle()


def test_one_coarse_number_off_is_seen(figures: Figures) -> None:
    """Series (32, 8, 1): each object's diffuse energy at the second encounter times 1.02."""
    scene = worlds.glossy(SIDE)
    basis = basis_for(scene, None, (32, 8, 1))
    state = initial_state(basis.objects)
    diffuse = [w for w, (_, layer, _) in enumerate(basis.coarse) if layer == 0]
    looks = [look(state)] + [mistaken(state, coarse=w) for w in diffuse]
    right, *wrong = pictures(scene, basis, looks, spp=SPP, per_pass=64)
    theirs = projected(scene, basis, spp=2 * SPP)
    figures.equal("Z-test", same(right, theirs), right.mean, theirs.reflected)
    for item, picture in zip(basis.objects, wrong, strict=True):
        figures.different(f"e_j of {item.id} times 1.02", same(picture, theirs))
    figures.settle()


WORLDS: list[tuple[Callable[[int], Scene], tuple[int, ...]]] = [
    (worlds.glossy, (32, 1, 1, 1)),
    (worlds.glossy, (32, 8, 1)),
    (worlds.glossy, (16, 16)),
    (worlds.behind_glass, (32, 1, 1, 1)),
    (worlds.behind_glass, (32, 8, 1)),
    (worlds.in_a_mirror, (64, 1, 1)),
    (worlds.beside_rough_things, (32, 1, 1)),
    (worlds.beside_rough_things, (32, 8, 1)),
    (worlds.textured, (32, 1, 1, 1)),
    (worlds.textured, (32, 8, 1)),
    (worlds.three_layers, (32, 1, 1, 1)),
    (worlds.three_layers, (16, 16)),
    (worlds.metals, (64, 1, 1)),
    (worlds.rough_metals, (32, 8, 1)),
    (worlds.under_small_lights, (32, 8, 1)),
    (worlds.under_an_environment, (32, 8, 1)),
    (worlds.under_sun_and_sky, (32, 1, 1)),
    (worlds.seen_from_both_sides, (32, 8, 1)),
]


@pytest.mark.parametrize(
    ("world", "series"), WORLDS, ids=[f"{w.__name__}-{'-'.join(map(str, s))}" for w, s in WORLDS]
)
def test_every_kind_of_scene(
    figures: Figures, world: Callable[[int], Scene], series: tuple[int, ...]
) -> None:
    """One thing that can go wrong, against the reference with the same bins and series."""
    scene = world(SIDE)
    basis = basis_for(scene, None, series)
    ours = pictures(scene, basis, spp=SPP // 2, per_pass=64)[0]
    theirs = projected(scene, basis, spp=SPP)
    figures.equal("Z-test", same(ours, theirs), ours.mean, theirs.reflected)
    figures.at_most("median relative σ", same(ours, theirs).relative_sigma, 0.02)
    figures.note("samples that found no row", ours.lost)
    figures.settle()


def test_settled_materials(figures: Figures) -> None:
    """Materials of ours that are not edited and that Mitsuba does not have."""
    item = blinn(worlds.RED, worlds.GREY, 80.0, bins=NUMERIC_BINS)
    materials = {"floor": lambert(worlds.GREY), "wall": item}
    scene = worlds.corner(materials, side=SIDE)
    theirs = with_materials(scene, materials, 4, SPP)
    ours = pictures(scene, basis_for(scene, ["floor"], (1,) * 4), spp=SPP, per_pass=64)[0]
    figures.equal("Z-test", same(ours, theirs), ours.mean, theirs.reflected)
    figures.at_most("median relative σ", same(ours, theirs).relative_sigma, 0.02)
    figures.settle()


def test_the_error_falls_with_the_samples(figures: Figures) -> None:
    """Error against samples, in the exponent: −1/2."""
    scene = worlds.glossy(SIDE)
    basis = basis_for(scene, None, (32, 1, 1))
    truth = projected(scene, basis, spp=1 << 16)
    passes = pictures(scene, basis, spp=SPP)[0].passes.astype(np.float64)
    noise = truth.variance.astype(np.float64).sum()
    counts, errors = [1, 4, 16, 64, 256], []
    for n in counts:
        means = passes[: 512 // n * n].reshape(-1, n, *passes.shape[1:]).mean(axis=1)
        squares = ((means - truth.reflected) ** 2).sum(axis=(1, 2, 3)) - noise
        errors.append(float(np.sqrt(squares.mean() / (truth.reflected**2).sum())))
        figures.note(f"relative error at {16 * n} samples", errors[-1])
    slope = float(np.polyfit(np.log(counts), np.log(errors), 1)[0])
    figures.at_most("exponent", slope, -0.47)
    figures.at_least("exponent", slope, -0.53)
    figures.settle()
