"""Gather samples by shooting backwards from a view (2010, section 5.1).

A ray through a random pixel meets a surface and is reflected once, evenly over the hemisphere
or, for one in seven, about the mirror direction with density ∝ (ωo·R(ωs))^200; where it lands
is a sample. More such points, and points spread evenly over all surfaces, find out how large
the cells are and give each a few places to be lit at.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.types import AnyArray, Float32, Float64
from burnish.precompute.film import Camera
from burnish.precompute.relight.cells import CellFinder, build
from burnish.precompute.relight.onward import Onward, OnwardCells
from burnish.precompute.relight.paths import Met, Paths
from burnish.precompute.symbolic import PLAIN
from burnish.scene import Scene, View
from burnish.transport.gather import CellTree, GatherSamples

DIFFUSE_SHARE = 6 / 7
"""Diffuse to glossy reflections are six to one (2010, section 5.1)."""
EXPONENT = 200.0
POINTS = 8
"""Places in each cell at which direct light is asked."""
CANDIDATES = 16
"""Photons shot for each sample wanted."""
AREA_POINTS = 32
"""Points spread over all surfaces, for each sample, that measure the areas."""
SKY_CELLS = 4096
"""Parts of the sky that glossy objects are found to show."""
EVEN_CELLS = 64
"""Further ones of each such object, spread evenly."""
LEAST_PER_OBJECT = 4


@dataclass
class _Photons:
    """Where photons landed: float32 [n, 3] and so on, as in `GatherSamples`; H: of each slot."""

    position: AnyArray
    normal: AnyArray
    surface: AnyArray
    object: AnyArray
    glossy: AnyArray
    H: AnyArray
    plain: AnyArray

    def __len__(self) -> int:
        return len(self.object)

    def take(self, which: AnyArray) -> _Photons:
        return _Photons(*(getattr(self, name)[which] for name in _FIELDS))

    def like(self, position: AnyArray, owner: AnyArray) -> _Photons:
        """Points that reflect nothing."""
        n = len(position)
        nothing = np.zeros((n, 3), np.float32)
        return _Photons(
            np.ascontiguousarray(position, np.float32),
            nothing,
            nothing,
            owner.astype(np.int32),
            np.zeros(n, bool),
            np.zeros((n, *self.H.shape[1:]), np.float32),
            nothing,
        )

    @staticmethod
    def join(parts: list[_Photons]) -> _Photons:
        return _Photons(*(np.concatenate([getattr(p, n) for p in parts]) for n in _FIELDS))


_FIELDS = ("position", "normal", "surface", "object", "glossy", "H", "plain")


def shoot(
    scene: Scene,
    views: tuple[View, ...],
    paths: Paths,
    onward: Onward,
    count: int,
    seed: int,
) -> tuple[CellTree, GatherSamples, CellFinder, OnwardCells | None]:
    """About `count` samples for the views together, their tree, and how points find a cell;
    and what paths that go on find, where there is anything."""
    random = np.random.default_rng(seed)
    shot = [
        _shoot(view, paths, onward, CANDIDATES * count // len(views), seed + 31 * v)
        for v, view in enumerate(views)
    ]
    photons = _Photons.join([own for own, _ in shot])
    left = _Photons.join([own for _, own in shot])
    spread = _spread(scene, paths, max(AREA_POINTS * count, 1 << 14), random)
    chosen = _choose(photons, spread[0], count, len(scene.objects), random)
    surfaces, lights = len(chosen), _Lights(scene, onward)
    chosen = _Photons.join([chosen, lights.skies(left, random), lights.lamps(chosen)])
    owners, owner = np.unique(chosen.object, return_inverse=True)
    tree, planes, order = build(
        chosen.position, chosen.normal, owner.ravel().astype(np.int32), len(owners)
    )
    chosen = chosen.take(order)
    first, scale = np.zeros(lights.owners, np.int32), np.ones(lights.owners, np.float32)
    first[owners], scale[owners] = planes.first, planes.scale
    # An object that no photon and no even point fell on is as good as not there
    planes = replace(planes, first=first, scale=scale)
    finder = CellFinder(tree, planes, np.zeros(len(chosen), np.float32))
    area = _areas(finder, spread, chosen)
    area[order >= surfaces] = 4 * np.pi / max(len(order) - surfaces, 1)
    finder = CellFinder(tree, planes, np.sqrt(area / np.pi).astype(np.float32))
    points = _points(finder, _Photons.join([photons, left]), spread[0], chosen, random)
    samples = _samples(scene, paths, chosen, area, points, lights)
    found = None
    if onward.useful:
        found = OnwardCells(onward, finder, len(scene.objects), lights.cells(chosen))
    return replace(tree, area=area), samples, finder, found


class _Lights:
    """Samples of what glossy objects show of the lights, and which tree each kind has.

    Of the objects o come first; then the sky through each of them; then lamps through each.
    """

    def __init__(self, scene: Scene, onward: Onward) -> None:
        self._objects, self._lights, self._onward = len(scene.objects), len(scene.lights), onward
        self.owners = self._objects * (2 + self._lights)

    def skies(self, left: _Photons, random: np.random.Generator) -> _Photons:
        """Some of the directions that were found, and for each object some even ones."""
        some = random.permutation(len(left))[:SKY_CELLS]
        if not self._onward.useful or self._onward.sky < 0:
            return left.take(some[:0])
        through = np.repeat(self._onward.glossy, EVEN_CELLS) + self._objects
        even = random.normal(size=(len(through), 3))
        even /= np.linalg.norm(even, axis=1, keepdims=True)
        return _Photons.join([left.take(some), left.like(even, through)])

    def lamps(self, like: _Photons) -> _Photons:
        """One through each glossy object."""
        onward = self._onward
        lamps = onward.lamps if onward.useful else onward.lamps[:0]
        first = 2 * self._objects + onward.glossy[:, None] * self._lights
        owner = (first + lamps).ravel()
        return like.like(np.zeros((len(owner), 3)), owner)

    def cells(self, chosen: _Photons) -> AnyArray:
        """The cell of each lamp through each object, -1 for none: [objects, lights]."""
        result = np.full(self._objects * self._lights, -1, np.int32)
        own = np.flatnonzero(chosen.object >= 2 * self._objects)
        result[chosen.object[own] - 2 * self._objects] = own
        return result.reshape(self._objects, self._lights)

    def shown(self, owner: AnyArray) -> tuple[AnyArray, AnyArray]:
        """Which light a cell shows and through which of the scene's objects, -1 for none."""
        lamp, sky = owner >= 2 * self._objects, owner >= self._objects
        number = np.maximum(owner - 2 * self._objects, 0)
        lights = max(self._lights, 1)
        light = np.where(lamp, number % lights, np.where(sky, self._onward.sky, -1))
        through = np.where(lamp, number // lights, np.where(sky, owner - self._objects, -1))
        return light, through


def _shoot(
    view: View, paths: Paths, onward: Onward, count: int, seed: int
) -> tuple[_Photons, _Photons]:
    """Photons, and directions in which paths that go on from them leave, as if they were."""
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, count)
    random = mi.PCG32(count, mi.UInt64(seed + 1))
    pixel = mi.UInt32(sampler.next_1d() * view.pixels)
    ray, _ = Camera(view).numbered(dr.minimum(pixel, view.pixels - 1), sampler)
    met, random = paths.meet(ray, random, dr.full(mi.Bool, True, count))
    si = met.si
    # The side that is seen
    side = dr.select(si.wi.z < 0, -1, mi.Float(1))
    wo = mi.Vector3f(si.wi.x, si.wi.y, si.wi.z * side)
    glossy = sampler.next_1d() >= DIFFUSE_SHARE
    glossy &= ~_matte(paths, met)
    u = sampler.next_2d()
    even = mi.warp.square_to_uniform_hemisphere(u)
    cosine = dr.power(u.x, 1 / (EXPONENT + 1))
    sine = dr.safe_sqrt(1 - dr.square(cosine))
    sin_phi, cos_phi = dr.sincos(2 * dr.pi * u.y)
    about = mi.Frame3f(mi.Vector3f(-wo.x, -wo.y, wo.z))
    peaked = about.to_world(mi.Vector3f(sine * cos_phi, sine * sin_phi, cosine))
    wi = dr.select(glossy, peaked, even)
    usable = met.valid & (wi.z > 0)
    wi.z *= side
    landed, random = paths.meet(si.spawn_ray(si.to_world(wi)), random, usable)
    found = _photons(paths, landed, glossy)
    if not onward.useful or onward.sky < 0:
        return found, found.take(np.zeros(0, np.int64))
    weight, sky, direction, _ = onward.go(landed, random)
    gone = np.flatnonzero(np.array(sky & (weight != 0)))
    through = np.array(landed.obj)[gone].astype(np.int32) + len(paths.scene.objects)
    return found, found.like(np.array(direction).T[gone], through)


