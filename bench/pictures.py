"""Pictures of accumulators, with and without compression."""

from __future__ import annotations

import numpy as np

from burnish.core.types import Float32
from burnish.precompute.accumulate import Accumulator
from burnish.runtime.freeze import freeze
from burnish.runtime.renderer import Renderer
from burnish.transport.basis import Basis, State
from burnish.transport.block import Tile
from burnish.transport.pack import TiledBlocks


def picture_of(accumulator: Accumulator, tile: Tile, state: State) -> Float32:
    """A tile's light that is not directly seen emission: float32 [height, width, 3]."""
    view = accumulator.tracer.view
    source = TiledBlocks.of(accumulator.tracer.basis, view.width, view.height, [tile])
    image = Renderer(freeze(source, (), state)).image(state) - source.emission
    return image[tile.y : tile.y + tile.height, tile.x : tile.x + tile.width]


def glossy_state(basis: Basis, start: State, exponent: float) -> State:
    """Every object half as bright, with a Blinn-Phong lobe of that exponent on top."""
    result = dict(start)
    for item in basis.objects:
        layers = dict(start[item.id].layers)
        for name, layer in layers.items():
            values = dict(layer.values)
            if "exponent" in values:
                values |= {"exponent": exponent, "color": (0.35, 0.35, 0.35)}
                layers[name] = type(layer)(values, weight=1.0)
            else:
                colour = tuple(float(0.5 * c) for c in np.broadcast_to(values["color"], 3))
                layers[name] = type(layer)({**values, "color": colour})
        result[item.id] = type(start[item.id])(layers)
    return result
