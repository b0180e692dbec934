"""From what a user names, a scene or a bundle, to something that can be edited."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from burnish.core.errors import InvalidValue, MissingFile
from burnish.core.types import Crop, Float32, Progress
from burnish.materials.lights import LightGroup, each
from burnish.transport.basis import Basis, State
from burnish.transport.frozen import Frozen
from burnish.transport.rows import Rows

if TYPE_CHECKING:
    from burnish.precompute.light_pictures import LightTracer
    from burnish.reference.truth import PathTracedTruth
    from burnish.scene import Scene
    from burnish.session import Session
    from burnish.store.bundle import Bundle


def names_bundle(source: str | Path) -> bool:
    """Whether a name is a bundle's: it ends in .burnish, or is a folder."""
    return Path(source).suffix == ".burnish" or Path(source).is_dir()


def open_bundle(source: str | Path) -> Bundle:
    """Open a bundle. Raises MissingFile, BundleError."""
    from burnish.store.bundle import open_bundle

    return open_bundle(source)


def session_for(bundle: Bundle) -> Session:
    """A session on all views of a bundle; its truth loads the scene when it is first asked."""
    from burnish.session import ObjectInfo, Session

    materials = {item.id: item.material for item in bundle.basis.objects}
    objects = [
        ObjectInfo(
            item.id,
            item.id in materials,
            item.reason,
            materials[item.id].layers if item.id in materials else (),
        )
        for item in bundle.header.objects
    ]
    truth = BundleTruth(bundle)
    lights = each(bundle.header.lights)
    return Session(bundle.views, objects, truth, bundle.header.name, lights, truth)


def edits_for(scene: Scene, bounces: int | None = None) -> Session:
    """A session on a scene for its edits alone; its pictures come from the path tracer.

    bounces: scattering events per path, all without a number.
    """
    from burnish.precompute.plan import basis_for
    from burnish.reference.truth import PathTracedTruth
    from burnish.session import ObjectInfo, Session

    basis = basis_for(scene)
    objects = [
        ObjectInfo(
            item.id,
            item.editable,
            item.reason,
            item.material.layers if item.material else (),
        )
        for item in scene.objects
    ]
    views = {view.name: UntracedView(basis, view.width, view.height) for view in scene.views}
    return Session(views, objects, PathTracedTruth(scene, bounces), scene.name, each(scene.lights))


def scene_of(bundle: Bundle, source: str | Path | None = None) -> Scene:
    """Load the scene that a bundle was baked from.

    source: where it is now, when the bundle's own note of it does not hold. Raises
    InvalidValue when it was a dictionary or has changed since, MissingFile, MissingRayTracer.
    """
    from burnish.scene import load
    from burnish.scene.examples import EXAMPLES

    noted = source or bundle.header.provenance.get("scene")
    if noted is None:
        raise InvalidValue(
            f"bundle {str(bundle.path)!r} was baked from a dictionary, which it cannot find again; "
            "write the scene to a file and bake that"
        )
    place: str | Path = noted
    if source is None and noted not in [example.name for example in EXAMPLES]:
        place = bundle.path.absolute().parent / noted
        if not place.is_file():
            raise MissingFile(
                f"bundle {str(bundle.path)!r} was baked from {str(place)!r}, which is not there; "
                "name the scene with --scene"
            )
    # The scene's own resolution, then the bundle's, where the bake chose another
    wanted = bundle.header.provenance.get("scene_hash")
    view = bundle.header.views[0]
    for resolution in (None, (view.width, view.height)):
        scene = load(place, resolution=resolution, models=bundle.header.provenance.get("models"))
        if scene.hash == wanted:
            return scene
    raise InvalidValue(
        f"scene {str(noted)!r} has changed since bundle {str(bundle.path)!r} was baked; bake it "
        "again, or name the scene as it was with --scene"
    )


@dataclass(frozen=True)
class UntracedView:
    """A `Transport` that says what can be edited and has no picture to show it in."""

    basis: Basis
    width: int
    height: int
    revision: int = 0
    relights: bool = True
    """The path tracer sees the lights wherever they stand."""

    @property
    def rows(self) -> Rows:
        """None are known."""
        return Rows.empty()

    @property
    def emission(self) -> Float32:
        """Black: float32 [height, width, 3]."""
        return np.zeros((self.height, self.width, 3), np.float32)

    def freeze(self, targets: tuple[int, ...], state: State, fine: tuple[int, ...] = ()) -> Frozen:
        """Raises InvalidValue: nothing has been traced."""
        raise InvalidValue("the scene has not been baked; bake it first: burnish bake")


class BundleTruth:
    """The `Truth` of a bundle and its `LightPictures`: path tracers on its scene, which is
    loaded when first asked.

    bounces are the bundle's, so that what differs are bins, series and noise alone. Both may be
    asked from several threads; one at a time is answered.
    """

    def __init__(self, bundle: Bundle, source: str | Path | None = None) -> None:
        self._bundle = bundle
        self._source = source
        self._tracer: PathTracedTruth | None = None
        self._lights: tuple[object, LightTracer] | None = None
        self._alone = threading.Lock()

    @property
    def tracer(self) -> PathTracedTruth:
        """The path tracer itself. Raises as `scene_of` does."""
        if self._tracer is None:
            scene = scene_of(self._bundle, self._source)
            from burnish.reference.truth import PathTracedTruth

            self._tracer = PathTracedTruth(scene, self._bundle.basis.bounces)
        return self._tracer

    def render(
        self,
        state: State,
        view: str,
        spp: int,
        seed: int = 0,
        progress: Progress | None = None,
        crop: Crop | None = None,
    ) -> Float32:
        """float32 [height, width, 3], linear RGB; with a crop, of its pixels alone."""
        with self._alone:
            return self.tracer.render(state, view, spp, seed, progress, crop)

    def light_pictures(
        self, state: State, view: str, groups: Sequence[LightGroup], spp: int, seed: int
    ) -> tuple[Float32, Float32]:
        """What each light group adds to a view; see `LightPictures`."""
        asked = view, dict(state), tuple(groups)
        with self._alone:
            scene = self.tracer.scene
            from burnish.precompute.light_pictures import LightTracer

            if self._lights is None or self._lights[0] != asked:
                tracer = LightTracer(scene, scene.view(view), self._bundle.basis, state, groups)
                self._lights = asked, tracer
            return self._lights[1].pictures(spp, seed)
