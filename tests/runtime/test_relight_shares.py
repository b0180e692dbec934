"""What of an albedo is glossy, where a picture stands in place of a colour."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from burnish.core.types import Value
from burnish.materials.images import ImageMap, Texels
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.models.cook_torrance import CookTorrance
from burnish.materials.models.lambert import Lambert
from burnish.materials.painting.canvas import Canvas
from burnish.materials.painting.varied import VariedObject
from burnish.runtime.relight.light import layer_albedos, matte_shares
from burnish.transport.basis import Basis, EditableObject

COLOUR = (0.2, 0.1, 0.05)


def coated() -> Material:
    """As `set_map` leaves it: a colour white, its picture apart."""
    white: dict[str, Value] = {"color": (1.0, 1.0, 1.0)}
    gloss: dict[str, Value] = {"color": (1.0, 1.0, 1.0), "roughness": 0.3}
    layers = (
        Layer.starting_at("diffuse", Lambert(), white),
        Layer.starting_at("specular", CookTorrance("ggx"), gloss, bins=16),
    )
    state = MaterialState({"diffuse": LayerState(white), "specular": LayerState(gloss)})
    return Material(layers, state)


@pytest.mark.parametrize("layer", ["diffuse", "specular"])
def test_a_picture_of_one_colour_leaves_the_shares_of_that_colour(layer: str) -> None:
    material = coated()
    basis = Basis((EditableObject("a", material),), (16, 1, 1))
    image = ImageMap(Texels(np.full((2, 2, 3), COLOUR, np.float32)))
    mapped = replace(material.initial, images={(layer, "color"): image})
    nothing = np.zeros((3, 3), np.float32)
    uv = np.random.default_rng(1).random((3, 4, 2)).astype(np.float32)
    mean = VariedObject(material, Canvas(nothing, nothing), np.ones(3), uv).at(mapped).mean
    own = material.initial.layers[layer]
    values = {**own.values, "color": COLOUR}
    plain = MaterialState(
        {**material.initial.layers, layer: replace(own, values=values)}, conserve=mapped.conserve
    )
    # The picture is of single precision
    np.testing.assert_allclose(
        layer_albedos(material, mean), layer_albedos(material, plain), rtol=1e-5
    )
    found, expected = (matte_shares(basis, {"a": state}) for state in (mean, plain))
    np.testing.assert_allclose(found, expected, rtol=1e-5)
    assert found.min() >= 0
    assert found.max() <= 1
    np.testing.assert_allclose(layer_albedos(material, mean).sum(axis=0), mean.albedos[0])
