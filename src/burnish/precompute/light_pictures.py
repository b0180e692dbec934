"""What each light adds to a picture: all materials settled, the light told apart by emitter."""

from __future__ import annotations

from collections.abc import Sequence

from burnish.core.types import Float32
from burnish.materials.lights import LightGroup
from burnish.precompute.accumulate import Accumulator, Rectangle
from burnish.precompute.bake import strata, tile_seed
from burnish.precompute.symbolic import SymbolicMaterials, settled
from burnish.precompute.tracer import Tracer
from burnish.scene import Scene, View
from burnish.transport.basis import Basis, State
from burnish.transport.rows import Rows


class LightTracer:
    """Traces one view for materials that stay as they are.

    basis: the session's, for its bounces. state: by object id; materials that it does not
    name are the scene's. groups: the lights to tell apart.
    """

    def __init__(
        self, scene: Scene, view: View, basis: Basis, state: State, groups: Sequence[LightGroup]
    ) -> None:
        editable = {item.id: item.material for item in scene.objects if item.material is not None}
        numeric = {name: state.get(name, own) for name, own in settled(scene, ()).items()}
        for name, material in editable.items():
            if name in state and state[name] != material.initial:
                numeric[name] = state[name]
        bare = Basis((), basis.series, basis.indirect_bins, tuple(groups))
        # Every model at once: an edit then changes tables alone
        materials = SymbolicMaterials(scene, bare, numeric, compile_for=list(editable))
        self._tracer = Tracer(scene, view, materials)
        self._frame = Rectangle(0, 0, view.width, view.height)

    def pictures(self, spp: int, seed: int) -> tuple[Float32, Float32]:
        """All light, and directly seen emission alone: float32 [groups, height, width, 3].

        spp: rounded up to whole strata. Linear RGB, per sample.
        """
        accumulator = Accumulator(self._tracer, self._frame, Rows.empty())
        for number, samples in enumerate(strata(spp)):
            accumulator.run(samples, tile_seed(seed, self._tracer.view.name, 0, number))
        fixed = accumulator.image(accumulator.target.fixed)
        emission = accumulator.image(accumulator.target.emission)
        return fixed + emission, emission
