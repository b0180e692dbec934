"""The question of DESIGN §6 for one scene and series: is there any error but noise?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import mitsuba as mi

from burnish.compare import ZTest
from burnish.materials.layer import Material
from burnish.precompute.plan import basis_for
from burnish.reference import Estimate, series_image
from burnish.reference.bsdf import reflecting_bsdf
from burnish.reference.film import trace
from burnish.reference.reflectance import FineReflectance
from burnish.reference.truth import directly_seen
from burnish.scene import Scene
from burnish.transport.basis import Basis, State, initial_state
from tests.precompute.pictures import Picture, pictures, same


def with_basis(scene: Scene, basis: Basis) -> Scene:
    """The scene whose editable objects have the layers of the basis, bins and all."""
    materials = {item.id: item.material for item in basis.objects}
    objects = tuple(
        replace(item, material=materials.get(item.id, item.material)) for item in scene.objects
    )
    return replace(scene, objects=objects)


def projected(
    scene: Scene, basis: Basis, state: State | None = None, *, spp: int, seed: int = 900
) -> Estimate:
    """The reference: the same bins and the same series, by another path tracer."""
    state = initial_state(basis.objects) if state is None else state
    return series_image(
        with_basis(scene, basis),
        state,
        basis.series,
        spp=spp,
        seed=seed,
        indirect_bins=basis.indirect_bins,
    )


def verdict(
    scene: Scene, series: Sequence[int], *, spp: int, per_pass: int = 16, seed: int = 0
) -> tuple[ZTest, Picture]:
    """The Z-test of the scene's own materials, and our picture."""
    basis = basis_for(scene, None, series)
    ours = pictures(scene, basis, spp=spp, per_pass=per_pass, seed=seed)[0]
    return same(ours, projected(scene, basis, spp=spp)), ours


def with_materials(
    scene: Scene, materials: dict[str, Material], bounces: int, spp: int
) -> Estimate:
    """Mitsuba's own `path` in which some objects have materials of ours, projected on bins."""
    bsdfs = {
        name: reflecting_bsdf(FineReflectance(item, item.initial, {}), False)
        for name, item in materials.items()
    }
    built = scene.with_bsdfs(bsdfs)
    path = mi.load_dict({"type": "path", "max_depth": bounces + 1, "rr_depth": 99})

    def radiance(sampler: Any, ray: Any) -> tuple[Any, Any]:
        return mi.Color3f(path.sample(built, sampler, ray)[0]), directly_seen(built, ray)

    return trace(radiance, scene.view(), spp, seed=77)
