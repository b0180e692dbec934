"""A user's own reflectance model, from a quotient and a curve in plain Python."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from burnish.core.errors import InvalidValue, UnknownName
from burnish.core.types import Float64
from burnish.materials.coordinates import COORDINATES, RIGHT_ANGLE
from burnish.materials.maths import Maths, Vector, numpy_maths
from burnish.materials.model import Fixed, Model, Values
from burnish.materials.parameter import Parameter
from burnish.materials.registry import MODELS

Curve = Callable[[Any, Any, Mapping[str, Any]], Any]
"""curve(xp, gamma, values): f, one number or a list of three (linear RGB)."""
Quotient = Callable[[Any, Any, Any, Mapping[str, Any]], Any]
"""quotient(xp, wi, wo, frozen): what is not edited, without the cosine."""
Outgoing = Callable[[Any, Any, Mapping[str, Any]], Any]
"""outgoing(xp, cos_theta_o, values): a factor on the outgoing angle, exact in every edit."""


def user_model(
    name: str,
    *,
    curve: Curve,
    quotient: Quotient | None = None,
    coordinate: str | Quotient = "theta_h",
    maximum: float = RIGHT_ANGLE,
    parameters: Sequence[Parameter] = (),
    frozen: Sequence[Parameter] = (),
    outgoing: Outgoing | None = None,
    lobe: Literal["cosine", "half"] | None = None,
    anisotropic: bool = False,
) -> Model:
    """Make and register the model ρ = s(θo; v) · q(ωi, ωo) · f(γ; v) (2006, eq. 7).

    name: what bundles store. curve: f. quotient: q, 1 without it. outgoing: s, 1 without it.
    coordinate: "theta_h", "theta_d", "theta_r" (nothing beyond 90°), "theta_in", "none" for
      a model that is all quotient (its curve is asked for γ = 0), or a function like the
      quotient that gives γ in [0, maximum].
    parameters: what can be edited; `frozen`: numbers that keep the values that a layer starts
      with, which the quotient may use. `values` holds both, `frozen` only the latter.
    lobe: how directions are drawn, "half" about half vectors or "cosine"; by the coordinate
      without it. anisotropic: whether turning both directions about the normal changes ρ.

    The functions are written with the maths namespace `xp` (see `burnish.materials.maths`), so
    that they run on NumPy arrays and inside the path tracer's kernels: `xp.select` in place of
    `if`, `xp.maximum` in place of `max`. Directions are unit vectors with .x .y .z, the normal
    is z, and both lie above the surface.

    Raises InvalidValue where a name is taken, or where a function fails, gives another shape,
    or gives negative or non-finite numbers at the parameters' defaults.
    """
    taken = MODELS.get(name)
    if not name or (taken is not None and not issubclass(taken, UserModel)):
        raise InvalidValue(f"model name {name!r} is taken or empty; choose another")
    named = isinstance(coordinate, str)
    if named and coordinate not in (*COORDINATES, "none"):
        known = ", ".join((*COORDINATES, "none"))
        raise InvalidValue(
            f"model {name}: coordinate must be one of {known}, or a function; got {coordinate!r}"
        )
    symbol = coordinate if isinstance(coordinate, str) else "gamma"
    if lobe is None:
        lobe = "cosine" if symbol in ("none", "theta_in") else "half"
    inverse = {"theta_h": "half", "gamma": "none"}.get(symbol, "axis")
    members = {
        "__doc__": curve.__doc__,
        "__module__": curve.__module__,
        "module": curve.__module__,
        "name": name,
        "parameters": tuple(parameters),
        "fixed_parameters": tuple(frozen),
        "coordinate_name": symbol,
        "coordinate_maximum": maximum if symbol == "gamma" else RIGHT_ANGLE,
        "lobe": lobe,
        "inverse": inverse,
        "anisotropic": anisotropic,
        "_functions": _Functions(
            curve, quotient, outgoing, None if isinstance(coordinate, str) else coordinate
        ),
    }
    kind = type(_class_name(name), (UserModel,), members)
    model: UserModel = kind()
    _try(model)
    MODELS[name] = kind
    return model


@dataclass(frozen=True)
class _Functions:
    curve: Curve
    quotient: Quotient | None
    outgoing: Outgoing | None
    coordinate: Quotient | None


@dataclass(frozen=True)
class UserModel(Model):
    """What `user_model` derives from; not used by itself."""

    module: ClassVar[str]
    _functions: ClassVar[_Functions]

    def __reduce__(self) -> tuple[Any, ...]:
        return find_user_model, (self.name, self.module)

    def freeze(self, values: Values) -> dict[str, float]:
        return {
            p.name: float(p.validate(values.get(p.name, p.default)))  # type: ignore[arg-type]
            for p in self.fixed_parameters
        }

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        if self.coordinate_name == "none":
            return 0.5 + 0.0 * wi.z
        gamma = self._gamma(xp, wi, wo, fixed)
        return xp.minimum(xp.maximum(gamma / self.coordinate_maximum, 0.0), 1.0)

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        own = {p.name: fixed[p.name] for p in self.fixed_parameters}
        return [self._quotient(xp, wi, wo, own)]

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        return np.ones((1, 3))

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        gamma = 0.0 * t if self.coordinate_name == "none" else t * self.coordinate_maximum
        f = _channels(self._functions.curve(numpy_maths, gamma, {**fixed, **values}))
        columns = [np.broadcast_to(np.asarray(c, np.float64), t.shape) for c in f]
        return np.stack(columns, axis=1)

    def outgoing(self, cos_theta_o: Float64, values: Values, fixed: Fixed) -> Float64 | None:
        if self._functions.outgoing is None:
            return None
        s = _channels(self._functions.outgoing(numpy_maths, cos_theta_o, {**fixed, **values}))
        columns = [np.broadcast_to(np.asarray(c, np.float64), cos_theta_o.shape) for c in s]
        return np.stack(columns, axis=1)

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        lit = (wi.z > 0) & (wo.z > 0)
        up_i = Vector(wi.x, wi.y, xp.select(lit, wi.z, 1.0))
        up_o = Vector(wo.x, wo.y, xp.select(lit, wo.z, 1.0))
        gamma = 0.0 * wi.z
        if self.coordinate_name != "none":
            gamma = self._gamma(xp, up_i, up_o, values)
        frozen = {p.name: values[p.name] for p in self.fixed_parameters}
        q = self._quotient(xp, up_i, up_o, frozen)
        f = _spread(self._functions.curve(xp, gamma, values))
        if self._functions.outgoing is not None:
            s = _spread(self._functions.outgoing(xp, up_o.z, values))
            f = [a * b for a, b in zip(f, s, strict=True)]
        return [xp.select(lit, q * c, 0.0 * q) for c in f]

    def _gamma(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        own = self._functions.coordinate
        if own is None:
            return COORDINATES[self.coordinate_name](xp, wi, wo)
        return own(xp, wi, wo, {p.name: fixed[p.name] for p in self.fixed_parameters})

    def _quotient(self, xp: Maths, wi: Any, wo: Any, frozen: Mapping[str, Any]) -> Any:
        own = self._functions.quotient
        q = 1.0 + 0.0 * wi.z
        if own is not None:
            q = own(xp, wi, wo, frozen) + 0.0 * wi.z
        if self.coordinate_name == "theta_r":
            q = xp.select(wi.z * wo.z - wi.x * wo.x - wi.y * wo.y > 0, q, 0.0)
        return q


def find_user_model(name: str, module: str) -> Model:
    """The registered model of a name, its module imported where need be.

    For copies of a model that travel between our own processes. Raises UnknownName.
    """
    if name not in MODELS and module not in ("__main__", "__mp_main__"):
        importlib.import_module(module)
    if name not in MODELS:
        raise UnknownName("reflectance model", name, MODELS)
    return MODELS[name]()


def _channels(value: Any) -> list[Any]:
    """The channels of what a user's function gave: one or three."""
    if not isinstance(value, (list, tuple)):
        return [value]
    if len(value) != 3:
        raise ValueError(f"a list of {len(value)}, where one number or three are asked for")
    return list(value)