def _matte(paths: Paths, met: Met) -> mi.Bool:
    """Whether a surface of ours has no glossy layer."""
    share = dr.gather(mi.Float, paths.materials.half_share, met.obj, met.valid)
    return (met.symbolic != PLAIN) & (share == 0)


def _photons(paths: Paths, met: Met, glossy: mi.Bool) -> _Photons:
    si, m = met.si, paths.materials
    ours = met.valid & (met.symbolic != PLAIN)
    H = m.weight_maps(si, met.obj, ours)
    # What has only one side is black on the other
    seen = dr.select(ours & (met.frame.wo.z <= 0), 0, mi.Float(1))
    colours = [mi.Color3f(seen) if h is None else mi.Color3f(h) * seen for h in H]
    colours = colours or [mi.Color3f(seen)]
    plain = si.bsdf(met.ray).eval_diffuse_reflectance(si, met.valid & ~ours)
    # Towards where it was seen from
    flip = dr.select(si.wi.z < 0, -1, mi.Float(1))
    normal = si.sh_frame.n * flip
    surface = si.n * dr.select(dr.dot(si.n, normal) < 0, -1, mi.Float(1))
    kept = np.flatnonzero(np.array(met.valid))
    lanes = len(np.array(met.valid))

    def vectors(value: object) -> Float32:
        array = np.broadcast_to(np.array(value, np.float32), (3, lanes))
        return np.ascontiguousarray(array.T[kept])

    return _Photons(
        vectors(si.p),
        vectors(normal),
        vectors(surface),
        np.array(met.obj)[kept].astype(np.int32),
        np.broadcast_to(np.array(glossy), lanes)[kept],
        np.stack([vectors(colour) for colour in colours], axis=1),
        vectors(plain),
    )


