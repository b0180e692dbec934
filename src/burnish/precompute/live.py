"""Live estimates: only the selected objects symbolic, refined pass by pass, with no bake.

This is 2008's object freezing estimated directly by path tracing instead of contracted
from a stored tensor: every other material is what it is at every bounce. An edit of a
selected object reuses every sample; an edit of another one, or another selection, begins
anew. Sampling follows the current look half-way, so that what is on the screen cleans up
first, and stays unbiased for every other setting.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.types import Float32
from burnish.precompute.accumulate import Accumulator, Rectangle
from burnish.precompute.plan import row_bytes
from burnish.precompute.prepass import find_rows
from burnish.precompute.symbolic import SymbolicMaterials, settled
from burnish.precompute.tracer import CELL, Tracer
from burnish.scene import Scene, View
from burnish.transport.basis import Basis, ColumnSlice, State
from burnish.transport.frozen import Powers
from burnish.transport.lights import of_each_light
from burnish.transport.rows import Rows

STORED_BYTES = 2 << 30
"""Cap of F for one view; beyond it the bins are halved until it fits."""

PREPASS_SAMPLES = 8
STRATUM = 16


@dataclass(frozen=True)
class LivePart:
    """What a frozen part will be made of: its rows and columns, before any number.

    object: index into the *session's* basis. pixel, cos_theta_o: per row.
    """

    object: int
    indirect: bool
    slice: ColumnSlice
    pixel: np.ndarray
    cos_theta_o: np.ndarray
    powers: int

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of F: (3, rows, columns · powers)."""
        return 3, len(self.pixel), (self.slice.stop - self.slice.start) * self.powers


