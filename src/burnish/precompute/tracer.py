"""The symbolic path tracer: paths as usual, contributions to the term that they belong to.

A vertex on a fixed object uses its own BSDF as a number. The first symbolic object that a
path meets leaves its columns open; later ones multiply the path's *tail* by an equivalent
albedo (or one coarse bin at the second encounter). Every light sample and every emitter
hit then adds its value to T[row, column, tail] (2008, section 5.1 and eq. 21-24), combined
by multiple importance sampling. Because the sampling never looks at an edited BRDF, the
estimate is unbiased for every later one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi

from burnish.precompute.encounter import meet_second, open_first, select_terms
from burnish.precompute.film import Camera
from burnish.precompute.lights import EmitterGroups
from burnish.precompute.symbolic import NUMERIC, PLAIN, SymbolicMaterials, Terms
from burnish.precompute.tables import NONE
from burnish.scene import Scene, View

CELL = 4
"""Floats of a value of the transport."""

VALUE_BYTES = 4 * CELL

MIRROR_PDF = 4.0
"""A fixed vertex whose sampled lobe has at least this density (per steradian) counts as a
mirror: what it shows carries all bins. 4 /sr is the peak of a lobe of α ≈ 0.14."""


@dataclass
class Target:
    """Where a pass adds its samples; all device arrays.

    rows: uint32 [pixels, objects, 2] with the offset of each (pixel, object, indirect) row in
      `transport`, in units of one value, or NONE. transport: float [values · CELL], RGB and
      nothing, so that a lane adds a value in one step. apart: whether no two threads of a
      launch share a pixel, so that no addition need be atomic.
    fixed, emission: float [pixels · 3], light group after group. lost: uint32 [1], samples
      without a row. pixels: uint32 [1], how many.
    """

    rows: Any
    transport: Any
    apart: bool
    fixed: Any
    emission: Any
    lost: Any
    pixels: Any


@dataclass
class Path:
    """The loop's state; one lane is one path."""

    ray: Any
    throughput: Any
    active: Any
    depth: Any
    previous: Any
    previous_pdf: Any
    previous_delta: Any
    mirror_chain: Any
    encounters: Any
    row: Any
    terms: list[Terms]
    coarse: Any
    monomial: Any
    pending: Any
    pending_group: Any
    fixed: Any
    emission: Any


@dataclass
class Numbers:
    """The random numbers of one vertex, uniform in [0, 1). opacity: None without masks."""

    opacity: Any
    layer: Any
    light: Any
    lobe: Any
    direction: Any