def _spread(
    scene: Scene, paths: Paths, count: int, random: np.random.Generator
) -> tuple[_Photons, Float64]:
    """Points even over all surfaces, some at least on each shape, and the area of each."""
    shapes = scene.mi_scene.shapes()
    sizes = np.array([float(np.asarray(shape.surface_area()).item()) for shape in shapes])
    parts, areas = [], []
    total = max(float(sizes.sum()), 1e-30)
    for shape, size in zip(shapes, sizes, strict=True):
        own = max(int(count * min(size / total, 1.0)), 8 * LEAST_PER_OBJECT)
        if not np.isfinite(size) or size <= 0:
            continue
        u = mi.Point2f(random.random((2, own)).astype(np.float32))
        at = shape.sample_position(0.0, u)
        # Seen from just above, so that textures get the interaction of a picture
        height = 1e-4 * float(np.linalg.norm(np.asarray(shape.bbox().extents())))
        ray = mi.Ray3f(at.p + height * at.n, -at.n)
        ray.maxt = 2 * height
        si = scene.mi_scene.ray_intersect(ray)
        hit = si.is_valid() & (si.shape == mi.ShapePtr(shape))
        obj, symbolic = paths.object_of(si, hit)
        frame = paths.materials.orient(si, obj, hit & (symbolic != PLAIN))
        white = dr.full(mi.Color3f, 1, own)
        met = Met(si, obj, symbolic, frame, white, white, ray, hit)
        found = _photons(paths, met, dr.full(mi.Bool, False, own))
        parts.append(found)
        areas.append(np.full(len(found), size / own))
    return _Photons.join(parts), np.concatenate(areas)


def _choose(
    photons: _Photons, spread: _Photons, count: int, objects: int, random: np.random.Generator
) -> _Photons:
    """Some photons, six diffuse to one glossy where there are glossy ones, and for objects that
    they missed a few even points."""
    kinds = [np.flatnonzero(~photons.glossy), np.flatnonzero(photons.glossy)]
    glossy = min(round(count * (1 - DIFFUSE_SHARE)), len(kinds[1]))
    wanted = (min(count - glossy, len(kinds[0])), glossy)
    picked = [random.choice(own, n, replace=False) for own, n in zip(kinds, wanted, strict=True)]
    chosen = [photons.take(np.concatenate(picked))]
    have = np.bincount(chosen[0].object, minlength=objects)
    chosen += [
        spread.take(np.flatnonzero(spread.object == o)[:LEAST_PER_OBJECT])
        for o in np.flatnonzero(have < LEAST_PER_OBJECT)
    ]
    return _Photons.join(chosen)