class LiveEstimate:
    """The estimate of one view for one selection, in the process that traces."""

    def __init__(
        self,
        scene: Scene,
        view: View,
        basis: Basis,
        selected: Sequence[str],
        state: State,
        edited: Sequence[str] = (),
        seed: int = 0,
    ) -> None:
        """basis: the session's, over all editable objects. selected: ids that stay symbolic.

        state: the materials of all objects; edited: ids of those that are no longer as the
        scene has them.
        """
        self.scene, self.view, self.seed = scene, view, seed
        self.session_basis = basis
        chosen = tuple(item for item in basis.objects if item.id in set(selected))
        self.basis = replace(basis, objects=chosen)
        # Others are tables where the scene's own BSDF does not hold them
        numeric = settled(scene, [item.id for item in chosen])
        numeric |= {name: state[name] for name in edited if name not in set(selected)}
        numeric = {name: state.get(name, value) for name, value in numeric.items()}
        self.numeric = numeric
        rows = self._rows(state)
        while self._bytes(rows) > STORED_BYTES and self._halve_bins():
            pass
        self.materials = self._materials(state)
        self.tracer = Tracer(scene, view, self.materials)
        self.accumulator = self._empty(rows)
        self._strata = 0

    def _materials(self, state: State) -> SymbolicMaterials:
        every = [item.id for item in self.session_basis.objects]
        return SymbolicMaterials(self.scene, self.basis, self.numeric, state, every)

    def _empty(self, rows: Rows) -> Accumulator:
        whole = Rectangle(0, 0, self.view.width, self.view.height)
        return Accumulator(self.tracer, whole, rows)

    def restart(self, state: State, seed: int) -> None:
        """Begin anew with the same rows, such as after a light has moved."""
        rows = self.accumulator.rows
        # Two tensors may not fit
        del self.accumulator
        self.seed, self._strata = seed, 0
        self.accumulator = self._empty(rows)
        self.follow(state)

    def _rows(self, state: State) -> Rows:
        tracer = Tracer(self.scene, self.view, self._materials(state))
        return find_rows(tracer, self.seed, PREPASS_SAMPLES).rows

    def _bytes(self, rows: Rows) -> int:
        return int(row_bytes(self.basis, rows).sum())

    def _halve_bins(self) -> bool:
        """Half as many bins in every layer; False when they are few already."""
        layers = [layer for item in self.basis.objects for layer in item.material.layers]
        if max(layer.bins for layer in layers) <= 16:
            return False
        self.basis = replace(
            self.basis,
            objects=tuple(
                replace(
                    item,
                    material=replace(
                        item.material,
                        layers=tuple(layer.coarser() for layer in item.material.layers),
                    ),
                )
                for item in self.basis.objects
            ),
        )
        return True

    # -- refining -------------------------------------------------------------------------

    @property
    def samples(self) -> int:
        """Samples per pixel so far."""
        return self.accumulator.samples

    def step(self) -> None:
        """Add samples: few at first, so that there is something to see, then whole strata."""
        spp = 1 if self.samples == 0 else 4 if self.samples < 12 else STRATUM
        words = [self.seed & 0xFFFFFFFF, *self.view.name.encode(), self._strata]
        self.accumulator.run(spp, int(np.random.SeedSequence(words).generate_state(1)[0]))
        self._strata += 1

    def follow(self, state: State) -> None:
        """Let the next samples follow the current look; those taken stay in the estimate."""
        self.materials.follow(state)

    # -- what a session needs ---------------------------------------------------------------

    @property
    def frozen_basis(self) -> Basis:
        """The session's basis with the selected objects' bins as they are here: what the
        columns of `parts` and the coarse columns of `powers` are counted in."""
        own = {item.id: item for item in self.basis.objects}
        every = self.session_basis.objects
        return replace(self.session_basis, objects=tuple(own.get(x.id, x) for x in every))

    @property
    def powers(self) -> Powers:
        """The tails as powers of the session's variables."""
        variables = {key: v for v, key in enumerate(self.session_basis.variables)}
        index = [self.session_basis.index(item.id) for item in self.basis.objects]
        ours = [variables[index[i], group] for i, group in self.basis.variables]
        exponents = self.basis.monomials.exponents
        coarse = np.full(len(exponents), -1, np.int32)
        if self.basis.coarse:
            columns = {key: w for w, key in enumerate(self.frozen_basis.coarse)}
            ids = [columns[index[i], k, w] for i, k, w in self.basis.coarse]
            coarse = np.concatenate([[-1], np.repeat(ids, len(exponents))]).astype(np.int32)
            none = np.zeros((1, exponents.shape[1]), np.int32)
            exponents = np.concatenate([none, np.tile(exponents, (len(ids), 1))])
        powers = Powers(exponents.astype(np.int32), np.array(ours, np.int32), coarse)
        return of_each_light(powers, len(self.basis.lights)) if self.basis.lights else powers

    def parts(self) -> list[LivePart]:
        """The parts of the frozen form, in the order of `values`."""
        rows = self.accumulator.rows
        return [
            LivePart(
                self.session_basis.index(self.basis.objects[run.object].id),
                run.indirect,
                piece,
                rows.pixel[run.start : run.stop],
                rows.cos_theta_o[run.start : run.stop],
                self.basis.tails,
            )
            for run in self.accumulator.layout.runs
            for piece in self._slices(run.object, run.indirect)
        ]

    def _slices(self, index: int, indirect: bool) -> tuple[ColumnSlice, ...]:
        return self.basis.indirect_slices(index) if indirect else self.basis.slices(index)

    def write(self, outputs: Sequence[Float32]) -> None:
        """Write the estimate of every part into its F: float32 [3, rows, columns · powers]."""
        source, tails = self.accumulator.target.transport, self.basis.tails
        scale = 1.0 / max(self.samples, 1)
        outputs = list(outputs)
        for run in self.accumulator.layout.runs:
            for piece in self._slices(run.object, run.indirect):
                out = outputs.pop(0)
                count, width = run.stop - run.start, (piece.stop - piece.start) * tails
                # Channels apart and rows whole, a channel at a time to bound the copy
                cell = dr.arange(mi.UInt32, count * width)
                place = cell % width + piece.start * tails
                order = run.arrangement.order
                if order is not None:
                    place = dr.gather(mi.UInt32, mi.UInt32(order.astype(np.uint32)), place)
                index = (run.offset + cell // width * run.arrangement.places + place) * CELL
                for channel in range(3):
                    values = dr.gather(mi.Float, source, index + channel) * scale
                    out[channel] = np.array(values, copy=False).reshape(count, width)

    def base(self) -> tuple[Float32, Float32]:
        """Light that met nothing symbolic, and directly seen emission: [height, width, 3], or
        [lights, height, width, 3]."""
        t = self.accumulator.target
        return self.accumulator.image(t.fixed), self.accumulator.image(t.emission)


def first_rows(scene: Scene, view: View, basis: Basis) -> Rows:
    """Which objects each pixel of a view meets first, all editable ones counted."""
    tracer = Tracer(scene, view, SymbolicMaterials(scene, basis))
    return find_rows(tracer, 0, PREPASS_SAMPLES).rows
