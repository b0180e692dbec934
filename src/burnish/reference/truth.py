"""The truth: Mitsuba's own path tracer, given the scene with the edited materials in it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import drjit as dr
import mitsuba as mi

from burnish.core.errors import InvalidValue
from burnish.core.types import RGB, Crop, Float32, Progress, Value
from burnish.materials.layer import MaterialState
from burnish.materials.lights import factors, placements, without_lights
from burnish.reference.bsdf import layered_bsdf, wrapped
from burnish.reference.film import Estimate, trace
from burnish.reference.painted import painted_bsdf
from burnish.scene import Scene, SceneObject
from burnish.scene.lights import by_channel

State = Mapping[str, MaterialState]
"""Object id to the state of its material, and lights by their keys (`materials.lights`); what
is not named is as the scene has it."""

_Known = tuple[dict[str, MaterialState], dict[str, RGB], dict[str, dict[str, Value]]]


class PathTracedTruth:
    """Path-traced pictures of a scene with any state of its materials.

    An object in the state that the scene gave it keeps the scene's own BSDF, unless its
    material was assigned to it; an edited one gets Mitsuba's own plugin with the edited
    parameters where one can hold them, and `LayeredBSDF` with burnish's materials where none
    can.

    A light that Mitsuba cannot tint, its daylight, is rendered in grey for each channel.

    bounces: scattering events per path, 1 or more; None for no limit (Russian roulette).
    """

    def __init__(self, scene: Scene, bounces: int | None = None) -> None:
        if bounces is not None and bounces < 1:
            raise InvalidValue(f"bounces must be at least 1, or None for no limit; got {bounces}")
        self.scene = scene
        self.bounces = bounces
        settings: dict[str, Any] = {"type": "path"}
        if bounces is not None:
            # Roulette only adds noise where the depth is limited anyway
            settings |= {"max_depth": bounces + 1, "rr_depth": bounces + 2}
        self._integrator = mi.load_dict(settings)
        self._state: _Known = {}, {}, {}
        self._scenes: tuple[Any, ...] = (scene.mi_scene,)

    def render(
        self,
        state: State,
        view: str,
        spp: int,
        seed: int = 0,
        progress: Progress | None = None,
        crop: Crop | None = None,
    ) -> Float32:
        """The picture, or its crop: float32 [height, width, 3], linear RGB."""
        return self.estimate(state, view, spp, seed, progress, crop).image

    def estimate(
        self,
        state: State,
        view: str | None = None,
        spp: int = 64,
        seed: int = 0,
        progress: Progress | None = None,
        crop: Crop | None = None,
    ) -> Estimate:
        """The picture with its halves, its variance and its directly seen emission.

        view: the scene's first when None. spp: at least 2. crop: only these pixels. Raises
        UnknownName, InvalidValue.
        """
        scenes = self.scenes(state)

        def radiance(sampler: Any, ray: Any) -> tuple[Any, Any]:
            light, seen = mi.Color3f(0), mi.Color3f(0)
            for first, scene in enumerate(scenes):
                sampled, _, _ = self._integrator.sample(scene, sampler, ray)
                found = mi.Color3f(sampled), directly_seen(scene, ray)
                # The first scene is of all channels, where it is the only one
                for channel in range(first, 3):
                    light[channel], seen[channel] = found[0][channel], found[1][channel]
            return light, seen

        return trace(radiance, self.scene.view(view), spp, seed, progress, crop)

    def mi_scene(self, state: State) -> Any:
        """The one mi.Scene of a state. Raises InvalidValue where there is one for each channel."""
        scenes = self.scenes(state)
        if len(scenes) > 1:
            raise InvalidValue(
                "no one Mitsuba scene holds tinted daylight; reset the tint, or render each "
                "channel by itself"
            )
        return scenes[0]

    def scenes(self, state: State) -> tuple[Any, ...]:
        """The mi.Scene with the materials and lights of a state, or one for each channel where
        a light needs it (`scene.lights.by_channel`); built again when the state changes."""
        edited = {
            item.id: item.material.initial
            for item in self.scene.objects
            if item.material is not None and item.factory is None
        }
        edited |= {
            object_id: item
            for object_id, item in without_lights(state).items()
            if not is_initial(self.scene.object(object_id), item)
        }
        mixed = factors(self.scene.lights, state)
        placed = placements(self.scene.lights, state)
        if (edited, mixed, placed) != self._state:
            bsdfs = {
                object_id: self._bsdf(self.scene.object(object_id), item)
                for object_id, item in edited.items()
            }
            if bsdfs or mixed or placed:
                self._scenes = tuple(
                    self.scene.with_bsdfs(bsdfs, shares, placed)
                    for shares in by_channel(self.scene.lights, mixed)
                )
            else:
                self._scenes = (self.scene.mi_scene,)
            self._state = edited, mixed, placed
        return self._scenes

    def _bsdf(self, item: SceneObject, state: MaterialState) -> Any:
        """The mi.BSDF of an object, its paint and maps in textures. Raises InvalidValue."""
        plain = not (state.strokes or state.images)
        if plain or (not state.strokes and _held(item, state)):
            return edited_bsdf(item, state)
        shapes = self.scene.mi_scene.shapes()
        return painted_bsdf(item, state, [shapes[k] for k in item.shapes])


def _held(item: SceneObject, state: MaterialState) -> bool:
    """Whether an object's weight maps and a plugin of Mitsuba's, or ours, hold its pictures."""
    assert item.material is not None
    if not item.material.varies(state):
        return True
    return not state.replacements and item.described(state) is not None


def edited_bsdf(item: SceneObject, state: MaterialState) -> Any:
    """The mi.BSDF of an object in a state. Raises InvalidValue for a fixed object."""
    if item.material is None:
        raise InvalidValue(f"object {item.id!r} cannot be edited: {item.reason}; leave it out")
    own = None if state.replacements else item.edited_bsdf(state)
    if own is not None:
        return own
    material, maps = item.material.as_in(state), item.maps
    return wrapped(item, lambda sides: layered_bsdf(material, state, maps, sides))


def is_initial(item: SceneObject, state: MaterialState) -> bool:
    """Whether a state is the one that the scene's own BSDF of an object shows."""
    if item.material is None or item.factory is None:
        return False
    return state == item.material.initial


def directly_seen(scene: Any, ray: Any) -> Any:
    """The emission of what a camera ray meets first, background included: mi.Color3f."""
    si = scene.ray_intersect(ray, mi.RayFlags.All, True)
    emitter = si.emitter(scene)
    return dr.select(emitter != None, mi.Color3f(emitter.eval(si)), 0)  # noqa: E711 (per lane)