def _cells_of(finder: CellFinder, points: _Photons) -> AnyArray:
    found = finder.find(
        mi.UInt32(points.object.astype(np.uint32)),
        mi.Point3f(np.ascontiguousarray(points.position.T)),
        mi.Vector3f(np.ascontiguousarray(points.normal.T)),
        dr.full(mi.Bool, True, len(points)),
    )
    return np.array(found).astype(np.int64)


def _areas(finder: CellFinder, spread: tuple[_Photons, Float64], chosen: _Photons) -> Float32:
    """|A_g|: the even points nearest to each sample, counted (2010, section 5.1).

    A cell that none fell on has a hundredth of one's area.
    """
    points, area = spread
    known = np.isin(points.object, np.unique(chosen.object))
    # What stands for the sky and for lamps is no surface
    cells = _cells_of(finder, points.take(known))
    sums = np.bincount(cells, weights=area[known], minlength=len(chosen))
    least = 0.01 * float(area.min())
    return np.maximum(sums, least).astype(np.float32)


def _points(
    finder: CellFinder,
    photons: _Photons,
    spread: _Photons,
    chosen: _Photons,
    random: np.random.Generator,
) -> _Photons:
    """POINTS points in each cell, as photons fell or else even ones; [g · POINTS]."""
    known = np.flatnonzero(np.isin(photons.object, np.unique(chosen.object)))
    every = _Photons.join([chosen, photons.take(known), spread])
    known = np.flatnonzero(np.isin(every.object, np.unique(chosen.object)))
    cells = np.full(len(every), -1, np.int64)
    cells[known] = _cells_of(finder, every.take(known))
    cells[: len(chosen)] = np.arange(len(chosen))
    # Photons first, then even points, each in a random order; then round and round
    rank = np.repeat([0, 1, 2], [len(chosen), len(every) - len(chosen) - len(spread), len(spread)])
    rank = np.where(rank == 0, 1, rank)
    order = np.lexsort((random.random(len(every)), rank, cells))
    order = order[np.searchsorted(cells[order], 0) :]
    start = np.searchsorted(cells[order], np.arange(len(chosen)))
    count = np.bincount(cells[order], minlength=len(chosen))
    turn = np.arange(POINTS)[None, :] % count[:, None]
    return every.take(order[(start[:, None] + turn).ravel()])


def _samples(
    scene: Scene,
    paths: Paths,
    chosen: _Photons,
    area: Float32,
    points: _Photons,
    lights: _Lights,
) -> GatherSamples:
    g, basis, m = len(chosen), paths.materials.basis, paths.materials
    shape = (g, POINTS, 3)
    positions = {item.id: i for i, item in enumerate(basis.objects)}
    groups = max((len(item.material.groups) for item in basis.objects), default=1)
    variable = np.full((g, groups), -1, np.int32)
    reflects = np.zeros((g, POINTS, groups, 3), np.float32)
    fixed = np.zeros(shape, np.float32)
    shows, through = lights.shown(chosen.object)
    place = np.array([positions.get(thing.id, -1) for thing in scene.objects])
    H = points.H.reshape(g, POINTS, -1, 3)
    plain = points.plain.reshape(shape)
    for o, thing in enumerate(scene.objects):
        own = np.flatnonzero(chosen.object == o)
        if thing.id not in positions:
            fixed[own] = plain[own]
            continue
        i = positions[thing.id]
        material = basis.objects[i].material
        names = [layer.group for layer in material.layers]
        for k, group in enumerate(material.groups):
            variable[own, k] = basis.variables.index((i, group))
            reflects[own, :, k] = H[own][:, :, names.index(group)] if m.slots else 1.0
    return GatherSamples(
        chosen.position,
        chosen.normal,
        area,
        chosen.glossy,
        chosen.object,
        points.position.reshape(shape),
        points.normal.reshape(shape),
        points.surface.reshape(shape),
        variable,
        reflects,
        fixed,
        shows.astype(np.int32),
        np.where(through >= 0, place[through], -1).astype(np.int32),
    )
