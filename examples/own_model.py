"""A reflectance model of one's own: a sheen, baked, edited and held against the path tracer.

    python examples/own_model.py own-model.png

writes the sphere before and after an edit, and path traced (docs/own-model.md explains it).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import burnish
from burnish.app.pictures import write_picture
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.parameter import Parameter
from burnish.materials.user import user_model


def sheen(xp, gamma, values):
    """Fibres that glow where the half vector leans away from the normal."""
    lobe = xp.power(xp.sin(gamma), 1 / values["width"])
    return [colour * lobe for colour in values["color"]]


def between_fibres(xp, wi, wo, frozen):
    """How fibres hide each other: a soft masking that stays finite at grazing angles."""
    return 1 / (4 * xp.pi * (wi.z + wo.z - wi.z * wo.z))


SHEEN = user_model(
    "own-sheen",
    curve=sheen,
    quotient=between_fibres,
    coordinate="theta_h",
    parameters=(
        Parameter("color", (0.7, 0.2, 0.3), kind="colour"),
        Parameter("width", 0.4, 0.05, 1.0),
    ),
)

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("picture", type=Path, help="the .png or .exr to write")
    parser.add_argument("--side", type=int, default=320, help="height in pixels of each picture")
    parser.add_argument("--spp", type=int, default=512, help="samples per pixel")
    options = parser.parse_args()

    # One layer of the model, on the sphere of an example scene
    values = {"color": (0.7, 0.2, 0.3), "width": 0.4}
    layer = Layer.starting_at("sheen", SHEEN, values)
    material = Material((layer,), MaterialState({"sheen": LayerState(values)}))
    size = (options.side * 4 // 3, options.side)
    scene = burnish.load("sphere", materials={"sphere": material}, resolution=size)

    # Baked once, edited at once
    bundle = burnish.bake(scene, editable=["sphere"], series=(64, 1), spp=options.spp)
    session = burnish.edit(bundle)
    before = session.frame()
    session.set("sphere.sheen.color", (0.1, 0.4, 0.9))
    session.set("sphere.sheen.width", 0.15)
    after = session.frame()
    truth = burnish.path_trace(scene, session.materials, spp=options.spp, bounces=2)
    write_picture(options.picture, np.hstack([before, after, truth]))