class Tracer:
    """Traces passes of one view of a scene with a given set of symbolic objects."""

    def __init__(self, scene: Scene, view: View, materials: SymbolicMaterials) -> None:
        self.scene = scene
        self.view = view
        self.materials = materials
        self.basis = materials.basis
        self.camera = Camera(view)
        self.object_table = mi.UInt32(scene.object_table)
        monomials = self.basis.monomials
        next_table = monomials.next.astype("uint32").ravel()
        self.next_monomial = mi.UInt32(next_table if next_table.size else [0])
        dr.make_opaque(self.object_table, self.next_monomial)
        self._bounces = mi.UInt32(self.basis.bounces)
        self._variables = mi.UInt32(max(monomials.variables, 1))
        self._tails = mi.UInt32(self.basis.tails)
        self._light_tails = mi.UInt32(self.basis.light_tails)
        self._monomial_count = mi.UInt32(len(monomials))
        self._objects = mi.UInt32(max(len(self.basis.objects), 1))
        dr.make_opaque(
            self._bounces,
            self._variables,
            self._tails,
            self._light_tails,
            self._monomial_count,
            self._objects,
        )
        self.groups = EmitterGroups(scene, self.basis)
        self.coarse = self.basis.coarse_bins > 1

    def object_of(self, si: Any, active: Any) -> tuple[Any, Any]:
        """Scene object index of a hit and its symbolic index (-1: fixed)."""
        shape = dr.reinterpret_array(mi.UInt32, si.shape)
        obj = dr.gather(mi.UInt32, self.object_table, shape, active)
        return obj, dr.gather(mi.Int32, self.materials.symbolic, obj, active)

    # -- one pass -------------------------------------------------------------------------

    def trace(self, target: Target, pixel: Any, local: Any, sampler: Any, seed: Any) -> None:
        """Trace one path per lane and add its contributions to `target`.

        pixel: film coordinates, Point2u; local: the lane's pixel within the target.
        """
        ray, weight = self.camera.ray(pixel, sampler)
        lanes = dr.width(local)
        m = self.materials
        state = Path(
            ray=mi.Ray3f(ray),
            throughput=mi.Color3f(weight),
            active=dr.full(mi.Bool, True, lanes),
            depth=mi.UInt32(0),
            previous=dr.zeros(mi.Interaction3f),
            previous_pdf=mi.Float(1),
            previous_delta=mi.Bool(True),
            mirror_chain=mi.Bool(True),
            encounters=mi.UInt32(0),
            row=mi.UInt32(NONE),
            terms=[
                Terms(
                    None,
                    None,
                    [mi.Float(0) for _ in range(rank)],
                    mi.Color3f(1) if m.maps else None,
                    mi.UInt32(0),
                    mi.UInt32(1) if rank > 1 else None,
                )
                for rank in m.ranks
            ],
            coarse=mi.UInt32(0),
            monomial=mi.UInt32(0),
            pending=mi.Color3f(0),
            pending_group=mi.UInt32(0),
            fixed=mi.Color3f(0),
            emission=mi.Color3f(0),
        )

        # Numbers that are stratified over the pixel for the first vertex, plain ones after it
        first = Numbers(
            sampler.next_1d() if m.masks else None,
            sampler.next_1d(),
            sampler.next_2d(),
            sampler.next_1d(),
            sampler.next_2d(),
        )
        random = mi.PCG32(lanes, mi.UInt64(seed))

        def body(path: Path, random: Any) -> tuple[Path, Any]:
            later = Numbers(
                random.next_float32() if m.masks else None,
                random.next_float32(),
                mi.Point2f(random.next_float32(), random.next_float32()),
                random.next_float32(),
                mi.Point2f(random.next_float32(), random.next_float32()),
            )
            self._vertex(target, path, _select_numbers(path.depth == 0, first, later), local)
            return path, random

        state, random = dr.while_loop(
            (state, random), lambda path, random: path.active, body, label="symbolic paths"
        )
        if self.groups.count:
            return
        for buffer, value in ((target.fixed, state.fixed), (target.emission, state.emission)):
            for channel in range(3):
                # Not expanded by threads, which would write the buffer's size into the kernel
                dr.scatter_add(
                    buffer, value[channel], local * 3 + channel, mode=dr.ReduceMode.Local
                )

    def _vertex(self, target: Target, path: Path, numbers: Numbers, local: Any) -> None:
        scene, m = self.scene.mi_scene, self.materials
        ray = path.ray
        si = scene.ray_intersect(ray, mi.RayFlags.All, path.depth == 0, path.active)

        # Light that the last bounce ran into, weighted against sampling it
        hit = path.active & (si.emitter(scene) != None)  # noqa: E711 (a device comparison)
        ds = mi.DirectionSample3f(scene, si, path.previous)
        light_pdf = scene.pdf_emitter_direction(path.previous, ds, hit & ~path.previous_delta)
        light_pdf = dr.select(path.previous_delta, 0, light_pdf)
        emitted = si.emitter(scene).eval(si, hit) * path.throughput
        emitted *= mis(path.previous_pdf, light_pdf)
        emitted = dr.select(hit, emitted, 0)
        group = self.groups.of(si.emitter(scene), hit)
        seen = path.depth == 0
        own = dr.select(seen, emitted, 0)
        at = group * target.pixels + local
        path.emission = self._deposit(target.emission, path.emission, own, at)
        met = path.encounters > 0
        own = dr.select(~seen & ~met, emitted, 0)
        path.fixed = self._deposit(target.fixed, path.fixed, own, at)
        tail = path.coarse + path.monomial
        if self.groups.count:
            # What was sampled at the last vertex may be of another group
            other = path.active & met & (group != path.pending_group)
            apart = dr.select(other, emitted, 0)
            self._add(target, path.row, path.terms, self._under(group, tail), apart, other)
            emitted -= apart
            tail = self._under(path.pending_group, tail)
        self._add(target, path.row, path.terms, tail, path.pending + emitted, path.active & met)
        path.pending = mi.Color3f(0)

        # Where the path goes on
        active = path.active & si.is_valid() & (path.depth < self._bounces)
        obj, symbolic = self.object_of(si, active)
        passing = mi.Bool(False)
        if m.masks:
            passing = m.passes(si, obj, numbers.opacity, active & (symbolic != PLAIN))
            active &= ~passing
        edited = active & (symbolic >= 0)
        plain = active & (symbolic == PLAIN)
        numeric = active & (symbolic == NUMERIC)
        first = edited & (path.encounters == 0)
        second = edited & (path.encounters == 1) if self.coarse else mi.Bool(False)
        later = edited & ~first & ~second

        # The frame that ours reflect in; what has only one side is black on the other
        ours = edited | numeric
        frame = m.orient(si, obj, ours)
        wo = frame.wo
        edited, numeric = edited & (wo.z > 0), numeric & (wo.z > 0)
        first, second, later = first & edited, second & edited, later & edited
        ours = edited | numeric
        active = plain | ours

        # Look up the row that a first encounter opens
        fine = mi.Bool(path.mirror_chain)
        row_index = (local * self._objects + mi.UInt32(dr.maximum(symbolic, 0))) * 2
        row = dr.gather(mi.UInt32, target.rows, row_index + dr.select(fine, 0, 1), first)
        dr.scatter_add(target.lost, mi.UInt32(1), 0, first & (row == NONE))
        path.row = dr.select(first, row, path.row)
        path.encounters += dr.select(edited, mi.UInt32(1), 0)

        # A later encounter is with one layer or group, chosen at random
        layouts = m.look_up(obj, ours)
        H = m.weight_maps(si, obj, ours)
        slot, slot_weight = m.choose(obj, numbers.layer, second)
        further = slot_weight * self._slot_map(H, slot)
        monomial = dr.select(
            later, self._next(path.monomial, m.variable(obj, slot), later), path.monomial
        )

        # Sample a light
        ds, light = scene.sample_emitter_direction(si, numbers.light, True, active)
        lit = active & (ds.pdf != 0)
        group = self.groups.of(ds.emitter, lit)
        path.pending_group = group
        light_local = si.to_local(ds.d)
        wi, shade = frame.to_local(light_local)
        above = lit & ours & (wi.z > 0)
        incoming = path.throughput * light
        ours_incoming = incoming * shade
        bsdf = si.bsdf(ray)
        u1, u2 = numbers.lobe, numbers.direction
        value_plain, pdf_plain, bs, weight_plain = bsdf.eval_pdf_sample(
            mi.BSDFContext(), si, light_local, u1, u2, plain
        )
        plain_light = incoming * value_plain * self._light_mis(ds, pdf_plain)
        plain_light = dr.select(lit & plain, plain_light, 0)
        later_light = (
            ours_incoming * further * (wi.z * dr.inv_pi * self._light_mis(ds, wi.z * dr.inv_pi))
        )
        path.pending = dr.select(later & above, later_light, 0)

        # The light's own column at a first encounter, its own coarse bin at a second one
        shaped = first | numeric
        opened = open_first(m, obj, layouts, wi, wo, u1, u2, fine | numeric, shaped & above, shaped)
        columns, bounced = (
            [replace(term, H=h) for term, h in zip(terms, H, strict=True)]
            for terms in (opened.columns, opened.bounced)
        )
        ours_light = ours_incoming * (wi.z * self._light_mis(ds, opened.pdf))
        value = dr.select(first, ours_light, 0)
        if m.any_numeric:
            reflected = m.contract(obj, columns, wo, mi.Bool(False), numeric & above)
            plain_light += dr.select(numeric & above, ours_light * reflected, 0)
        path.pending += dr.select(path.encounters > 0, plain_light, 0)
        own = dr.select(path.encounters == 0, plain_light, 0)
        at = group * target.pixels + local
        path.fixed = self._deposit(target.fixed, path.fixed, own, at)
        tail = mi.UInt32(0)
        if self.coarse:
            again = meet_second(m, obj, layouts, slot, wi, wo, u1, u2, second & above, second)
            reflected = again.quotient * wi.z * self._light_mis(ds, again.pdf)
            value = dr.select(second, ours_incoming * further * reflected, value)
            tail = dr.select(second, 1 + again.column * self._monomial_count, tail)
            columns = [select_terms(first, a, b) for a, b in zip(columns, path.terms, strict=True)]
        tail = self._under(group, tail)
        self._add(target, path.row, columns, tail, value, (first | second) & above)

        # Sample the next direction
        wi_next = dr.select(shaped, opened.wi, mi.warp.square_to_cosine_hemisphere(u2))
        pdf_next = dr.select(shaped, opened.wi_pdf, wi_next.z * dr.inv_pi)
        is_delta = shaped & opened.delta
        factor = dr.select(
            shaped, mi.Color3f(dr.select(is_delta, 1, wi_next.z) / pdf_next), further
        )
        if m.any_numeric:
            factor *= dr.select(numeric, m.contract(obj, bounced, wo, is_delta, numeric), 1)
        if self.coarse:
            wi_next = dr.select(second, again.wi, wi_next)
            pdf_next = dr.select(second, again.wi_pdf, pdf_next)
            reflected = again.wi_quotient * wi_next.z / pdf_next
            factor = dr.select(second, further * reflected, factor)
            coarse = 1 + again.wi_column * self._monomial_count
            path.coarse = dr.select(second, coarse, path.coarse)
        factor = dr.select(pdf_next > 0, factor, 0)
        path.terms = [
            select_terms(first, a.placed(), b) for a, b in zip(bounced, path.terms, strict=True)
        ]
        path.monomial = monomial

        # Move on
        outward, shade = frame.to_shading(wi_next)
        direction = si.to_world(dr.select(plain, bs.wo, outward))
        plain_delta = mi.has_flag(bs.sampled_type, mi.BSDFFlags.Delta)
        path.throughput *= dr.select(plain, weight_plain, dr.select(passing, 1, factor * shade))
        path.previous_pdf = dr.select(plain, bs.pdf, pdf_next)
        path.previous_delta = dr.select(plain, plain_delta, is_delta) | passing
        mirror = dr.select(plain, plain_delta, is_delta) | (path.previous_pdf >= MIRROR_PDF)
        path.mirror_chain &= passing | (~edited & mirror)
        path.previous = mi.Interaction3f(si)
        path.ray = si.spawn_ray(dr.select(passing, ray.d, direction))
        path.depth += 1
        going = dr.any(path.throughput != 0) | dr.any(path.pending != 0)
        path.active = passing | (active & going)

    # -- pieces ---------------------------------------------------------------------------

    def _next(self, monomial: Any, variable: Any, active: Any) -> Any:
        return dr.gather(
            mi.UInt32, self.next_monomial, monomial * self._variables + variable, active
        )

    def _under(self, group: Any, tail: Any) -> Any:
        """A tail of a light group."""
        return tail + group * self._light_tails if self.groups.count else tail

    def _deposit(self, buffer: Any, total: Any, value: Any, at: Any) -> Any:
        """Add to a picture: to the path's own total, which the pixel gets at its end, or with
        light groups at once, to the pixel `at` of the group's."""
        if not self.groups.count:
            return total + value
        for channel in range(3):
            lit = dr.any(value != 0)
            dr.scatter_add(buffer, value[channel], at * 3 + channel, lit, mode=dr.ReduceMode.Local)
        return total

    def _slot_map(self, H: list[Any], slot: Any) -> Any:
        result = mi.Color3f(1)
        if self.materials.maps:
            for s, value in enumerate(H):
                result = dr.select(slot == s, value, result)
        return result

    @staticmethod
    def _light_mis(ds: Any, pdf: Any) -> Any:
        return dr.select(ds.delta, 1, mis(ds.pdf, pdf))

    def _add(
        self, target: Target, row: Any, terms: list[Terms], tail: Any, value: Any, active: Any
    ) -> None:
        """T[row, column_k, tail] += quotient_k · H · value, for every layer slot."""
        active = active & (row != NONE) & dr.any(value != 0)
        terms = [term.placed() for term in terms]

        def add(row: Any, terms: list[Terms], tail: Any, value: Any, active: Any) -> tuple[()]:
            for term in terms:
                _add_term(target, row, term, tail, value, active)
            return ()

        # A packet in which no path adds branches round it all
        arguments = row, terms, tail, value, active
        dr.if_stmt(arguments, active, add, lambda *_: (), label="additions")


