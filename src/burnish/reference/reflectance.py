"""What a layered material reflects: the true BRDF, and the forms that stand for it in a series.

Each class answers `rough`, the BRDF without its cosine, and `mirror`, the share that a
perfectly smooth layer reflects, both as mi.Color3f at surface interactions. ωi is towards
the light and ωo towards the viewer, in the local frame, both above the surface.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.types import AnyArray, Float64
from burnish.materials.coefficients import (
    albedo,
    coarse_coefficients,
    coefficients,
    conserved,
    edited_profile,
    edited_second_profile,
    outgoing,
)
from burnish.materials.layer import Layer, LayerState, Material, MaterialState, freehand
from burnish.materials.two_curves import TwoCurves
from burnish.reference.lobes import Lobe, Lobes
from burnish.scene.maps import WeightMap
from burnish.scene.maths import drjit_maths

CURVE_NODES = 8192
OUTGOING_NODES = 1024


class Reflectance(ABC):
    """A form of a material in a state.

    maps: the static H of each layer group that has one.
    """

    def __init__(
        self, material: Material, state: MaterialState, maps: Mapping[str, WeightMap]
    ) -> None:
        settled = conserved(material, state)
        self.layers = [
            (layer, settled.layers[layer.name])
            for layer in material.layers
            if settled.layers[layer.name].enabled and settled.layers[layer.name].weight > 0
        ]
        self.maps = maps
        self.lobes = self._lobes()

    @abstractmethod
    def rough(self, si: Any, wi: Any, wo: Any, active: Any) -> Any:
        """ρ(ωi, ωo), without the cosine and without perfectly smooth layers."""

    def mirror(self, si: Any, cos_theta_o: Any, active: Any) -> Any:
        """What the perfectly smooth layers reflect, 0 to 1."""
        return mi.Color3f(0)

    def _lobes(self) -> Lobes:
        return Lobes([])

    def _weight(self, group: str, si: Any, active: Any) -> Any:
        if group not in self.maps:
            return mi.Color3f(1)
        return self.maps[group].evaluate(si, active)

    def _shares(self) -> list[tuple[Layer, LayerState, float]]:
        return [(layer, s, float(albedo(layer, s).mean()) + 1e-4) for layer, s in self.layers]


class TrueReflectance(Reflectance):
    """The material itself, from each model's own formula.

    A freehand curve has no formula: its layer is s(θo) Σ_k a_k q_k · f with the edited
    profile f at the exact coordinate, interpolated between `CURVE_NODES` values; so is one
    whose s(θo) is edited freehand.
    """

    def __init__(
        self, material: Material, state: MaterialState, maps: Mapping[str, WeightMap]
    ) -> None:
        super().__init__(material, state, maps)
        self.forms = [
            (layer.group, float(s.weight), _form(layer, s))
            for layer, s in self.layers
            if not is_smooth(layer, s)
        ]
        self.mirrors = [
            (layer.group, _Mirror(layer, s, layer.model.delta(s.values, layer.fixed) * s.weight))
            for layer, s in self.layers
            if is_smooth(layer, s)
        ]

    def rough(self, si: Any, wi: Any, wo: Any, active: Any) -> Any:
        result = mi.Color3f(0)
        for group, weight, form in self.forms:
            value = form.evaluate(wi, wo, active) * dr.opaque(mi.Float, weight)
            result += value * self._weight(group, si, active)
        return result

    def mirror(self, si: Any, cos_theta_o: Any, active: Any) -> Any:
        result = mi.Color3f(0)
        for group, form in self.mirrors:
            result += form.evaluate(cos_theta_o, active) * self._weight(group, si, active)
        return result

    def _lobes(self) -> Lobes:
        rough = [
            Lobe(layer, share, _profile_of(layer, s))
            for layer, s, share in self._shares()
            if not is_smooth(layer, s)
        ]
        smooth = sum(share for layer, s, share in self._shares() if is_smooth(layer, s))
        return Lobes(rough, smooth)


class FineReflectance(Reflectance):
    """The projected material of a first encounter: s(θo) Σ_kj c_kj q_k b_j, delta column apart
    (2008, eq. 30)."""

    def __init__(
        self, material: Material, state: MaterialState, maps: Mapping[str, WeightMap]
    ) -> None:
        super().__init__(material, state, maps)
        self.columns = []
        self.mirrors = []
        for layer, s in self.layers:
            c = coefficients(layer, s)
            factor = _Outgoing(layer, s, delta=False)
            self.columns.append((layer, _table(c[: layer.model.rank * layer.bins]), factor))
            if layer.delta and c[-1].any():
                self.mirrors.append((layer.group, _Mirror(layer, s, c[-1])))

    def rough(self, si: Any, wi: Any, wo: Any, active: Any) -> Any:
        result = mi.Color3f(0)
        for layer, table, factor in self.columns:
            bin_ = _bin(layer, wi, wo)
            value = mi.Color3f(0)
            for k, q in enumerate(layer.model.quotients(drjit_maths, wi, wo, layer.fixed)):
                value += q * dr.gather(mi.Color3f, table, bin_ + k * layer.bins, active)
            value *= factor.evaluate(wo.z, active)
            result += value * self._weight(layer.group, si, active)
        return result

    def mirror(self, si: Any, cos_theta_o: Any, active: Any) -> Any:
        result = mi.Color3f(0)
        for group, form in self.mirrors:
            result += form.evaluate(cos_theta_o, active) * self._weight(group, si, active)
        return result

    def _lobes(self) -> Lobes:
        rough, smooth = [], 0.0
        for layer, s, share in self._shares():
            c = coefficients(layer, s)
            if layer.delta and c[-1].any():
                smooth += share
            values = c[: layer.model.rank * layer.bins].reshape(-1, layer.bins, 3)
            if values.any():
                rough.append(Lobe(layer, share, _steps(layer, values.sum(axis=0))))
        return Lobes(rough, smooth)


class CoarseReflectance(Reflectance):
    """Σ_w ĉ_w q_0 b_w with at most `count` bins per layer: a first encounter after rough
    vertices, or a second one (2008, eq. 29; coefficients that conserve energy, DESIGN §2)."""

    def __init__(
        self, material: Material, state: MaterialState, maps: Mapping[str, WeightMap], count: int
    ) -> None:
        self.count = count
        super().__init__(material, state, maps)
        self.columns = [(layer, _table(self._fine(layer, s))) for layer, s in self.layers]

    def _fine(self, layer: Layer, state: LayerState) -> Float64:
        """ĉ_w of the coarse bin of every fine bin: float64 [bins, 3]."""
        count = min(self.count, layer.bins)
        return coarse_coefficients(layer, state, count)[np.arange(layer.bins) * count // layer.bins]

    def rough(self, si: Any, wi: Any, wo: Any, active: Any) -> Any:
        result = mi.Color3f(0)
        for layer, table in self.columns:
            q = layer.model.quotients(drjit_maths, wi, wo, layer.fixed)[0]
            value = q * dr.gather(mi.Color3f, table, _bin(layer, wi, wo), active)
            result += value * self._weight(layer.group, si, active)
        return result

    def _lobes(self) -> Lobes:
        return Lobes(
            [
                Lobe(layer, share, _steps(layer, self._fine(layer, s)))
                for layer, s, share in self._shares()
            ]
        )


class MatteReflectance(Reflectance):
    """The equivalent albedo: d / π per layer group (2008, eq. 36-37)."""

    def __init__(
        self, material: Material, state: MaterialState, maps: Mapping[str, WeightMap]
    ) -> None:
        super().__init__(material, state, maps)
        groups: dict[str, Float64] = {}
        for layer, s in self.layers:
            groups[layer.group] = groups.get(layer.group, np.zeros(3)) + albedo(layer, s)
        self.albedos = {group: dr.opaque(mi.Color3f, d.tolist()) for group, d in groups.items()}

    def rough(self, si: Any, wi: Any, wo: Any, active: Any) -> Any:
        result = mi.Color3f(0)
        for group, d in self.albedos.items():
            result += d * dr.inv_pi * self._weight(group, si, active)
        return result


def is_smooth(layer: Layer, state: LayerState) -> bool:
    """Whether a layer is a perfect mirror in this state: its model says so by a curve of zero."""
    if not layer.model.can_be_delta:
        return False
    t = np.linspace(0.0, 1.0, 65) ** 2
    return not layer.model.profile(t, state.values, layer.fixed).any()


def _form(layer: Layer, state: LayerState) -> _Curved | _Formula:
    return _Curved(layer, state) if freehand(state) else _Formula(layer, state)


class _Formula:
    """A layer by its model's `evaluate`, its numbers out of the kernel's code."""

    def __init__(self, layer: Layer, state: LayerState) -> None:
        self.model = layer.model
        self.values: dict[str, Any] = {}
        for name, value in {**state.values, **layer.fixed}.items():
            if isinstance(value, str):
                self.values[name] = value
            elif isinstance(value, tuple):
                self.values[name] = [dr.opaque(mi.Float, item) for item in value]
            else:
                self.values[name] = dr.opaque(mi.Float, float(value))

    def evaluate(self, wi: Any, wo: Any, active: Any) -> Any:
        return mi.Color3f(*self.model.evaluate(drjit_maths, wi, wo, self.values))


class _Curved:
    """A layer with a freehand curve, through its quotients and its edited profile."""

    def __init__(self, layer: Layer, state: LayerState) -> None:
        self.layer = layer
        t = np.linspace(0.0, 1.0, CURVE_NODES) ** 2
        self.profile = _table(edited_profile(layer, state, t))
        self.second = None
        if isinstance(layer.model, TwoCurves):
            self.second = _table(edited_second_profile(layer, state, t))
        amplitudes = layer.model.amplitudes(state.values, layer.fixed)
        self.amplitudes = [dr.opaque(mi.Color3f, a.tolist()) for a in amplitudes]
        self.outgoing = _Outgoing(layer, state, delta=False)

    def evaluate(self, wi: Any, wo: Any, active: Any) -> Any:
        model, fixed = self.layer.model, self.layer.fixed
        if isinstance(model, TwoCurves):
            t, other = model.coordinates(drjit_maths, wi, wo, fixed)
            profile = _interpolate(self.second, CURVE_NODES, dr.sqrt(dr.clip(other, 0, 1)), active)
        else:
            t, profile = model.coordinate(drjit_maths, wi, wo, fixed), mi.Color3f(1)
        profile *= _interpolate(self.profile, CURVE_NODES, dr.sqrt(dr.clip(t, 0, 1)), active)
        quotients = model.quotients(drjit_maths, wi, wo, fixed)
        scale = sum((a * q for a, q in zip(self.amplitudes, quotients, strict=True)), mi.Color3f(0))
        return scale * profile * self.outgoing.evaluate(wo.z, active)


class _Outgoing:
    """s(θo) of a layer's bins or of its delta column, tabulated over the cosine."""

    def __init__(self, layer: Layer, state: LayerState, delta: bool) -> None:
        found = outgoing(layer, state, np.linspace(0.0, 1.0, OUTGOING_NODES), delta)
        self.table = _table(np.ones((OUTGOING_NODES, 1)) if found is None else found)

    def evaluate(self, cos_theta_o: Any, active: Any) -> Any:
        return _interpolate(self.table, OUTGOING_NODES, dr.clip(cos_theta_o, 0, 1), active)


