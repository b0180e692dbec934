"""Scenes: loading, the objects that can be edited, views, device choice, the examples."""

from __future__ import annotations

from burnish.core.errors import MissingRayTracer

try:
    import mitsuba as _mitsuba  # noqa: F401
except (ImportError, NameError) as error:
    # Where a system library such as libatomic is missing, Dr.Jit answers with a NameError
    raise MissingRayTracer(
        f"Mitsuba 3 cannot be imported here ({error.__context__ or error}); it is needed to load a "
        "scene or trace rays: pip install mitsuba. A baked bundle opens and edits without it"
    ) from error

from burnish.scene.loading import Scene, load
from burnish.scene.maps import WeightMap
from burnish.scene.objects import SceneObject
from burnish.scene.views import View

__all__ = ["Scene", "SceneObject", "View", "WeightMap", "load"]
