"""Lights of a bake of direct light: odd lamps, and the points they are looked at from."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np

from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.precompute.direct.lights import LightTables, _caps, find_lights
from burnish.precompute.direct.points import MOST_POINTS, _wanted
from burnish.precompute.plan import basis_for
from tests.reference.worlds import camera, lambert, plane, world

PLY = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 3
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
2 0 0
3 0 1 2
3 0 1 3
3 1 1 2
"""
"""A triangle with a corner at the origin and two faces of no area."""


def test_a_lamp_at_the_origin_with_faces_of_no_area(tmp_path: Path) -> None:
    (tmp_path / "lamp.ply").write_text(PLY)
    scene = world(
        {
            "floor": plane(z=-1.0, size=2.0),
            "lamp": {
                "type": "ply",
                "filename": str(tmp_path / "lamp.ply"),
                "emitter": {"type": "area", "radiance": 2.0},
            },
            "view": camera((0.0, -5.0, 2.0), (0.0, 0.0, 0.0)),
        },
        {"floor": lambert((0.5, 0.5, 0.5))},
        resolution=(4, 4),
    )
    lights = find_lights(scene, basis_for(scene, series=(8,)), 100)
    LightTables(lights)
    assert np.isfinite(_caps(lights)).all()
    a, b, c = np.moveaxis(lights.corners, 1, 0)
    normal = np.cross(b - a, c - a)
    # All of the one face, lit on the side of its normal
    np.testing.assert_allclose(normal.sum(axis=0), [0, 0, 1], atol=1e-6)
    assert lights.local.all()
    assert (lights.group == 0).all()


def test_no_more_points_look_elsewhere_than_there_are() -> None:
    layers = [SimpleNamespace(model=BlinnPhong())]
    item = SimpleNamespace(material=SimpleNamespace(layers=layers))
    tracer = SimpleNamespace(basis=SimpleNamespace(objects=[item]))
    spread = np.array([0.0, 0.01, 0.05])
    for points in (1, 4, 32, MOST_POINTS, 100):
        count, far, _ = _wanted(tracer, np.zeros(3, np.int32), spread, points)  # type: ignore[arg-type]
        assert (far <= count).all()
        assert (count <= MOST_POINTS).all()
