"""Open Image Denoise for the resting picture: guided by albedo and normal of each view.

Nothing that is measured, saved or dragged passes through here.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass

import mitsuba as mi
import numpy as np

from burnish.core.errors import MissingRayTracer
from burnish.core.types import Float32
from burnish.scene import Scene, View

GUIDE_SAMPLES = 16


def available() -> bool:
    """Whether the denoiser's library is installed."""
    return importlib.util.find_spec("pyoidn") is not None


@dataclass(frozen=True)
class Denoiser:
    """The guides of one view: albedo and shading normal, float32 [height, width, 3]."""

    albedo: Float32
    normal: Float32

    @staticmethod
    def of(scene: Scene, view: View) -> Denoiser:
        """Trace a view's guides. Raises MissingRayTracer without the library."""
        if not available():
            raise MissingRayTracer(
                "the denoiser needs Open Image Denoise; install it with: pip install pyoidn"
            )
        integrator = mi.load_dict({"type": "aov", "aovs": "albedo:albedo,normal:sh_normal"})
        guides = mi.render(
            scene.mi_scene, sensor=view.sensor, integrator=integrator, spp=GUIDE_SAMPLES
        )
        values = np.array(guides, np.float32)
        albedo = np.clip(np.ascontiguousarray(values[..., :3]), 0, 1)
        return Denoiser(albedo, np.ascontiguousarray(values[..., 3:6]))

    def clean(self, image: Float32) -> Float32:
        """A noisy picture without its noise: float32 [height, width, 3], linear RGB."""
        import pyoidn

        picture = np.ascontiguousarray(image, np.float32)
        cleaned = pyoidn.denoise(picture, albedo=self.albedo, normal=self.normal, hdr=True)
        return np.asarray(cleaned, np.float32)
