"""A triangle's overlap with the bins of every coordinate, against dense integration."""

from __future__ import annotations

import numpy as np
import pytest

from burnish.core.types import Float64
from burnish.materials.model import Model
from burnish.materials.models.ashikhmin_shirley import (
    AshikhminShirleyRatio,
    AshikhminShirleyWidth,
)
from burnish.materials.models.blinn_phong import BlinnPhong
from burnish.materials.models.fresnel_curve import FresnelCurve
from burnish.materials.models.light_view import LightView
from burnish.materials.models.phong import Phong
from burnish.materials.models.schlick import Schlick
from burnish.materials.models.ward import WardRatio, WardWidth
from tests.precompute.direct.triangles import Plane, around, dense_shares

WAYS = np.array([[0.35, -0.2, 0.9], [-0.6, 0.5, 0.5]])
WAYS /= np.linalg.norm(WAYS, axis=1, keepdims=True)

COORDINATES: dict[str, Model] = {
    "theta_h": BlinnPhong(),
    "theta_d": FresnelCurve(),
    "theta_r": Phong(),
    "theta_in": LightView(),
    "gamma_ratio": AshikhminShirleyRatio(),
    "gamma_width": AshikhminShirleyWidth(),
    "ward_ratio": WardRatio(),
    "ward_width": WardWidth(),
    "schlick": Schlick(),
}
SMALLEST = 2e-6
DENSE = 8
BINS = 128
SLACK = 2e-3
"""A line through 4^DENSE pieces meets about 2^DENSE of them, half of each on average."""


@pytest.fixture(scope="module", params=COORDINATES)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def pole(name: str, wo: Float64) -> Float64:
    """Where γ is least: the normal, the view itself, or its mirror image."""
    if name == "theta_in":
        return np.array([0.0, 0.0, 1.0])
    if name == "theta_d":
        return wo
    return wo * [-1, -1, 1]


def test_overlap_with_every_bin(name: str) -> None:
    """A triangle away from the poles, one around each pole, and a small one beside it.

    A piece that is not split is bent by half a bin at most. So the share below an edge lies
    between the dense one's half a bin before and half a bin after it, but for what the dense
    count loses at an edge itself, whose pieces lie in one bin each.
    """
    own = Plane(COORDINATES[name], BINS)
    for number, wo in enumerate(WAYS):
        at = pole(name, wo)
        beside = at + np.array([0.06, -0.05, 0.03])
        triangles = (around(np.array([0.5, 0.6, 0.62]), 0.05), around(at, 0.08))
        for triangle in (*triangles, around(beside, 0.02, 1.0)):
            found = own.shares(triangle, WAYS[number : number + 1], SMALLEST)[0]
            assert found.sum() == pytest.approx(1, abs=2e-5)
            assert found.min() > -1e-6
            wanted = dense_shares(own.layer, triangle, wo, DENSE)
            below, ours = np.append(0, np.cumsum(wanted)), np.append(0, np.cumsum(found))
            half = 0.5 * np.append(wanted, 0), 0.5 * np.append(0, wanted)
            assert (ours <= below + half[0] + SLACK).all()
            assert (ours >= below - half[1] - SLACK).all()
