"""Relighting as a `Transport`: a frozen form for the present lights, made anew as they change.

B = direct + Σ_parts H s(θo) Σ_c c (T_c L): light that the targets send straight from a light
has their columns open, what comes round has those and the powers of their albedos.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from burnish.core.errors import TooLarge
from burnish.core.types import Float32, Int32
from burnish.materials.lights import lights_in
from burnish.runtime.freeze import machine_memory
from burnish.runtime.relight.light import CellLight, cell_light
from burnish.runtime.relight.rows import apply_open, row_light
from burnish.transport.basis import Basis, ColumnSlice, State
from burnish.transport.frozen import Frozen, FrozenPart, Powers
from burnish.transport.gather import GatherData, GatherView, RowTransfer
from burnish.transport.protocols import DirectLight
from burnish.transport.rows import Rows

LEVELS = (1, 4, 16, 64, 256)
"""Samples of direct light per pixel, at first and after each pause."""
WHOLE = 64
"""Samples where a picture is asked once and for all."""
PER_POINT = (1, 2, 4, 8, 16)
"""Light samples at each point of a cell, at each level."""
PAUSE_SECONDS = 0.3
"""After so long without an edit a picture is made better."""


class RelightView:
    """One view. interactive: whether pictures are wanted at once and may get better later."""

    relights = True
    """Lights stand where a state says."""

    def __init__(self, data: GatherData, name: str, direct: DirectLight) -> None:
        self.data, self.name, self.direct = data, name, direct
        self.view: GatherView = data.views[name]
        self.interactive: Callable[[], bool] = lambda: False
        self.camera: tuple[float, ...] = ()
        """From the world to pixels, [3, 4] row by row: what handles on lights are drawn by."""
        self.emission: Float32 = np.zeros((self.height, self.width, 3), np.float32)
        self._revision, self._level, self._dirty = 0, len(LEVELS) - 1, False
        self._key: object = None
        self._lights: object = None
        self._touched = 0.0

    @property
    def basis(self) -> Basis:
        return self.data.basis

    @property
    def rows(self) -> Rows:
        return self.view.rows

    @property
    def width(self) -> int:
        return self.view.width

    @property
    def height(self) -> int:
        return self.view.height

    @property
    def revision(self) -> int:
        """One more than the last frozen form's where a better one is due."""
        idle = time.monotonic() - self._touched > PAUSE_SECONDS
        unfinished = self.interactive() and idle and self._level < len(LEVELS) - 1
        return self._revision + int(self._dirty or unfinished)

    def follow(self, state: State) -> None:
        """A state has changed: what lights send is no part of what a session compares."""
        self._touched = time.monotonic()
        if self._key is not None and lights_in(state) != self._lights:
            self._dirty = True

    def freeze(self, targets: tuple[int, ...], state: State, fine: tuple[int, ...] = ()) -> Frozen:
        """The form for the lights and the other materials of a state.

        Raises TooLarge where the targets' columns do not fit.
        """
        samples, per_point = self._effort(targets, fine, state)
        kept = tuple(sorted({*targets, *fine}))
        open_variables = tuple(v for v, (i, _) in enumerate(self.basis.variables) if i in targets)
        irradiance = self.direct.irradiance(state, per_point)
        emission = self.direct.emission(state)
        light = cell_light(self.data, irradiance, emission, state, open_variables)
        powers = Powers(
            exponents=light.monomials.exponents,
            variables=np.array(open_variables, np.int32),
            coarse=np.full(len(light.monomials), -1, np.int32),
        )
        self._check_memory(kept, len(light.monomials))
        others, self.emission = self.direct.picture(self.name, state, kept, samples)
        parts = [part for i in kept for part in self._open(i, light, state, samples)]
        self._revision += 1
        self._lights, self._dirty = lights_in(state), False
        return Frozen(
            basis=self.basis,
            targets=targets,
            width=self.width,
            height=self.height,
            base=(others + self.emission).reshape(-1, 3),
            powers=powers,
            parts=[self._settled(kept, light, state), *parts],
            revision=self._revision,
        )

    def _effort(
        self, targets: tuple[int, ...], fine: tuple[int, ...], state: State
    ) -> tuple[int, int]:
        """Samples of direct light per pixel and per point of a cell."""
        key = targets, fine, dict(state) if not targets else self._others(targets, state)
        again, self._key = key == self._key, key
        if not self.interactive():
            self._level = LEVELS.index(WHOLE)
        else:
            self._level = min(self._level + 1, len(LEVELS) - 1) if again else 0
        self._touched = time.monotonic()
        return LEVELS[self._level], PER_POINT[self._level]

    def _others(self, targets: tuple[int, ...], state: State) -> State:
        own = {self.basis.objects[i].id for i in targets}
        return {name: item for name, item in state.items() if name not in own}

    def _settled(self, kept: tuple[int, ...], light: CellLight, state: State) -> FrozenPart:
        """Light that came round and met an object first that is no target: float32
        [3, pixels, powers]."""
        pixels, powers = self.width * self.height, len(light.monomials)
        V = np.zeros((pixels, powers, 3), np.float32)
        for z in range(powers):
            nodes = self.data.tree.means(light.radiance[z])
            for part in self.view.parts:
                if part.object not in kept:
                    V[self._pixels(part), z] += row_light(self.basis, self.view, part, nodes, state)
        return FrozenPart(
            object=-1,
            indirect=False,
            pixel=np.arange(pixels, dtype=np.int32),
            F=np.ascontiguousarray(V.transpose(2, 0, 1)),
            cos_theta_o=np.ones(pixels, np.float32),
            slice=None,
        )

    def _pixels(self, part: RowTransfer) -> Int32:
        return part.row if part.object < 0 else self.view.rows.pixel[part.row]

    def _open(self, index: int, light: CellLight, state: State, samples: int) -> list[FrozenPart]:
        """An object's columns, with the powers: F float32 [3, r, columns · powers]."""
        direct = self.direct.columns(self.name, index, state, samples)
        powers = len(light.monomials)
        flat = light.radiance.transpose(1, 0, 2).reshape(self.data.tree.cells, 3 * powers)
        nodes = self.data.tree.means(flat)
        rows = np.flatnonzero(self.view.rows.object == index).astype(np.int32)
        result = []
        for part in self.view.parts:
            if part.object != index:
                continue
            received = apply_open(part.transfer, nodes)
            F = received.reshape(len(rows), -1, powers, 3) * part.tint[:, None, None]
            pieces = [piece for piece in self.basis.slices(index) if piece.layer == part.layer]
            first = pieces[0].start
            F[:, :, 0] += direct[:, first : pieces[-1].stop]
            result += [self._part(index, rows, piece, first, F) for piece in pieces]
        return result

    def _part(
        self, index: int, rows: Int32, piece: ColumnSlice, first: int, F: Float32
    ) -> FrozenPart:
        own = F[:, piece.start - first : piece.stop - first]
        planes = np.ascontiguousarray(own.transpose(3, 0, 1, 2))
        return FrozenPart(
            object=index,
            indirect=False,
            pixel=self.view.rows.pixel[rows],
            F=planes.reshape(3, len(rows), -1),
            cos_theta_o=self.view.rows.cos_theta_o[rows],
            slice=piece,
        )

    def _check_memory(self, kept: tuple[int, ...], powers: int) -> None:
        rows = np.bincount(self.view.rows.object, minlength=len(self.basis.objects))
        # Each value is there twice while parts are made
        need = sum(24 * powers * int(rows[i]) * self.basis.columns(i) for i in kept)
        limit = machine_memory() // 2
        if need > limit:
            names = ", ".join(self.basis.objects[i].id for i in kept)
            raise TooLarge(
                f"selecting {names} together needs {need / 1e9:.1f} GB and at most "
                f"{limit / 1e9:.1f} GB may be used: select fewer objects at a time"
            )
