"""Relighting sessions: a scene whose lights and materials are edited together (2010)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from burnish.core.types import Crop, Float32, Progress
from burnish.materials.lights import each
from burnish.transport.basis import State

if TYPE_CHECKING:
    from burnish.precompute.relight.studio import RelitScene
    from burnish.reference.truth import PathTracedTruth
    from burnish.scene import Scene
    from burnish.scene.lights import SceneLight
    from burnish.session import Session

SERIES = (16, 1, 1, 1)
"""Bins of a layer, and as many further bounces as there are ones."""
SAMPLES = 16384
AWAY = 8.0
"""How many times the size of a scene its lamps are put away."""


def relight_session(
    source: str | Path | Mapping[str, Any] | Scene,
    *,
    series: Sequence[int] = SERIES,
    samples: int = SAMPLES,
    rays: int = 256,
    seed: int = 0,
    progress: Progress | None = None,
    **options: Any,
) -> Session:
    """A session on a scene in mode "relight".

    series: see `Basis`; after the first bounce all is matte. samples: gather samples. rays:
    through each pixel, a square. options: as `burnish.load` takes them; a Scene is loaded again
    with those. Raises what loading raises.
    """
    from burnish.precompute.plan import basis_for
    from burnish.precompute.relight.build import Settings, precompute
    from burnish.precompute.relight.studio import RelitScene
    from burnish.reference.truth import PathTracedTruth
    from burnish.runtime.relight.transport import RelightView
    from burnish.scene import Scene, load
    from burnish.scene.views import projection
    from burnish.session import ObjectInfo, Session
    from burnish.session.lightmix import LightMix

    if isinstance(source, Scene):
        wanted = {**source.request.options, **options}
        scene = load(source.request.scene, **wanted) if options else source
        # Its lights are moved in place, and what a user holds stays as it is
        own = load(source.request.scene, **wanted)
    else:
        scene, own = load(source, **options), load(source, **options)
    basis = basis_for(own, None, series)
    settings = Settings(samples=samples, rays=rays, seed=seed)
    with without_lamps(own):
        data = precompute(own, basis, settings=settings, progress=progress, lit=scene)
    studio = RelitScene(own, data)
    views = {name: RelightView(data, name, studio) for name in data.views}
    for name, view in views.items():
        view.camera = projection(scene.view(name))
    editable = {item.id: item.material for item in basis.objects}
    objects = [
        ObjectInfo(
            item.id,
            item.id in editable,
            item.reason,
            editable[item.id].layers if item.id in editable else (),
        )
        for item in scene.objects
    ]
    truth = RelightTruth(PathTracedTruth(scene, basis.bounces), studio)
    session = Session(views, objects, truth, scene.name, each(scene.lights))
    # The views are lit as the state says, and nothing is mixed after them
    session.light_mix = LightMix((), None)
    for view in views.values():
        view.interactive = lambda: session.light_mix.background
        session.on_change(lambda view=view: view.follow(session.state))  # type: ignore[misc]
    return session


@contextmanager
def without_lamps(scene: Scene) -> Iterator[None]:
    """Put a scene's lamps far away for a while: light that comes round then passes where they
    stand, and where they may come to stand."""
    from burnish.scene.moving import LightMover

    box = scene.mi_scene.bbox()
    far = np.asarray(box.max) + float(np.linalg.norm(np.asarray(box.extents()))) * AWAY
    mover = LightMover(scene)
    mover.place(
        {
            light.name: {"position": (float(far[0]), float(far[1]), float(far[2]))}
            for light in scene.lights
            if light.kind == "area" and light.shapes and "position" in _names(light)
        }
    )
    yield
    mover.place({})


def _names(light: SceneLight) -> list[str]:
    return [item.name for item in light.parameters]


class RelightTruth:
    """The path tracer beside the direct light's, one at a time."""

    def __init__(self, tracer: PathTracedTruth, studio: RelitScene) -> None:
        self.tracer, self._studio = tracer, studio

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
        with self._studio.lock:
            return self.tracer.render(state, view, spp, seed, progress, crop)
