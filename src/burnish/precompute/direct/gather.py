"""The light of all lights at the points of one object's rows: one lane a row, one loop a launch.

A lane goes through the triangles, and through the pieces of those that it has to split, one
piece a turn (2006, code 1): the coordinate at its corners and the middles of its edges, a shadow
ray to a random place in it, the quotients there, and the bins that it overlaps. No two lanes of
a launch share a row, so nothing need be atomic.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from burnish.precompute.direct.lights import LightTables
from burnish.precompute.direct.overlap import Bands, Extent
from burnish.precompute.tracer import CELL, Tracer

BEND = 0.5
"""Bins by which a coordinate may be bent over a triangle before it is split."""

LARGEST = 0.04
"""Steradians of a piece that is always split: cosine, quotient and shadow vary over it."""

GOLDEN = (0.7548776662466927, 0.5698402909980532)
"""Steps of the plane's most even additive sequence (Roberts 2018)."""


@dataclass(frozen=True)
class Mirror:
    """What each row's mirror direction asks for; arrays of the device over rows.

    direction: where the row's mean normal mirrors the eye to, world space. cosine: of the angle
    around it inside which lights are near. near, far: what the light of near and other lights
    is times at this point; 0 where it is not gathered. smallest: steradians of a piece that is
    not split any more, whatever a coordinate does in it.
    """

    direction: Any
    cosine: Any
    near: Any
    far: Any
    smallest: Any

    def weight(self, centre: Any, cosine: Any) -> Any:
        """near or far, for lights with these centres and the cosines of their radii; what is at
        hand has cosine -1, and is near."""
        sines = dr.safe_sqrt(1 - dr.square(self.cosine)) * dr.safe_sqrt(1 - dr.square(cosine))
        # The sum of both angles may exceed 180 degrees: then everything is near
        wide = self.cosine + cosine < 0
        near = wide | (dr.dot(centre, self.direction) > self.cosine * cosine - sines)
        return dr.select(near, self.near, self.far)


