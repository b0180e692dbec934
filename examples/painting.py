"""Paint the highlights of a sphere, in the nine steps of a sequence that Fraser (2015) proposed.

    python examples/painting.py painting.png

writes the nine pictures, three to a row (about a minute on two cores, nearly all of it for
tracing). In 2015 some of them were painted in Photoshop, because no material stood behind
them; here every one is a material under the scene's light.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import burnish
from burnish.app.pictures import write_picture
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.models.lambert import Lambert
from burnish.materials.models.ward import WardRatio, WardWidth

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("picture", type=Path, help="the .png or .exr to write")
parser.add_argument("--width", type=int, default=280, help="pixels across each picture")
parser.add_argument("--spp", type=int, default=256, help="samples per pixel")
options = parser.parse_args()
width, height = options.width, options.width * 3 // 4

# A matte base; a highlight whose width can be painted; one that can be stretched
grey = (0.08, 0.08, 0.08)
starts = {
    "diffuse": (Lambert(), {"color": grey}),
    "specular": (WardWidth(), {"color": (0.1, 0.1, 0.1), "roughness": 0.4}),
    "streaks": (WardRatio(), {"color": (0.04, 0.04, 0.04), "ratio": 1.0, "roughness": 0.15}),
}
layers = []
states = {}
for name, (model, values) in starts.items():
    layers.append(Layer.starting_at(name, model, values, bins=96))
    states[name] = LayerState({item.name: values[item.name] for item in model.parameters})
material = Material(tuple(layers), MaterialState(states))

scene = burnish.load("sphere", resolution=(width, height), materials={"sphere": material})
bundle = burnish.bake(scene, editable=["sphere"], spp=options.spp)
session = burnish.edit(bundle)
session.select("sphere")
size = width / 9


def place(x: float, y: float) -> tuple[float, float]:
    """Pixels of a place on the picture, 0 to 1 both ways."""
    return x * width, y * height


def arc(start: float, stop: float, radius: float) -> list[tuple[float, float]]:
    """A way round the sphere's middle; angles in turns, 0 to the right, clockwise."""
    turns = np.linspace(start, stop, 24)
    x, y = np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)
    return [place(0.5 + radius * u * 0.75, 0.47 + radius * v) for u, v in zip(x, y, strict=True)]


steps = [session.frame()]

# 2. Sharpen everything
session.paint_whole("sharpen", amount=0.35)
steps.append(session.frame())

# 3. Sharpen some areas more
session.paint("sharpen", arc(0.45, 0.75, 0.2), size=1.2 * size, amount=0.4)
steps.append(session.frame())

# 4. Take the highlights in the middle down
for layer in ("specular", "streaks"):
    session.paint("specular-intensity", [place(0.5, 0.42)], size=1.3 * size, amount=0, layer=layer)
steps.append(session.frame())

# 5. Stretch highlights along a stroke
session.paint("specular-intensity", arc(0.85, 1.15, 0.22), size=size, amount=4, layer="streaks")
session.paint("stretch", arc(0.85, 1.15, 0.22), size=size, amount=0.5)
steps.append(session.frame())

# 6. Colour highlights
session.paint("specular-color", arc(0.45, 0.8, 0.22), size=1.3 * size, color="#c07818")
steps.append(session.frame())

# 7. One diffuse colour for all of it
session.paint_whole("diffuse-color", color="#1d4f80")
steps.append(session.frame())

# 8. Another in some areas
session.paint("diffuse-color", arc(0.1, 0.4, 0.26), size=size, color="#a02038")
steps.append(session.frame())

# 9. Less of all highlights
for layer in ("specular", "streaks"):
    session.paint_whole("specular-intensity", amount=0.5, layer=layer)
steps.append(session.frame())

print(*session.history[0], sep="\n")
gap = max(width // 60, 1)
side = np.ones((height, gap, 3), np.float32)
rows = [np.hstack([steps[k], side, steps[k + 1], side, steps[k + 2]]) for k in (0, 3, 6)]
across = np.ones((gap, rows[0].shape[1], 3), np.float32)
write_picture(options.picture, np.vstack([rows[0], across, rows[1], across, rows[2]]))