def _spread(value: Any) -> list[Any]:
    channels = _channels(value)
    return channels * 3 if len(channels) == 1 else channels


def _class_name(name: str) -> str:
    return "".join(part.capitalize() for part in name.replace("-", " ").split()) or "UserModel"


def _try(model: UserModel) -> None:
    """Call a new model's functions once, so that a mistake shows where it was made."""
    rng = np.random.default_rng(0)
    z, phi = rng.uniform(0.05, 1.0, (2, 64)), rng.uniform(0, 2 * math.pi, (2, 64))
    sin = np.sqrt(1 - z * z)
    wi, wo = (Vector(s * np.cos(p), s * np.sin(p), c) for s, p, c in zip(sin, phi, z, strict=True))
    values = {p.name: p.validate(p.default) for p in model.parameters}
    try:
        fixed = model.freeze({})
        results = {
            "coordinate": model.coordinate(numpy_maths, wi, wo, fixed),
            "quotient": model.quotients(numpy_maths, wi, wo, fixed)[0],
            "curve": model.profile(np.linspace(0.0, 1.0, 64), values, fixed),
            "outgoing": model.outgoing(z[0], values, fixed),
            "curve times quotient": np.stack(
                model.evaluate(numpy_maths, wi, wo, {**fixed, **values})
            ),
        }
    except (TypeError, ValueError, KeyError, AttributeError, IndexError) as error:
        raise InvalidValue(
            f"model {model.name}: its functions fail on arrays ({type(error).__name__}: {error}); "
            "use xp.select and xp.maximum in place of if and max, and names that are declared"
        ) from error
    for part, result in results.items():
        if result is None:
            continue
        if not np.isfinite(result).all():
            raise InvalidValue(f"model {model.name}: its {part} must give finite numbers")
        if (np.asarray(result) < 0).any():
            raise InvalidValue(f"model {model.name}: its {part} must not be negative")
