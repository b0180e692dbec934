"""Bake the Cornell box, edit it, and put before, after and the truth side by side.

    python examples/before_and_after.py docs/edit.png

writes the picture of the README (about three minutes on two cores).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import burnish
from burnish.app.pictures import write_picture

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("picture", type=Path, help="the .png or .exr to write")
parser.add_argument("--side", type=int, default=320, help="pixels of a side of each picture")
parser.add_argument("--spp", type=int, default=1024, help="samples per pixel")
options = parser.parse_args()

# Trace the light once, with every material left open
scene = burnish.load("cornell-box", resolution=(options.side, options.side))
bundle = burnish.bake(scene, series=(64, 1, 1, 1), spp=options.spp)

# Edit any of them, at once
session = burnish.edit(bundle)
before = session.frame()
session.set("large-box.diffuse.color", (0.75, 0.55, 0.06))
session.set("left.diffuse.color", "#2a5cb8")
session.set("back.diffuse.color", 0.3)
session.set("back.specular.color", 0.5)
session.set("back.specular.exponent", 400)
session.set("back.specular.weight", 1)
after = session.frame()

# Ask a path tracer that is given the same materials
truth = burnish.path_trace(scene, session.materials, spp=options.spp, bounces=bundle.basis.bounces)

gap = np.ones((options.side, max(options.side // 40, 1), 3), np.float32)
write_picture(options.picture, np.hstack([before, gap, after, gap, truth]))
