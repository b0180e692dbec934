"""Every parameter of an object, to the ends and the middle of its slider, against Mitsuba.

Nothing is compressed here. In pictures this small the 64 pixels that share a block see quite
different things in a mirror, and a rank that is plenty at full size loses detail: FloorTiles
of staircase2 at roughness 0.05 and 36 × 48 pixels is 0.06 off with it and 0.00 without.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import burnish
from burnish.app.baking import bake
from burnish.core.types import Value
from burnish.materials.parameter import Parameter
from burnish.precompute.plan import basis_for
from burnish.reference import PathTracedTruth
from burnish.scene import load
from burnish.scene.objects import SceneObject
from tests.verify.pictures import Halves, against_quiet_truth
from tests.verify.report import Figures

UNEDITED, EDITED, FLIP = 0.02, 0.05, 0.05


@dataclass(frozen=True)
class Case:
    """One object of a scene, the only one that is editable.

    scene: a file below the assets, or an example's name. spp: of the bake and the first
    reference; of references for edits half as many. bake: of the bake, where it needs more: it
    does not know that a highlight will be sharp. series: with (64, 16) where an object reflects
    itself so well that its equivalent albedo shows. limit: of the unedited picture, 0.05 where
    the object sees itself.
    """

    scene: str
    object: str
    series: tuple[int, ...] = (64, 1)
    spp: int = 16384
    resolution: tuple[int, int] = (32, 24)
    limit: float = UNEDITED
    bake: int = 0

    def __str__(self) -> str:
        name = Path(self.scene)
        place = name.parent.name if name.stem == "scene" else name.stem
        return f"{place}-{self.object}"


def sweep(figures: Figures, case: Case, assets: Path, folder: Path) -> None:
    """Unedited, then each parameter by itself; all figures are taken before it fails."""
    name = str(assets / case.scene) if "/" in case.scene else case.scene
    scene = load(name, resolution=case.resolution)
    tracer = PathTracedTruth(scene, bounces=len(case.series))
    basis = basis_for(scene, [case.object], case.series, None)
    first, second = (
        burnish.edit(
            bake(
                scene,
                basis,
                folder / f"{seed}.burnish",
                spp=max(case.spp, case.bake) // 2,
                seed=seed,
                tolerance=0,
            )
        )
        for seed in (1, 2)
    )
    halves = Halves((first, second))
    found = against_quiet_truth(halves, tracer, {}, case.spp, case.limit)
    figures.close("as it is", found.metrics, case.limit, found.image, found.reference)
    for path, value in edits(scene.object(case.object)):
        found = against_quiet_truth(halves, tracer, {path: value}, case.spp // 2, EDITED)
        label = f"{path.removeprefix(case.object + '.')} = {shown(value)}"
        figures.close(label, found.metrics, EDITED, found.image, found.reference)
        figures.at_most(f"{label}: FLIP", found.metrics["flip"], FLIP)
    figures.settle()


def edits(item: SceneObject) -> Iterator[tuple[str, Value]]:
    """Each knob of an object at three places of its travel."""
    assert item.material is not None
    for layer in item.material.layers:
        for parameter in item.material.parameters(layer.name):
            for value in places(parameter):
                yield f"{item.id}.{layer.name}.{parameter.name}", value


def places(parameter: Parameter) -> list[Value]:
    """The ends of a slider and the middle of its travel; a choice has all of its places."""
    if parameter.kind == "choice":
        return list(parameter.choices)
    low = parameter.minimum if parameter.soft_minimum is None else parameter.soft_minimum
    high = parameter.maximum if parameter.soft_maximum is None else parameter.soft_maximum
    middle = {
        "linear": (low + high) / 2,
        "logarithmic": float(np.sqrt(max(low, 1e-9) * high)),
        "square": ((low**0.5 + high**0.5) / 2) ** 2,
    }[parameter.scale]
    numbers = (low, middle, high)
    return [(x, x, x) if parameter.kind == "colour" else x for x in numbers]


def shown(value: Value) -> str:
    if isinstance(value, tuple):
        return f"{value[0]:.3g}"
    return value if isinstance(value, str) else f"{value:.3g}"