class _Mirror:
    """A perfectly smooth layer: a tint times a factor on the angle."""

    def __init__(self, layer: Layer, state: LayerState, tint: Float64) -> None:
        self.tint = dr.opaque(mi.Color3f, tint.tolist())
        self.outgoing = _Outgoing(layer, state, delta=True)

    def evaluate(self, cos_theta_o: Any, active: Any) -> Any:
        return self.tint * self.outgoing.evaluate(cos_theta_o, active)


def _table(values: AnyArray) -> Any:
    """A device array of colours from [n, 3 or 1]."""
    colours = np.broadcast_to(values, (len(values), 3))
    return mi.Float(np.ascontiguousarray(colours, np.float32).ravel())


def _interpolate(table: Any, nodes: int, x: Any, active: Any) -> Any:
    """Linear interpolation of a table of colours at x in [0, 1]."""
    position = x * (nodes - 1)
    cell = dr.minimum(mi.UInt32(position), nodes - 2)
    low = dr.gather(mi.Color3f, table, cell, active)
    high = dr.gather(mi.Color3f, table, cell + 1, active)
    return dr.lerp(low, high, position - mi.Float(cell))


def _bin(layer: Layer, wi: Any, wo: Any) -> Any:
    """The fine bin of a pair of directions: edges at (j / bins) ** spacing."""
    t = dr.clip(layer.model.coordinate(drjit_maths, wi, wo, layer.fixed), 0, 1)
    position = dr.power(t, 1 / layer.spacing) if layer.spacing != 2 else dr.sqrt(t)
    return dr.minimum(mi.UInt32(position * layer.bins), layer.bins - 1)


def _profile_of(layer: Layer, state: LayerState) -> Any:
    if isinstance(layer.model, TwoCurves):
        # Over the boxes, which is what the coordinate of two curves tells
        c = coefficients(layer, state).reshape(-1, layer.bins, 3)
        return _steps(layer, np.asarray(c.sum(axis=0)))
    return lambda t: edited_profile(layer, state, t)


def _steps(layer: Layer, values: Float64) -> Any:
    """The profile that is values[j] on fine bin j, as a function of t."""
    inner = layer.edges[1:-1]
    return lambda t: values[np.searchsorted(inner, t, side="right")]
