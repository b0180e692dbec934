"""Scenes: loading, the objects that can be edited, views, device choice, the examples."""

from __future__ import annotations

from burnish.core.errors import MissingRayTracer

try:
    import mitsuba as _mitsuba  # noqa: F401
except ImportError as error:
    raise MissingRayTracer(
        f"Mitsuba 3 cannot be imported here ({error}); it is needed to load a scene or trace "
        "rays: pip install mitsuba. A baked bundle opens and edits without it"
    ) from error

from burnish.scene.loading import Scene, load
from burnish.scene.maps import WeightMap
from burnish.scene.objects import SceneObject
from burnish.scene.views import View

__all__ = ["Scene", "SceneObject", "View", "WeightMap", "load"]