def _add_term(target: Target, row: Any, term: Terms, tail: Any, value: Any, active: Any) -> None:
    """Add to the quotients of a layer's bin, which lie side by side from an even place on; two in
    one step where no addition need be atomic. A layer of one quotient has odd places too."""
    colour = value if term.H is None else value * term.H
    qs = term.quotients
    place = row + term.place + (tail if term.step is None else tail * term.step)
    if not target.apart or len(qs) == 1:
        for k, q in enumerate(qs):
            _add_to_place(target, place + k, colour * q, active & (q != 0))
        return
    alone = term.step == 1
    _add_to_place(target, place, colour * qs[0], active & alone & (qs[0] != 0))
    for k in range(0, len(qs), 2):
        pair = [*(colour * qs[k]), mi.Float(0), mi.Float(0), mi.Float(0), mi.Float(0), mi.Float(0)]
        lit = qs[k] != 0
        if k + 1 < len(qs):
            pair[4:7] = list(colour * qs[k + 1])
            lit |= qs[k + 1] != 0
        mode = dr.ReduceMode.NoConflicts
        at = (place + k) >> 1
        dr.scatter_add(target.transport, mi.ArrayXf(pair), at, active & ~alone & lit, mode=mode)


def _add_to_place(target: Target, place: Any, colour: Any, active: Any) -> None:
    """transport[place] += colour. Adding channel by channel costs a third of a pass."""
    if target.apart:
        value = mi.Vector4f(colour.x, colour.y, colour.z, 0)
        mode = dr.ReduceMode.NoConflicts
        dr.scatter_add(target.transport, value, place, active, mode=mode)
        return
    for channel in range(3):
        dr.scatter_add(target.transport, colour[channel], place * CELL + channel, active)


def mis(a: Any, b: Any) -> Any:
    """Power heuristic for a sample of density a against another technique's b."""
    a2 = dr.square(a)
    weight = a2 / (a2 + dr.square(b))
    return dr.select(dr.isfinite(weight), weight, 0)


def _select_numbers(condition: Any, a: Numbers, b: Numbers) -> Numbers:
    return Numbers(
        None if a.opacity is None else dr.select(condition, a.opacity, b.opacity),
        dr.select(condition, a.layer, b.layer),
        dr.select(condition, a.light, b.light),
        dr.select(condition, a.lobe, b.lobe),
        dr.select(condition, a.direction, b.direction),
    )
