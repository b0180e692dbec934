"""Find the material that gives a picture: a photograph, a painting, another renderer's image.

The image is a polynomial in the coefficients, so its derivative by every parameter is exact
and costs about as much as a frame (see `jacobian`): 2015's question how to solve for the
BRDF that was painted becomes a small least-squares problem.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from burnish.core.errors import InvalidValue, UnknownName
from burnish.core.types import AnyArray, Float32, Float64, Int64, Value
from burnish.materials.curve import Curve
from burnish.materials.layer import MaterialState
from burnish.runtime.tonemap import ToneMap
from burnish.session.findings import (
    Fit,
    FittedNumber,
    identify,
    likely_deviation,
    structure_of,
)
from burnish.session.jacobian import PictureModel
from burnish.session.leastsquares import descend
from burnish.session.objective import Objective, Wish, starts
from burnish.session.session import Session
from burnish.session.unknowns import CurveKnob, CurveOptions, Knob, Unknown, unknowns_of
from burnish.transport.basis import State

_SEARCH_PIXELS = 4096
_SEARCH_STEPS = 5
_FEW_PIXELS = 32768
"""Pixels on which a fit converges before all take part: 10 steps a second, however large."""
_ALL_STEPS = 6
_SEED = 20150320


@dataclass(frozen=True)
class FitOptions:
    """How to fit; the defaults suit a noisy picture of a material that may be far away.

    tone: the target holds encoded display colours in [0, 1] made by this tone map; None for
    linear radiance. curve: how curves are fitted. prior: what moving a parameter by its
    whole range costs, as a share of the target: what the picture leaves free stays near the
    present material. physical: the material reflects no more than it receives. robust:
    outliers pull no harder than five standard deviations. starts: how many other shapes of
    lobes are tried, 0 to go down from the present material alone. steps: at most so many.
    Raises InvalidValue.
    """

    tone: ToneMap | None = None
    curve: CurveOptions = field(default_factory=CurveOptions)
    prior: float = 1e-3
    physical: bool = True
    robust: bool = True
    starts: int = 6
    steps: int = 60

    def __post_init__(self) -> None:
        if not 0 < self.prior <= 1e3:
            raise InvalidValue(f"prior must lie in (0, 1000]; got {self.prior!r}")
        if not 0 <= self.starts <= 1000:
            raise InvalidValue(f"starts must lie in [0, 1000]; got {self.starts!r}")
        if not 1 <= self.steps <= 10000:
            raise InvalidValue(f"steps must lie in [1, 10000]; got {self.steps!r}")


@dataclass(frozen=True)
class FitStep:
    """Where a fit stands. state: the materials of all objects, to show. error: as in `Fit`,
    over the pixels in use. result: what was found, in the last step alone."""

    number: int
    state: State
    error: float
    result: Fit | None = None


def fit(
    session: Session,
    target: AnyArray,
    *,
    mask: AnyArray | None = None,
    objects: Sequence[str] | None = None,
    parameters: Sequence[str] | None = None,
    view: str | None = None,
    options: FitOptions | None = None,
) -> Fit:
    """Give the session the material that comes closest to a target, as one step of undo.

    Takes what `fit_steps` takes and raises what it raises; then nothing has changed.
    """
    result = None
    for step in fit_steps(
        session,
        target,
        mask=mask,
        objects=objects,
        parameters=parameters,
        view=view,
        options=options,
    ):
        result = step.result
    assert result is not None
    session.restore(result.state, "Fitted " + _shown(list(result.values)))
    return result


def fit_steps(
    session: Session,
    target: AnyArray,
    *,
    mask: AnyArray | None = None,
    objects: Sequence[str] | None = None,
    parameters: Sequence[str] | None = None,
    view: str | None = None,
    options: FitOptions | None = None,
) -> Iterator[FitStep]:
    """The same, step by step, for an editor that shows them; leave the loop to stop.

    target: [height, width, 3], linear RGB or, with `options.tone`, display colours; where it
    is NaN nothing is asked. mask: [height, width], bool or weights >= 0. Pixels in which a
    lamp is seen directly never count. objects: whose materials may change; those selected,
    or all, without it. parameters: full paths ("box.specular.roughness") or what stands after
    an object's id ("diffuse.color", "specular.weight", "specular.curve"); without it, all of
    layers that reflect something, weights and curves left out. The objects become selected;
    the session's materials are left alone until someone restores `step.state`:

    >>> with session.gesture():                                        # doctest: +SKIP
    ...     for step in fit_steps(session, target, objects=["teapot"]):
    ...         session.restore(step.state)
    ...         show(session.frame())

    Raises UnknownName, InvalidValue, TooLarge at the first step.
    """
    began = time.perf_counter()
    chosen = options or FitOptions()
    state = dict(session.state)
    unknowns = chosen_unknowns(session, objects, parameters, chosen.curve)
    wish = _wish(session, view, target, mask, chosen.tone)
    frozen = session.renderer(view).frozen
    pixels = wish.pixels
    count = 0

    def objective(model: PictureModel) -> Objective:
        return Objective(model, wish, model.read(state), chosen.prior, chosen.physical)

    # Look around on few pixels, for the shape from which the way leads down
    few = objective(PictureModel(frozen, unknowns, state, _sample(pixels, _SEARCH_PIXELS)))
    first = few.model.read(state)
    x, best, error = first, np.inf, np.inf
    candidates = starts(few.model, first, chosen.starts)
    for candidate in candidates if len(candidates) > 1 else ():
        for place in descend(few, candidate, _SEARCH_STEPS, 1e-3):
            if place.cost < best:
                x, best, error = place.x, place.cost, _relative(few, place.x)
            count += 1
            yield FitStep(count, few.model.state(x), error)

    # Go down: on some pixels, then on all; at last with outliers held back
    some = _sample(pixels, _FEW_PIXELS)
    stages = [(some, chosen.steps)] if len(some) < len(pixels) else []
    stages.append((pixels, _ALL_STEPS if stages else chosen.steps))
    whole = few
    for part, limit in stages:
        if len(part) > len(whole.model.pixels):
            whole = objective(PictureModel(frozen, unknowns, state, part))
        for place in descend(whole, x, limit):
            x, count = place.x, count + 1
            yield FitStep(count, whole.model.state(x), _relative(whole, x))
    whole.huber = _outlier(whole, x) if chosen.robust else 0.0
    if whole.huber > 0:
        for place in descend(whole, x, stages[-1][1]):
            x, count = place.x, count + 1
            yield FitStep(count, whole.model.state(x), _relative(whole, x))

    fitted_state = whole.model.state(x)
    limits = _limits(whole, x)
    if chosen.physical:
        fitted_state = _physical(session, whole.model, fitted_state)
    result = _findings(session, view, whole, wish, x, state, fitted_state, limits, count, began)
    yield FitStep(count, fitted_state, result.error, result)


def chosen_unknowns(
    session: Session,
    objects: Sequence[str] | None,
    parameters: Sequence[str] | None,
    curve: CurveOptions,
) -> tuple[Unknown, ...]:
    """What names stand for in a session; the objects become selected.

    Raises UnknownName, InvalidValue, TooLarge.
    """
    ids, state = _objects(session, objects, parameters), session.state
    varied = [
        name
        for name, item in state.items()
        if (material := session.material(name)) is not None and material.varies(item)
    ]
    if varied:
        raise InvalidValue(
            f"{', '.join(varied)} is painted or has maps, and a fit is of uniform materials: erase "
            'the paint first, session.paint_whole("eraser", [...]), and take the maps off, '
            "session.clear_map(path)"
        )
    if session.light_mix.factors(state) is not None:
        raise InvalidValue(
            "lights are mixed, and a fit needs transport that tells them apart: reset the lights, "
            "or bake with --light-groups"
        )
    materials = {name: item for name in state if (item := session.material(name)) is not None}
    unknowns = unknowns_of(materials, state, ids, parameters, curve)
    fitted = tuple(dict.fromkeys(item.object for item in unknowns))
    if not set(fitted) <= set(session.selected):
        session.select(*fitted)
    return unknowns


def _objects(
    session: Session, objects: Sequence[str] | None, parameters: Sequence[str] | None
) -> tuple[str, ...]:
    editable = [item.id for item in session.objects if session.material(item.id) is not None]
    if objects is None:
        named = [
            name for name in editable if any(p.startswith(f"{name}.") for p in parameters or ())
        ]
        return tuple(named or session.selected or editable)
    for name in objects:
        if name not in editable:
            raise UnknownName("editable object", name, editable)
    if not objects:
        raise InvalidValue("objects must name at least one editable object; got none")
    return tuple(dict.fromkeys(objects))


def _wish(
    session: Session,
    view: str | None,
    target: AnyArray,
    mask: AnyArray | None,
    tone: ToneMap | None,
) -> Wish:
    views = session.views
    transport = views[view if view is not None and view in views else next(iter(views))]
    if view is not None and view not in views:
        raise UnknownName("view", view, views)
    shape = (transport.height, transport.width)
    wanted = np.asarray(target, np.float32)
    if wanted.shape != (*shape, 3):
        raise InvalidValue(
            f"target must have the view's shape {(*shape, 3)}; got {wanted.shape}: resize it"
        )
    weight = np.ones(shape, np.float32) if mask is None else np.asarray(mask).astype(np.float32)
    if weight.shape != shape:
        raise InvalidValue(f"mask must have the view's shape {shape}; got {weight.shape}")
    if not (np.isfinite(weight).all() and (weight >= 0).all()):
        raise InvalidValue("mask must be bool or weights that are finite and >= 0")
    lamps = session.emission(view).max(axis=2) > 0.5 * session.frame(view).max(axis=2)
    asked = np.isfinite(wanted).all(axis=2) & ~lamps
    weight = np.where(asked, weight, np.float32(0.0))
    if not weight.any():
        raise InvalidValue("the target asks for nothing: every pixel is masked, NaN or a lamp")
    filled = np.where(asked[..., None], wanted, np.float32(0.0))
    return Wish(filled.reshape(-1, 3), weight.ravel(), tone)


def _sample(pixels: Int64, count: int) -> Int64:
    """At most `count` of the pixels, spread evenly and always the same."""
    if len(pixels) <= count:
        return pixels
    strata = np.linspace(0, len(pixels), count + 1)
    place = strata[:-1] + np.random.default_rng(_SEED).random(count) * np.diff(strata)
    return np.asarray(pixels[np.unique(place.astype(np.int64))])


def _relative(objective: Objective, x: Float64) -> float:
    return float(np.linalg.norm(objective.residual(x).astype(np.float64))) / objective.size


def _outlier(objective: Objective, x: Float64) -> float:
    """Five standard deviations of the residual, by its median; 0 where there is no noise.

    Traced noise is skewed: a tighter hold would darken the fit.
    """
    size = np.abs(objective.residual(x))
    seen = size[size > 0]
    deviation = 1.4826 * float(np.median(seen)) if len(seen) else 0.0
    floor = 1e-4 * objective.size / np.sqrt(max(size.size, 1))
    return 5 * deviation if deviation > floor else 0.0


def _limits(objective: Objective, x: Float64) -> tuple[str, ...]:
    """For every number: at which bound the target still pulls outwards, "" for none."""
    H, g = objective.normal(x)
    slack = 1e-6
    # A pull counts when following it would gain more than rounding does
    pulls = g**2 > 1e-6 * np.maximum(np.diag(H), 1e-300) * 2 * objective.cost(x)
    low = (x <= objective.lower + slack) & (g > 0) & pulls
    high = (x >= objective.upper - slack) & (g < 0) & pulls
    return tuple("minimum" if a else "maximum" if b else "" for a, b in zip(low, high, strict=True))


def _physical(
    session: Session, model: PictureModel, state: dict[str, MaterialState]
) -> dict[str, MaterialState]:
    """Take away what little energy the cost of an excess has left above 1."""
    result = dict(state)
    for name in model.fitted_objects:
        own = [item for item in model.unknowns if item.object == name and item.amplitude]
        low, high = 0.0, 1.0

        def dimmed(factor: float, name: str = name, own: list = own) -> MaterialState:  # type: ignore[type-arg]
            material = state[name]
            for item in own:
                material = item.scaled(material, factor)
            return material

        def excess(material: MaterialState, name: str = name) -> float:
            return float(model.albedo(name, {**result, name: material}).max()) - 1.0

        if not own or excess(state[name]) <= 1e-9 or excess(dimmed(0.0)) > 0:
            continue
        for _ in range(40):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if excess(dimmed(middle)) <= 0 else (low, middle)
        result[name] = dimmed(low)
    return result


def _findings(
    session: Session,
    view: str | None,
    objective: Objective,
    wish: Wish,
    x: Float64,
    before: State,
    after: State,
    limits: tuple[str, ...],
    steps: int,
    began: float,
) -> Fit:
    renderer = session.renderer(view)
    shape = (renderer.frozen.height, renderer.frozen.width)
    weight = wish.weight.reshape(*shape).astype(np.float64)
    target = wish.target.reshape(*shape, 3)
    size = float(np.linalg.norm(weight[..., None] * target)) or 1.0

    def gap(state: State) -> Float32:
        shown = wish.shown(renderer.image(state)) - target
        return np.where(weight[..., None] > 0, shown, np.float32(0.0)).astype(np.float32)

    residual = gap(after)
    weighted = residual * weight[..., None]
    names = tuple(name for item in objective.model.unknowns for name in item.names())
    share = (3 * int((weight > 0).sum())) ** 0.5 / size
    structure = structure_of(weighted, weight)
    deviation = likely_deviation(weighted, weight, size)
    thinned = len(objective.model.pixels) / max(int((weight > 0).sum()), 1)
    spread, directions = identify(
        objective.information(x) / thinned, names, deviation, objective.size / thinned**0.5
    )
    values: dict[str, Value | Curve] = {}
    for item in objective.model.unknowns:
        if isinstance(item, Knob):
            values[item.path] = item.value(after[item.object])
        elif isinstance(item, CurveKnob):
            curve = after[item.object].layers[item.layer.name].curve
            assert curve is not None
            values[item.path] = curve
    reached = structure * share
    reasons = [f"{name} at its {limit}" for name, limit in zip(names, limits, strict=True) if limit]
    for name, total in zip(objective.model.fitted_objects, objective.model.albedos(x), strict=True):
        if objective.physical and total.max() > 1 - 1e-6:
            reasons.append(f"{name} reflects all that it receives")
    return Fit(
        state=after,
        values=values,
        error=float(np.linalg.norm(weighted)) / size,
        error_before=float(np.linalg.norm(gap(before) * weight[..., None])) / size,
        structure=reached,
        residual=residual,
        numbers=tuple(
            FittedNumber(name, float(d), limit)
            for name, d, limit in zip(names, spread, limits, strict=True)
        ),
        directions=directions,
        limited=tuple(reasons),
        steps=steps,
        seconds=time.perf_counter() - began,
    )


def _shown(paths: Sequence[str]) -> str:
    return ", ".join(paths[:3]) + (f" and {len(paths) - 3} more" if len(paths) > 3 else "")
