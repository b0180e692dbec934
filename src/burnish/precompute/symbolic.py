"""Materials as device tables, so that what is selected is data, not code.

A kernel meets thousands of objects and layers through gathers: which object is symbolic,
where its columns start, how many bins a layer has. Only the *models* that occur are part
of the kernel's code. Selecting another object, or another number of bins, changes arrays
and never recompiles.

Three kinds of object meet a path: *symbolic* ones leave their columns open; *numeric* ones
are materials of ours that are settled, evaluated from tables of fine coefficients; *plain*
ones are left to Mitsuba's BSDF.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.materials.coefficients import coefficients, conserved, outgoing
from burnish.materials.layer import Layer, MaterialState
from burnish.materials.model import Model
from burnish.precompute.lobes import HalfAngleLobes, coarse_lobe_of, lobe_of
from burnish.precompute.orientation import Orientation
from burnish.precompute.tables import NONE, SECOND_COSINE_SHARE, LayerTables
from burnish.scene import Scene
from burnish.scene.maths import drjit_maths
from burnish.transport.basis import Basis, State, coarse_count

PLAIN, NUMERIC = -1, -2
NUMERIC_BINS = 512
"""Bins of a numeric material's layers: nothing is stored per pixel, so they may be many."""

OUTGOING_NODES = 64


@dataclass
class Terms:
    """Where one direction pair falls in the columns of one layer slot.

    column: first column (bin j of quotient 0); stride: columns from one quotient to the
    next; quotients: [rank] scalars; H: the weight map's colour or None. place, step: where
    quotient 0 lies in a row under tail 0, and places from one tail to the next, see
    `Arrangement`; step is None for 1.
    """

    column: Any
    stride: Any
    quotients: list[Any]
    H: Any
    place: Any = None
    step: Any = None

    def placed(self) -> Terms:
        """Without the columns: what is left to add to a row."""
        return replace(self, column=None, stride=None)


@dataclass
class Slot:
    """How one layer slot of a lane's object is laid out; see the tables' builder.

    entry: position in the tables. square: whether bins are spaced by t = u².
    """

    entry: Any
    model: Any
    bins: Any
    column: Any
    square: Any
    indirect_bins: Any
    indirect_column: Any
    place: Any
    step: Any


