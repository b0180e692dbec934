"""Which light group the light of an emitter belongs to, as a device table."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.scene import Scene
from burnish.transport.basis import Basis


class EmitterGroups:
    """The light groups of a basis, by emitter. count: 0 where all light is one."""

    def __init__(self, scene: Scene, basis: Basis) -> None:
        self.count = len(basis.lights)
        group_of = {name: g for g, group in enumerate(basis.lights) for name in group.members}
        groups = np.array([group_of.get(light.name, 0) for light in scene.lights], np.uint32)
        self._table = mi.UInt32(groups[scene.light_table])
        dr.make_opaque(self._table)

    def of(self, emitter: Any, active: Any) -> Any:
        """The group of each lane's emitter (mi.EmitterPtr)."""
        if not self.count:
            return mi.UInt32(0)
        number = dr.reinterpret_array(mi.UInt32, emitter)
        return dr.gather(mi.UInt32, self._table, number, active)
