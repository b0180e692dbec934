"""Triangles over the boxes of two curves: shares are products of both sides' and sum to one."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.materials.layer import Layer
from burnish.materials.models.cook_torrance_curves import CookTorranceCurves
from burnish.scene.device import activate

FINE = 400
"""Cells along a side of a triangle, to which bins are counted; an edge of a bin passes through no
more than 2 FINE of all FINE², and a bin has two."""
METAL: dict[str, Any] = {
    "color": (1.0, 1.0, 1.0),
    "roughness": 0.2,
    "eta": (0.2, 0.9, 1.1),
    "k": (3.9, 2.5, 2.1),
}


def test_a_triangle_spreads_over_pairs_of_bins() -> None:
    activate()
    from burnish.precompute.direct.overlap import Bands, Extent

    layer = Layer.starting_at("metal", CookTorranceCurves(bins=5, bins2=4), METAL)
    bands, model = Bands(layer), layer.model
    assert isinstance(model, CookTorranceCurves)
    rng = np.random.default_rng(1)
    count = 60
    corners = rng.uniform(0.0, 1.0, (2, 3, count))
    # Some of them narrow, within a bin
    corners[:, :, ::4] = corners[:, :1, ::4] + 1e-3 * corners[:, :, ::4]
    corners = np.clip(corners, 0.0, 1.0)
    found = dr.zeros(mi.Float, count * layer.bins)
    lane = dr.arange(mi.UInt32, count) * layer.bins

    def deposit(box: Any, share: Any, active: Any) -> None:
        dr.scatter_add(found, share, lane + box, active)

    extents = [Extent.of(*(mi.Float(c.astype(np.float32)) for c in side)) for side in corners]
    bands.spread(extents, deposit, dr.full(mi.Bool, True, count))
    boxes = np.array(found).reshape(count, 5, 4)
    # Single precision squares over differences of neighbouring corners
    np.testing.assert_allclose(boxes.sum(axis=(1, 2)), 1.0, atol=1e-5)
    assert boxes.min() > -1e-5
    # What lies along each curve is what a triangle of that curve alone has there
    for side, axis in enumerate(model.axes):
        wanted = np.stack([_shares(corners[side, :, n], axis.edges) for n in range(count)])
        np.testing.assert_allclose(boxes.sum(axis=2 - side), wanted, atol=4 / FINE)
    product = boxes.sum(axis=2)[:, :, None] * boxes.sum(axis=1)[:, None, :]
    np.testing.assert_allclose(boxes, product, atol=1e-5)


def _shares(corners: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """The share of a flat triangle between values of what is linear over it, by sampling it
    evenly."""
    n = FINE
    u, v = (np.mgrid[:n, :n] + 0.5) / n
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    value = corners[0] + u * (corners[1] - corners[0]) + v * (corners[2] - corners[0])
    return np.histogram(value, np.append(edges[:-1], 1.0 + 1e-9))[0] / n**2