class SymbolicMaterials:
    """Tables over (scene object, layer slot) and the functions that read them.

    Objects in `basis` are symbolic. numeric: the states of the objects that are evaluated
    from tables; without it, those whose material Mitsuba's BSDF of the scene does not hold,
    as the scene has them. follow: states of symbolic objects that sampling should follow.
    compile_for: ids of further objects whose models the kernel must know, so that selecting
    them later changes tables only.
    """

    def __init__(
        self,
        scene: Scene,
        basis: Basis,
        numeric: State | None = None,
        follow: State | None = None,
        compile_for: Collection[str] = (),
    ) -> None:
        self.scene = scene
        self.basis = basis
        objects = scene.objects
        position = {item.id: i for i, item in enumerate(basis.objects)}
        self._numeric: State = settled(scene, position) if numeric is None else numeric
        layered: list[tuple[Layer, ...]] = []
        for thing in objects:
            if thing.id in position:
                layered.append(basis.objects[position[thing.id]].material.layers)
            elif thing.id in self._numeric and thing.material is not None:
                layered.append(
                    tuple(layer.with_bins(NUMERIC_BINS) for layer in thing.material.layers)
                )
            else:
                layered.append(())
        known = [
            thing.material.layers if thing.id in compile_for and thing.material else layers
            for thing, layers in zip(objects, layered, strict=True)
        ]
        self.slots = max((len(layers) for layers in known), default=0)
        self.models: list[Model] = list(
            dict.fromkeys(layer.model for layers in known for layer in layers)
        )
        self.slot_models = [
            sorted({self.models.index(layers[s].model) for layers in known if len(layers) > s})
            for s in range(self.slots)
        ]
        self.ranks = [max(self.models[m].rank for m in models) for models in self.slot_models]
        self.any_delta = any(layer.delta for layers in known for layer in layers)
        self.maps = [
            (o, group, thing.maps[group])
            for o, thing in enumerate(objects)
            if known[o]
            for group in thing.maps
        ]
        self.bends = [(o, t.bend) for o, t in enumerate(objects) if known[o] and t.bend]
        self.masks = [(o, t.opacity) for o, t in enumerate(objects) if known[o] and t.opacity]
        mapped = {(o, group) for o, group, _ in self.maps}
        self.slot_has_map = [
            any(
                len(layers) > s and (o, layers[s].group) in mapped for o, layers in enumerate(known)
            )
            for s in range(self.slots)
        ]
        self.layered = layered
        self.any_numeric = bool(self._numeric) or bool(compile_for)
        symbolic = [
            position.get(thing.id, NUMERIC if layers else PLAIN)
            for thing, layers in zip(objects, layered, strict=True)
        ]
        map_index = {(o, group): n for n, (o, group, _) in enumerate(self.maps)}
        tables = LayerTables(layered, symbolic, self.models, map_index, basis, max(self.slots, 1))
        self._shares = tables.half_share, tables.delta_share
        self._upload(tables, symbolic)
        self.lobes = HalfAngleLobes(len(objects), bool(follow) or self.any_numeric)
        self.layer_lobes = HalfAngleLobes(len(objects) * max(self.slots, 1), True)
        self._shape_lobes(follow or {})
        self._tabulate()

    def _upload(self, t: LayerTables, symbolic: list[int]) -> None:
        """Bring the tables to the device, opaque, so that new numbers need no new kernel."""
        self.symbolic = _array(mi.Int32, np.array(symbolic, np.int32))
        self.layers_of, self.groups_of = _array(mi.UInt32, t.layers), _array(mi.UInt32, t.groups)
        two_sided = np.array([thing.two_sided for thing in self.scene.objects], np.uint32)
        self.two_sided = _array(mi.UInt32, two_sided)
        self._bend = _array(mi.UInt32, _positions(self.bends, len(two_sided)))
        self._mask = _array(mi.UInt32, _positions(self.masks, len(two_sided)))
        flags = [[bend.shadows, bend.two_sided_inside] for _, bend in self.bends] or [[False] * 2]
        self._bend_flags = _array(mi.UInt32, np.array(flags, np.uint32))
        square = (t.spacing > 1.5).astype(np.uint32)
        fields = (t.model, t.bins, t.column, square, t.indirect_bins, t.indirect_column)
        self._packed = _array(mi.UInt32, np.stack([*fields, t.place, t.step], axis=2))
        self._tails = _array(mi.UInt32, np.array([self.basis.tails], np.uint32))
        names = (
            "delta_column",
            "delta_place",
            "coarse_first",
            "coarse_bins",
            "variable",
            "map",
            "group_slot",
        )
        self._t = {name: _array(mi.UInt32, getattr(t, name)) for name in names}
        self._spacing, self._half = _array(mi.Float, t.spacing), _array(mi.Float, t.half)
        self._square_spacings = bool(np.isin(t.spacing, (1.0, 2.0)).all())
        self._fixed = {name: _array(mi.Float, table) for name, table in t.fixed.items()}

    def _shape_lobes(self, follow: State) -> None:
        """Let sampling follow the numeric materials, and half-way the given symbolic ones."""
        half_share, delta_share = (share.copy() for share in self._shares)
        for o, (thing, layers) in enumerate(zip(self.scene.objects, self.layered, strict=True)):
            numeric = thing.id in self._numeric
            state = self._numeric.get(thing.id) or follow.get(thing.id)
            if not layers or state is None or thing.material is None:
                continue
            cells, glossy, delta = lobe_of(layers, conserved(thing.material, state))
            self.lobes.set(o, cells, 0.1 if numeric else 0.5)
            if numeric:
                delta_share[o] = min(delta, 0.9)
                half_share[o] = (1 - delta_share[o]) * np.clip(glossy, 0.0, 0.9)
                if glossy > 0:
                    half_share[o] = max(half_share[o], 0.1 * (1 - delta_share[o]))
            elif half_share[o] > 0:
                share = 0.2 + 0.6 * glossy / max(1 - delta, 1e-6)
                half_share[o] = (1 - delta_share[o]) * share
        self.lobes.upload()
        self._shape_layer_lobes(follow)
        self.half_share = _array(mi.Float, half_share)
        self.delta_share = _array(mi.Float, delta_share)

    def _shape_layer_lobes(self, follow: State) -> None:
        """Let a second encounter's sampling follow, half-way, the given or the first states."""
        if not self.basis.coarse:
            return
        for o, (thing, layers) in enumerate(zip(self.scene.objects, self.layered, strict=True)):
            if thing.id in self._numeric or thing.material is None:
                continue
            state = conserved(thing.material, follow.get(thing.id, thing.material.initial))
            for s, layer in enumerate(layers):
                count = coarse_count(layer, self.basis.coarse_bins)
                cells = coarse_lobe_of(layer, state.layers[layer.name], count)
                self.layer_lobes.set(o * max(self.slots, 1) + s, cells, 0.0)
        self.layer_lobes.upload()

    def follow(self, state: State) -> None:
        """Change what sampling follows; no kernel is compiled anew."""
        self._shape_lobes(state)

    def _tabulate(self) -> None:
        """Coefficients and outgoing factors of the numeric materials."""
        S = max(self.slots, 1)
        start = np.zeros(len(self.layered), np.uint32)
        values: list[np.ndarray] = []
        nodes = np.linspace(0.0, 1.0, OUTGOING_NODES)
        factors = np.ones((len(self.layered), S, 2, OUTGOING_NODES, 3), np.float32)
        total = 0
        for o, (thing, layers) in enumerate(zip(self.scene.objects, self.layered, strict=True)):
            if thing.id not in self._numeric or thing.material is None:
                continue
            state = conserved(thing.material, self._numeric[thing.id])
            start[o] = total
            for s, layer in enumerate(layers):
                values.append(coefficients(layer, state.layers[layer.name]))
                total += layer.columns
                for kind in range(1 + int(layer.delta)):
                    factor = outgoing(layer, state.layers[layer.name], nodes, bool(kind))
                    if factor is not None:
                        factors[o, s, kind] = factor
        flat = np.concatenate(values) if values else np.zeros((1, 3))
        self._coefficients = _array(mi.Float, flat.astype(np.float32))
        self._coefficient_start = _array(mi.UInt32, start)
        self._factors = _array(mi.Float, factors)

    # -- look-ups -------------------------------------------------------------------------

    def _entry(self, name: str, obj: Any, slot: Any) -> Any:
        return dr.gather(mi.UInt32, self._t[name], obj * max(self.slots, 1) + slot)

    def look_up(self, obj: Any, active: Any) -> list[Slot]:
        """How the layer slots of an object are laid out; once per vertex."""
        result = []
        for s in range(self.slots):
            entry = obj * max(self.slots, 1) + s
            low = dr.gather(mi.Vector4u, self._packed, entry * 2, active)
            high = dr.gather(mi.Vector4u, self._packed, entry * 2 + 1, active)
            result.append(Slot(entry, low.x, low.y, low.z, low.w, high.x, high.y, high.z, high.w))
        return result

    def _bin(self, t: Any, layout: Slot) -> Any:
        """The fine bin of t: the spacing's warp is uniform over the bins."""
        t = dr.clip(t, 0, 1)
        if self._square_spacings:
            u = dr.select(layout.square != 0, dr.sqrt(t), t)
        else:
            u = dr.power(t, 1 / dr.gather(mi.Float, self._spacing, layout.entry))
        return dr.minimum(mi.UInt32(u * mi.Float(layout.bins)), dr.maximum(layout.bins, 1) - 1)

    def _evaluate(
        self, layout: Slot, slot: int, wi: Any, wo: Any, active: Any
    ) -> tuple[Any, list[Any]]:
        """t and the quotients of one layer slot; zero where it has no layer."""
        t, quotients = mi.Float(0), [mi.Float(0) for _ in range(self.ranks[slot])]
        for m in self.slot_models[slot]:
            model = self.models[m]
            here = active & (layout.model == m)
            fixed = {
                parameter.name: dr.gather(mi.Float, self._fixed[parameter.name], layout.entry)
                for parameter in model.fixed_parameters
            }
            t = dr.select(here, model.coordinate(drjit_maths, wi, wo, fixed), t)
            for k, q in enumerate(model.quotients(drjit_maths, wi, wo, fixed)):
                quotients[k] = dr.select(here, q, quotients[k])
        return t, quotients

    def weight_maps(self, si: Any, obj: Any, active: Any) -> list[Any]:
        """H of each layer slot at a hit: colours, or None when no object has a map."""
        if not self.maps:
            return [None] * self.slots
        result = []
        targets = [weight_map.evaluate for _, _, weight_map in self.maps]
        for s in range(self.slots):
            if not self.slot_has_map[s]:
                result.append(mi.Color3f(1))
                continue
            index = self._entry("map", obj, s)
            mapped = active & (index != NONE)
            value = dr.switch(dr.select(mapped, index, 0), targets, si, mapped)
            result.append(dr.select(mapped, value, 1))
        return result

    # -- what the scene puts round materials -----------------------------------------------

    def passes(self, si: Any, obj: Any, u: Any, active: Any) -> Any:
        """Lanes of ours that go straight through a mask, chosen at random by its opacity."""
        index = dr.gather(mi.UInt32, self._mask, obj, active)
        masked = active & (index != NONE)
        targets = [_opacity(texture) for _, texture in self.masks]
        return masked & (u >= dr.switch(dr.select(masked, index, 0), targets, si, masked))

    def orient(self, si: Any, obj: Any, active: Any) -> Orientation:
        """The frame that materials of ours reflect in; what has one side is black behind."""
        wo = mi.Vector3f(si.wi)
        two_sided = dr.gather(mi.UInt32, self.two_sided, obj, active) != 0
        if not self.bends:
            flip = active & (wo.z < 0) & two_sided
            wo.z = dr.select(flip, -wo.z, wo.z)
            return Orientation(wo, flip)
        index = dr.gather(mi.UInt32, self._bend, obj, active)
        bent = active & (index != NONE)
        index = dr.select(bent, index, 0)
        shadows = bent & (dr.gather(mi.UInt32, self._bend_flags, 2 * index, bent) != 0)
        inside = bent & (dr.gather(mi.UInt32, self._bend_flags, 2 * index + 1, bent) != 0)
        flip = active & (wo.z < 0) & two_sided & ~inside
        wo.z = dr.select(flip, -wo.z, wo.z)
        normal = dr.switch(index, [bend.normal for _, bend in self.bends], si, wo, bent)
        normal = dr.select(bent, normal, mi.Vector3f(0, 0, 1))
        return Orientation.of(wo, flip, normal, inside, shadows)

    # -- what the tracer asks -------------------------------------------------------------

    def columns(
        self, layouts: list[Slot], wi: Any, wo: Any, H: list[Any], fine: Any, active: Any
    ) -> list[Terms]:
        """Columns and quotients that light from `wi` adds to, for a first encounter.

        fine: the lanes that use all bins; the others use the coarse bins of indirect rows,
        where only the reference quotient counts.
        """
        lit = active & (wi.z > 0) & (wo.z > 0)
        result = []
        for s, layout in enumerate(layouts):
            t, quotients = self._evaluate(layout, s, wi, wo, lit)
            j = self._bin(t, layout)
            coarse = share_of(j, layout.indirect_bins, layout.bins)
            column = dr.select(fine, layout.column + j, layout.indirect_column + coarse)
            q = [
                dr.select(lit & (fine if k else True), dr.maximum(value, 0) if k == 0 else value, 0)
                for k, value in enumerate(quotients)
            ]
            many = self.ranks[s] > 1
            step = dr.select(fine, layout.step, 1) if many else None
            width = self._tails * layout.step if many else self._tails
            indirect = (layout.indirect_column + coarse) * self._tails
            place = dr.select(fine, layout.place + j * width, indirect)
            result.append(Terms(column, layout.bins, q, H[s], place, step))
        return result

    def contract(self, obj: Any, terms: list[Terms], wo: Any, delta: Any, active: Any) -> Any:
        """The value of a numeric material's terms: Σ s(θo) c q H, linear RGB, no cosine."""
        start = dr.gather(mi.UInt32, self._coefficient_start, obj, active)
        position = dr.clip(wo.z, 0, 1) * (OUTGOING_NODES - 1)
        node = dr.minimum(mi.UInt32(position), OUTGOING_NODES - 2)
        within = position - mi.Float(node)
        result = mi.Color3f(0)
        for s, term in enumerate(terms):
            value = mi.Color3f(0)
            for k, q in enumerate(term.quotients):
                lit = active & (q != 0)
                column = start + term.column + k * term.stride
                value += q * dr.gather(mi.Color3f, self._coefficients, column, lit)
            entry = (obj * max(self.slots, 1) + s) * 2 + dr.select(delta, 1, 0)
            entry = entry * OUTGOING_NODES + node
            low = dr.gather(mi.Color3f, self._factors, entry, active)
            high = dr.gather(mi.Color3f, self._factors, entry + 1, active)
            value *= dr.lerp(low, high, within)
            result += value if term.H is None else value * term.H
        return dr.maximum(result, 0)

    def delta_columns(
        self, obj: Any, layouts: list[Slot], H: list[Any], active: Any
    ) -> list[Terms]:
        """The delta columns of an object, for light from the mirror direction."""
        result = []
        for s in range(self.slots):
            column = self._entry("delta_column", obj, s)
            exists = active & (column != NONE)
            q = [dr.select(exists, mi.Float(1), 0)]
            q += [mi.Float(0)] * (self.ranks[s] - 1)
            place = dr.select(exists, self._entry("delta_place", obj, s), 0)
            step = mi.UInt32(1) if self.ranks[s] > 1 else None
            column = dr.select(exists, column, 0)
            result.append(Terms(column, layouts[s].bins, q, H[s], place, step))
        return result

    def sample(self, obj: Any, wo: Any, u1: Any, u2: Any) -> tuple[Any, Any, Any]:
        """A direction for a first encounter: (wi, pdf per steradian, is the delta lobe).

        A mixture of a cosine lobe and the object's half-angle lobe (see `lobes`), and of the
        mirror direction where there is a delta column; there the pdf is its probability.
        """
        p_delta = dr.gather(mi.Float, self.delta_share, obj)
        p_half = dr.gather(mi.Float, self.half_share, obj)
        is_delta = u1 < p_delta
        is_half = ~is_delta & (u1 < p_delta + p_half)
        wi_half = self.lobes.sample(obj, wo, u2)
        wi_cosine = mi.warp.square_to_cosine_hemisphere(u2)
        wi = dr.select(
            is_delta, mi.Vector3f(-wo.x, -wo.y, wo.z), dr.select(is_half, wi_half, wi_cosine)
        )
        pdf = dr.select(is_delta, p_delta, self.pdf(obj, wi, wo))
        return wi, pdf, is_delta

    def pdf(self, obj: Any, wi: Any, wo: Any) -> Any:
        """Density per steradian of `sample`'s continuous lobes."""
        p_delta = dr.gather(mi.Float, self.delta_share, obj)
        p_half = dr.gather(mi.Float, self.half_share, obj)
        density = p_half * self.lobes.pdf(obj, wi, wo)
        density += (1 - p_delta - p_half) * dr.maximum(wi.z, 0) * dr.inv_pi
        return dr.select((wi.z > 0) & (wo.z > 0), density, 0)

    def choose(self, obj: Any, u: Any, layers: Any) -> tuple[Any, Any]:
        """A layer slot at random, and one over its probability.

        Where `layers` is set, any layer; elsewhere the first layer of a random group, since
        the layers of a group share a variable. With one group there is no choice.
        """
        count = dr.select(
            layers,
            dr.gather(mi.UInt32, self.layers_of, obj),
            dr.gather(mi.UInt32, self.groups_of, obj),
        )
        count = dr.maximum(count, 1)
        chosen = dr.minimum(mi.UInt32(u * mi.Float(count)), count - 1)
        slot = dr.select(layers, chosen, self._entry("group_slot", obj, chosen))
        return slot, mi.Float(count)

    def variable(self, obj: Any, slot: Any) -> Any:
        """The polynomial's variable of a layer slot."""
        return self._entry("variable", obj, slot)

    def coarse_column(
        self, obj: Any, layouts: list[Slot], slot: Any, wi: Any, wo: Any, active: Any
    ) -> tuple[Any, Any]:
        """Coarse column of the chosen slot at a second encounter, and its quotient."""
        lit = active & (wi.z > 0) & (wo.z > 0)
        column, quotient = mi.UInt32(0), mi.Float(0)
        for s, layout in enumerate(layouts):
            here = lit & (slot == s)
            t, quotients = self._evaluate(layout, s, wi, wo, here)
            w = share_of(self._bin(t, layout), self._entry("coarse_bins", obj, s), layout.bins)
            column = dr.select(here, self._entry("coarse_first", obj, s) + w, column)
            quotient = dr.select(here, dr.maximum(quotients[0], 0), quotient)
        return column, quotient

    def sample_layer(self, obj: Any, slot: Any, wo: Any, u1: Any, u2: Any) -> tuple[Any, Any]:
        """A direction for one layer at a second encounter, and its density per steradian.

        Cosine for a broad layer; for a glossy one a mixture with half vectors that know the
        coarse bins (see `coarse_lobe_of`).
        """
        entry = obj * max(self.slots, 1) + slot
        wi = dr.select(
            u1 < self._layer_half_share(entry),
            self.layer_lobes.sample(entry, wo, u2),
            mi.warp.square_to_cosine_hemisphere(u2),
        )
        return wi, self.pdf_layer(obj, slot, wi, wo)

    def pdf_layer(self, obj: Any, slot: Any, wi: Any, wo: Any) -> Any:
        """Density per steradian of `sample_layer`."""
        entry = obj * max(self.slots, 1) + slot
        share = self._layer_half_share(entry)
        density = share * self.layer_lobes.pdf(entry, wi, wo)
        density += (1 - share) * dr.maximum(wi.z, 0) * dr.inv_pi
        return dr.select((wi.z > 0) & (wo.z > 0), density, 0)

    def _layer_half_share(self, entry: Any) -> Any:
        return (1 - SECOND_COSINE_SHARE) * dr.gather(mi.Float, self._half, entry)


def share_of(j: Any, count: Any, bins: Any) -> Any:
    """j · count // bins, in floating point: an integer division is done lane by lane, and by
    zero, in a lane that has left its loop, ends the process. Exact below 2²⁰."""
    return mi.UInt32((mi.Float(j * count) + 0.5) / mi.Float(dr.maximum(bins, 1)))


def settled(scene: Scene, symbolic: Collection[str]) -> dict[str, MaterialState]:
    """Materials of ours that Mitsuba's BSDF of the scene does not hold, as the scene has them."""
    return {
        thing.id: thing.material.initial
        for thing in scene.objects
        if thing.material is not None and thing.factory is None and thing.id not in symbolic
    }


def _positions(placed: Sequence[tuple[int, Any]], count: int) -> np.ndarray:
    """Where each object stands in a list of (object, …), or NONE: uint32 [count]."""
    result = np.full(max(count, 1), NONE, np.uint32)
    for number, (o, _) in enumerate(placed):
        result[o] = number
    return result


def _opacity(texture: Any) -> Any:
    return lambda si, active: texture.eval_1(si, active)


def _array(kind: Any, values: np.ndarray) -> Any:
    array = kind(np.ascontiguousarray(values).ravel())
    dr.make_opaque(array)
    return array
