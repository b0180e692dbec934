"""Bake a room with its lights told apart, mix them, edit under the mix, and ask the truth.

    python examples/light_mix.py docs/lights.png

writes the picture of docs/lights.md: the room as it is, its sun alone, a night in which the
sky is blue and dim, the same with another floor, and that path traced.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import burnish
from burnish.app.pictures import write_picture

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("picture", type=Path, help="the .png or .exr to write")
parser.add_argument("--width", type=int, default=256, help="pixels of each picture's width")
parser.add_argument("--spp", type=int, default=1024, help="samples per pixel")
options = parser.parse_args()

# Trace the light of the sun and of the skies by themselves
size = options.width, options.width * 3 // 4
scene = burnish.load("interior", ["floor", "walls"], resolution=size)
bundle = burnish.bake(
    scene, series=(16, 1, 1, 1), light_groups=("sun", "skies=sky+side-sky"), spp=options.spp
)

# Mix them, with no ray traced
session = burnish.edit(bundle)
pictures = [session.frame()]
session.set("light:sun.solo", True)
pictures.append(session.frame())
session.undo()
session.set("light:sun.on", False)
session.set("light:skies.intensity", 0.5)
session.set("light:skies.tint", (0.45, 0.6, 1.0))
pictures.append(session.frame())

# Materials stay as editable as they were
session.set("floor.diffuse.color", (0.5, 0.05, 0.02))
pictures.append(session.frame())
bounces = bundle.basis.bounces
pictures.append(burnish.path_trace(scene, session.materials, spp=options.spp, bounces=bounces))

gap = np.ones((size[1], max(options.width // 40, 1), 3), np.float32)
write_picture(options.picture, np.hstack([x for image in pictures for x in (image, gap)][:-1]))
