"""Fresnel curves that an expansion cannot hold: the directional albedo is right all the same."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from burnish.materials.coefficients import directional_albedo, outgoing
from burnish.materials.layer import Layer, LayerState
from burnish.materials.model import Model
from burnish.materials.models.cook_torrance import (
    CookTorrance,
    CookTorranceConductor,
    CookTorranceDielectric,
)

GOLD: dict[str, Any] = {
    "color": (1.0, 1.0, 1.0),
    "roughness": 0.12,
    "eta": (0.143, 0.375, 1.442),
    "k": (3.983, 2.386, 1.603),
}
GLASS: dict[str, Any] = {"color": (1.0, 1.0, 1.0), "roughness": 0.15, "ior": 1.5}


@pytest.mark.parametrize("roughness", [0.05, 0.12, 0.5])
@pytest.mark.parametrize(
    ("model", "start", "edit"),
    [
        (CookTorranceConductor("ggx"), GOLD, {"k": (0.0, 0.0, 0.0)}),
        (CookTorranceConductor("beckmann"), GOLD, {"k": (0.0, 0.0, 0.0)}),
        (CookTorranceConductor("ggx"), GOLD, {"eta": (5.0, 5.0, 5.0)}),
        (CookTorranceConductor("ggx"), GOLD, {"k": (10.0, 10.0, 10.0)}),
        (CookTorranceDielectric("ggx"), GLASS, {"ior": 1.2}),
        (CookTorranceDielectric("beckmann"), GLASS, {"ior": 3.0}),
    ],
)
def test_an_edit_reflects_what_a_layer_that_starts_there_does(
    model: Model, start: dict[str, Any], edit: dict[str, Any], roughness: float
) -> None:
    """Within 4 %: 2.5 % is the expansion of masking, the rest a step at the critical angle."""
    values = {**start, "roughness": roughness, **edit}
    layer = Layer.starting_at("specular", model, start)
    fresh = Layer.starting_at("specular", model, values)
    cos, found = directional_albedo(layer, LayerState(values))
    _, exact = directional_albedo(fresh, LayerState(values))
    usual = cos > 0.17
    np.testing.assert_allclose(found[usual], exact[usual], rtol=0.04)


def test_nothing_is_mended_where_the_expansion_is_exact() -> None:
    cos = np.linspace(0.05, 1.0, 20)
    for model, start in (
        (CookTorranceConductor("ggx"), GOLD),
        (CookTorranceDielectric("ggx"), GLASS),
        (CookTorrance("ggx"), {"color": (0.9, 0.1, 0.4), "roughness": 0.2}),
    ):
        layer = Layer.starting_at("specular", model, start)
        assert outgoing(layer, LayerState(start), cos, delta=False) is None