class ObjectLight:
    """Gathers the light of all lights for the rows of one symbolic object."""

    def __init__(self, tracer: Tracer, index: int, tables: LightTables) -> None:
        self.tracer, self.tables = tracer, tables
        item = tracer.basis.objects[index]
        slices = [part for part in tracer.basis.slices(index) if not part.delta]
        self.bands = [Bands(layer) for layer in item.material.layers]
        self._first = [dr.opaque(mi.UInt32, part.start) for part in slices]
        self._stride = [dr.opaque(mi.UInt32, layer.bins) for layer in item.material.layers]
        self._mirrors = [
            dr.opaque(mi.UInt32, part.start) for part in tracer.basis.slices(index) if part.delta
        ]
        self._tails = dr.opaque(mi.UInt32, tracer.basis.tails)
        # Without light groups what falls into one column alone is summed before it is stored
        self.summed = [band.plain and not tracer.basis.lights for band in self.bands]

    def add(
        self,
        target: Any,
        offsets: Any,
        origin: Any,
        direction: Any,
        mirror: Mirror,
        number: int,
        seed: int,
    ) -> None:
        """Add the light at one point of each row to `target`, float [values · CELL].

        offsets: uint32 [rows], of each row in values. origin, direction: the camera's rays to
        the points. number: which of the row's points they are.
        """
        scene, m = self.tracer.scene.mi_scene, self.tracer.materials
        ray = mi.Ray3f(origin, direction)
        si = scene.ray_intersect(ray)
        obj, _ = self.tracer.object_of(si, si.is_valid())
        frame = m.orient(si, obj, si.is_valid())
        active = si.is_valid() & (frame.wo.z > 0)
        shifts = tuple(dr.opaque(mi.Float, (number * step) % 1.0) for step in GOLDEN)
        seeds = dr.arange(mi.UInt32, dr.width(offsets)) + dr.opaque(mi.UInt32, seed & 0xFFFFFFFF)
        if self.tables.any_triangles:
            self._triangles(target, offsets, si, frame, mirror, active, seeds, shifts)
            dr.eval(target)
        if self._mirrors:
            self._mirror(target, offsets, si, frame, mirror, active)
            dr.eval(target)
        if self.tables.any_strata:
            self._strata(target, offsets, si, frame, mirror, active, seeds, shifts)
            dr.eval(target)

    # -- triangles ------------------------------------------------------------------------

    def _triangles(
        self,
        target: Any,
        offsets: Any,
        si: Any,
        frame: Any,
        mirror: Mirror,
        active: Any,
        seeds: Any,
        shifts: Any,
    ) -> None:
        t, scene = self.tables, self.tracer.scene.mi_scene
        normal = si.to_world(frame.to_shading(mi.Vector3f(0, 0, 1))[0])

        def next_of(light: Any) -> Any:
            """The first light from this one on that the point may see."""

            def skipped(k: Any) -> Any:
                here = k < t.count
                cap = dr.gather(mi.Vector4f, t.caps, k, here)
                centre = mi.Vector3f(cap.x, cap.y, cap.z)
                dark = dr.dot(centre, normal) < -dr.safe_sqrt(1 - dr.square(cap.w))
                return here & (cap.w > -0.5) & (dark | (mirror.weight(centre, cap.w) == 0))

            result: Any = dr.while_loop(
                (light,), lambda k: active & skipped(k), lambda k: (k + 1,), label="dark lights"
            )[0]
            return result

        def body(light: Any, piece: Any, sums: list[list[Any]]) -> tuple[Any, ...]:
            here = active & (light < t.count)
            A = dr.gather(mi.Vector4f, t.triangles, light * 3, here)
            E = dr.gather(mi.Vector4f, t.triangles, light * 3 + 1, here)
            F = dr.gather(mi.Vector4f, t.triangles, light * 3 + 2, here)
            part = dr.gather(mi.Vector4f, t.tree, piece, here)
            local = E.w != 0
            corner, first, second = (mi.Vector3f(v.x, v.y, v.z) for v in (A, E, F))
            corner += part.x * first + part.y * second
            corner -= dr.select(local, mi.Vector3f(si.p), 0)
            first, second = first * part.z, second * part.z

            # Its solid angle, from the edges: the corners are nearly parallel
            p = (corner, corner + first, corner + second)
            normal = dr.cross(first, second)
            length = [dr.norm(v) for v in p]
            facing = dr.dot(corner, normal)
            spread = length[0] * length[1] * length[2]
            for k in range(3):
                spread += dr.dot(p[k], p[(k + 1) % 3]) * length[(k + 2) % 3]
            angle = 2 * dr.atan2(dr.abs(facing), spread)

            # Above the horizon, and lit on this side
            ways = [p[k] / length[k] for k in range(3)]
            corners = [frame.to_local(si.to_local(way))[0] for way in ways]
            lit = here & ((corners[0].z > 0) | (corners[1].z > 0) | (corners[2].z > 0))
            lit &= ~local | (facing < 0)

            # Split what a coordinate bends, and what is large
            extents: list[list[Extent]] = []
            bent = mi.Float(0)
            middles = [
                frame.to_local(si.to_local(dr.normalize(p[k] + p[(k + 1) % 3])))[0]
                for k in range(3)
            ]
            for band in self.bands:
                if band.plain:
                    extents.append([])
                    continue
                found, by = band.extents(corners, middles, frame.wo)
                bent = dr.maximum(bent, by)
                extents.append(found)
            split = lit & ((bent > BEND) | (angle > LARGEST)) & (angle > mirror.smallest)
            split &= part.w > 1.5
            final = lit & ~split

            # A place in it, and what it sends from there
            u, v = _random(light * t.pieces + piece, seeds, shifts)
            root = dr.sqrt(u)
            place = corner + (1 - root) * first + (v * root) * second
            way = dr.normalize(place)
            wi, factor = frame.to_local(si.to_local(way))
            final &= wi.z > 0
            shadow = dr.select(local, si.spawn_ray_to(mi.Point3f(place + si.p)), si.spawn_ray(way))
            final &= ~scene.ray_test(shadow, final)
            entry = mi.UInt32(A.w) + dr.select(
                local, 0, dr.gather(mi.UInt32, t.entry, piece, final)
            )
            value = dr.gather(mi.Color3f, t.radiance, entry, final)
            cap = dr.gather(mi.Vector4f, t.caps, light, final)
            share = mirror.weight(mi.Vector3f(cap.x, cap.y, cap.z), cap.w)
            value *= dr.select(final, angle * wi.z * factor * share, 0)
            group = mi.UInt32(F.w)
            # What is bent in the smallest piece all the same counts where the ray went
            pointed = bent > BEND
            self._deposit(
                target, offsets, sums, extents, wi, frame.wo, value, group, final, pointed
            )

            # On to its first piece, or past all of them
            piece += dr.select(split, 1, mi.UInt32(part.w))
            over = piece >= t.pieces
            light = next_of(light + dr.select(over, 1, mi.UInt32(0)))
            return light, dr.select(over, 0, piece), sums

        _, _, sums = dr.while_loop(
            (next_of(dr.zeros(mi.UInt32, dr.width(offsets))), mi.UInt32(0), self._no_sums()),
            lambda light, piece, sums: active & (light < t.count),
            body,
            label="triangles",
        )
        self._store(target, offsets, sums, active)

    # -- the mirror direction ---------------------------------------------------------------

    def _mirror(
        self, target: Any, offsets: Any, si: Any, frame: Any, mirror: Mirror, active: Any
    ) -> None:
        """The delta columns: the emission that a smooth layer mirrors."""
        scene = self.tracer.scene.mi_scene
        wo = frame.wo
        way, factor = frame.to_shading(mi.Vector3f(-wo.x, -wo.y, wo.z))
        seen = scene.ray_intersect(si.spawn_ray(si.to_world(way)), active)
        emitter = seen.emitter(scene)
        lit = active & (emitter != None)  # noqa: E711 (a device comparison)
        value = mi.Color3f(emitter.eval(seen, lit)) * dr.select(lit, factor * mirror.near, 0)
        group = self.tracer.groups.of(emitter, lit)
        for column in self._mirrors:
            _add(target, offsets + column * self._tails + group, value, lit)

    # -- strata ---------------------------------------------------------------------------

    def _strata(
        self,
        target: Any,
        offsets: Any,
        si: Any,
        frame: Any,
        mirror: Mirror,
        active: Any,
        seeds: Any,
        shifts: Any,
    ) -> None:
        t, scene = self.tables, self.tracer.scene.mi_scene
        emitters = scene.emitters_dr()

        def body(k: Any, sums: list[list[Any]]) -> tuple[Any, ...]:
            here = active & (k < t.strata)
            square = dr.gather(mi.Vector4f, t.strata_square, k, here)
            emitter = dr.gather(
                mi.EmitterPtr, emitters, dr.gather(mi.UInt32, t.strata_emitter, k, here), here
            )
            u, v = _random(k, seeds, shifts)
            inside = mi.Point2f(square.x + u * square.z, square.y + v * square.z)
            ds, light = emitter.sample_direction(si, inside, here)
            wi, factor = frame.to_local(si.to_local(ds.d))
            final = here & (ds.pdf > 0) & (wi.z > 0)
            final &= ~scene.ray_test(si.spawn_ray_to(ds.p), final)
            value = mi.Color3f(light) * dr.select(final, wi.z * factor * square.w * mirror.near, 0)
            group = dr.gather(mi.UInt32, t.strata_group, k, here)
            self._deposit(target, offsets, sums, None, wi, frame.wo, value, group, final, None)
            return k + 1, sums

        _, sums = dr.while_loop(
            (mi.UInt32(0), self._no_sums()),
            lambda k, sums: active & (k < t.strata),
            body,
            label="strata",
        )
        self._store(target, offsets, sums, active)

    # -- pieces ---------------------------------------------------------------------------

    def _no_sums(self) -> list[list[Any]]:
        """A sum for each quotient of each layer that has one column alone."""
        return [
            [mi.Color3f(0) for _ in range(band.model.rank)] if summed else []
            for band, summed in zip(self.bands, self.summed, strict=True)
        ]

    def _deposit(
        self,
        target: Any,
        offsets: Any,
        sums: list[list[Any]],
        extents: list[list[Extent]] | None,
        wi: Any,
        wo: Any,
        value: Any,
        group: Any,
        active: Any,
        pointed: Any,
    ) -> None:
        """Add quotient · value to the bins of every layer: those that the extents reach, or
        that of wi alone where `pointed` or without extents."""
        for s, band in enumerate(self.bands):
            quotients = band.quotients(wi, wo)
            if self.summed[s]:
                for k, q in enumerate(quotients):
                    sums[s][k] += dr.select(active, value * q, 0)
                continue
            first = offsets + self._first[s] * self._tails + group
            colours = [value * q for q in quotients]
            stride = self._stride[s]

            def put(
                j: Any,
                share: Any,
                lit: Any,
                first: Any = first,
                colours: Any = colours,
                stride: Any = stride,
            ) -> None:
                for k, colour in enumerate(colours):
                    _add(target, first + (j + k * stride) * self._tails, colour * share, lit)

            if band.plain:
                put(mi.UInt32(0), mi.Float(1), active)
                continue
            narrow = [Extent(t, t, t) for t in band.coordinates(wi, wo)]
            if extents is not None:
                narrow = [
                    Extent(
                        dr.select(pointed, point.low, wide.low),
                        dr.select(pointed, point.middle, wide.middle),
                        dr.select(pointed, point.high, wide.high),
                    )
                    for point, wide in zip(narrow, extents[s], strict=True)
                ]
            band.spread(narrow, put, active)

    def _store(self, target: Any, offsets: Any, sums: list[list[Any]], active: Any) -> None:
        for s, own in enumerate(sums):
            for k, colour in enumerate(own):
                cell = offsets + (self._first[s] + k * self._stride[s]) * self._tails
                _add(target, cell, colour, active)


def _add(target: Any, cell: Any, colour: Any, active: Any) -> None:
    """target[cell] += colour; no two lanes share a row."""
    value = mi.Vector4f(colour.x, colour.y, colour.z, 0)
    assert len(value) == CELL
    dr.scatter_add(
        target, value, cell, active & dr.any(colour != 0), mode=dr.ReduceMode.NoConflicts
    )


def _random(number: Any, seeds: Any, shifts: Any) -> tuple[Any, Any]:
    """Two numbers in [0, 1) for a light's piece at a row, evenly spread over the row's points."""
    a, b = mi.sample_tea_32(number, seeds, 4)
    u = mi.Float(a >> 8) * 2.0**-24 + shifts[0]
    v = mi.Float(b >> 8) * 2.0**-24 + shifts[1]
    return u - dr.floor(u), v - dr.floor(v)
