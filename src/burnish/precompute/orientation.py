"""In which frame a material reflects: its side of the surface, and its bent normal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi


@dataclass(frozen=True)
class Orientation:
    """From the shading frame to the frame that a material of ours reflects in, and back.

    wo: towards the viewer, in the material's frame. flip: lanes whose shading frame is mirrored.
    frame: the bent frame in the (mirrored) shading frame, mi.Frame3f, or None where no object
    has one; flip_bent: lanes mirrored in it too. shadows: lanes that lose light to the slopes
    of the bent surface (Estevez et al. 2019, eq. 2-4).
    """

    wo: Any
    flip: Any
    frame: Any = None
    flip_bent: Any = None
    shadows: Any = None

    @staticmethod
    def of(wo: Any, flip: Any, normal: Any, two_sided: Any, shadows: Any) -> Orientation:
        """With a bent normal; wo in the shading frame, mirrored already."""
        frame = mi.Frame3f(normal)
        bent = frame.to_local(wo)
        flip_bent = two_sided & (bent.z < 0)
        bent.z = dr.select(flip_bent, -bent.z, bent.z)
        return Orientation(bent, flip, frame, flip_bent, shadows)

    def to_local(self, shading: Any) -> tuple[Any, Any]:
        """A direction to the light in the material's frame, and a factor on its light."""
        wi = mi.Vector3f(shading)
        wi.z = dr.select(self.flip, -wi.z, wi.z)
        if self.frame is None:
            return wi, mi.Float(1)
        bent = self.frame.to_local(wi)
        factor = self._factor(wi, bent)
        bent.z = dr.select(self.flip_bent, -bent.z, bent.z)
        return bent, factor

    def to_shading(self, local: Any) -> tuple[Any, Any]:
        """The inverse: a direction in the shading frame, and the factor on its light."""
        wi = mi.Vector3f(local)
        factor = mi.Float(1)
        if self.frame is not None:
            wi.z = dr.select(self.flip_bent, -wi.z, wi.z)
            bent = wi
            wi = self.frame.to_world(bent)
            factor = self._factor(wi, bent)
        wi.z = dr.select(self.flip, -wi.z, wi.z)
        return wi, factor

    def _factor(self, wi: Any, bent: Any) -> Any:
        """No light from below the shading frame; less where the slopes shadow each other."""
        alpha2 = dr.minimum(0.125 * mi.Frame3f.tan_theta_2(self.frame.n), 1)
        kept = 2 / (1 + dr.sqrt(1 + alpha2 * mi.Frame3f.tan_theta_2(wi)))
        return dr.select(wi.z * bent.z > 0, dr.select(self.shadows, kept, 1), 0)
