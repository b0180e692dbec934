"""Cells: every surface point belongs to the gather sample of a box in space and direction.

A tree of planes parts the samples of each object by position and by normal, down to one
sample. A point finds its cell by walking down: no distances are compared, and the same tree
serves the compression of matrices over the cells.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.types import AnyArray, Float32, Float64, Int32
from burnish.transport.gather import CellTree

NORMAL_WEIGHT = 0.5
"""How far apart opposite normals are, in units of half an object's size."""


APART = 1e12
"""How far apart the cells of different objects lie: no node is to stand for several."""


@dataclass(frozen=True)
class Planes:
    """How a point walks down a tree: for each node the coordinate (0–5: position, weighted
    normal) and where it is cut. first: int32 [objects], where an object's own tree begins.
    scale: float32 [objects], the weight of the normal, in units of length."""

    axis: Int32
    cut: Float32
    first: Int32
    scale: Float32


def build(
    position: AnyArray, normal: AnyArray, owner: Int32, objects: int
) -> tuple[CellTree, Planes, Int32]:
    """A tree over samples [g, 3], each of an object; every object needs at least one.

    Returns the tree, with all areas 1, its planes and the order of the samples in it: int32 [g].
    """
    scale = np.zeros(objects, np.float32)
    groups = []
    for o in range(objects):
        own = np.flatnonzero(owner == o).astype(np.int32)
        size = np.ptp(position[own], axis=0)
        scale[o] = NORMAL_WEIGHT * 0.5 * float(np.linalg.norm(size)) + 1e-6
        groups.append(own)
    points = np.concatenate([position, normal * scale[owner][:, None]], axis=1).astype(np.float64)
    builder = _Builder(points)
    first = builder.objects(groups)
    order, tree = builder.finish()
    planes = Planes(
        np.array(builder.axis, np.int32), np.array(builder.cut, np.float32), first, scale
    )
    return tree, planes, order


class _Builder:
    """Grows the tree from the root, so that parents come before their children."""

    def __init__(self, points: Float64) -> None:
        self.points = points
        self.axis: list[int] = []
        self.cut: list[float] = []
        self.child: list[int] = []
        self.members: list[Int32 | None] = []
        self.extent: list[float] = []

    def _add(self) -> int:
        self.axis.append(0)
        self.cut.append(0.0)
        self.child.append(-1)
        self.extent.append(0.0)
        self.members.append(None)
        return len(self.axis) - 1

    def objects(self, groups: list[Int32]) -> Int32:
        """Halve the list of objects, then each object; the node where each one begins."""
        first = np.zeros(len(groups), np.int32)
        middles = np.array([self.points[own, :3].mean(axis=0) for own in groups])
        waiting = [(self._add(), list(range(len(groups))))]
        while waiting:
            node, some = waiting.pop()
            own = np.concatenate([groups[o] for o in some])
            if len(some) == 1:
                first[some[0]] = node
                self._part(node, own)
                continue
            axis = int(np.argmax(np.ptp(middles[some], axis=0)))
            some.sort(key=lambda o: middles[o, axis])
            self.extent[node] = APART
            left, right = self._children(node)
            waiting += [(left, some[: len(some) // 2]), (right, some[len(some) // 2 :])]
        return first

    def _children(self, node: int) -> tuple[int, int]:
        left = self._add()
        self.child[node] = left
        return left, self._add()

    def _part(self, root: int, own: Int32) -> None:
        waiting = [(root, own)]
        while waiting:
            node, own = waiting.pop()
            if len(own) == 1:
                self.members[node] = own
                continue
            points = self.points[own]
            span = np.ptp(points, axis=0)
            axis, half = int(np.argmax(span)), len(own) // 2
            order = np.argpartition(points[:, axis], half)
            low, high = own[order[:half]], own[order[half:]]
            edge = points[order[:half], axis].max() + points[order[half], axis]
            self.axis[node], self.cut[node] = axis, float(edge / 2)
            self.extent[node] = float(np.linalg.norm(span))
            left, right = self._children(node)
            waiting += [(left, low), (right, high)]

    def finish(self) -> tuple[Int32, CellTree]:
        count = len(self.axis)
        start, stop = np.zeros(count, np.int32), np.zeros(count, np.int32)
        order: list[int] = []
        waiting: list[tuple[int, bool]] = [(0, False)]
        while waiting:
            node, left_it = waiting.pop()
            if left_it:
                stop[node] = len(order)
                continue
            start[node] = len(order)
            waiting.append((node, True))
            own = self.members[node]
            if own is not None:
                order.append(int(own[0]))
            else:
                waiting += [(self.child[node] + 1, False), (self.child[node], False)]
        child, extent = np.array(self.child, np.int32), np.array(self.extent, np.float32)
        tree = CellTree(start, stop, child, extent, np.ones(len(order), np.float32))
        return np.array(order, np.int32), tree


class CellFinder:
    """The walk on the device. radius: float32 [g], of each cell's disk (2010, section 5.1)."""

    def __init__(self, tree: CellTree, planes: Planes, radius: Float32) -> None:
        self._axis = _array(mi.UInt32, planes.axis)
        self._cut = _array(mi.Float, planes.cut)
        # A leaf's own cell stands where its children would
        leaf = tree.child < 0
        self._child = _array(mi.UInt32, np.where(leaf, tree.start, tree.child))
        self._leaf = _array(mi.UInt32, leaf.astype(np.uint32))
        self._first = _array(mi.UInt32, planes.first)
        self._scale = _array(mi.Float, planes.scale)
        self._radius = _array(mi.Float, radius)

    def find(self, obj: Any, p: Any, n: Any, active: Any) -> Any:
        """The cell of points of an object: mi.UInt32."""
        scale = dr.gather(mi.Float, self._scale, obj, active)
        m = n * scale

        def body(node: Any, going: Any) -> tuple[Any, Any]:
            axis = dr.gather(mi.UInt32, self._axis, node, going)
            cut = dr.gather(mi.Float, self._cut, node, going)
            value = dr.select(axis == 0, p.x, dr.select(axis == 1, p.y, p.z))
            turned = dr.select(axis == 3, m.x, dr.select(axis == 4, m.y, m.z))
            value = dr.select(axis < 3, value, turned)
            child = dr.gather(mi.UInt32, self._child, node, going)
            node = child + dr.select(value >= cut, mi.UInt32(1), 0)
            leaf = dr.gather(mi.UInt32, self._leaf, node, going)
            return node, going & (leaf == 0)

        node = dr.gather(mi.UInt32, self._first, obj, active)
        going = active & (dr.gather(mi.UInt32, self._leaf, node, active) == 0)
        node, _ = dr.while_loop(
            (node, going), lambda node, going: going, body, label="cell of a point"
        )
        return dr.gather(mi.UInt32, self._child, node, active)

    def find_blurred(self, obj: Any, p: Any, n: Any, u: Any, active: Any) -> Any:
        """The cell of a point moved within the disk of its own one, u uniform in [0, 1)²: on
        the mean over many, radiance that is smooth from cell to cell."""
        own = self.find(obj, p, n, active)
        radius = dr.gather(mi.Float, self._radius, own, active)
        disk = mi.warp.square_to_uniform_disk_concentric(u)
        frame = mi.Frame3f(n)
        moved = p + radius * (disk.x * frame.s + disk.y * frame.t)
        return self.find(obj, moved, n, active)


def _array(kind: Any, values: AnyArray) -> Any:
    array = kind(np.ascontiguousarray(values).ravel())
    dr.make_opaque(array)
    return array
