"""Find the materials of a picture: render one with secret materials, and fit them back.

    python examples/match_a_picture.py match.png

writes the target, what the scene looked like before, the fit, and a heat map of what remains
(about two minutes on two cores, nearly all of them for tracing).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import burnish
from burnish.app.pictures import write_picture

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("picture", type=Path, help="the .png or .exr to write")
parser.add_argument("--side", type=int, default=256, help="pixels of a side of each picture")
parser.add_argument("--spp", type=int, default=512, help="samples per pixel")
options = parser.parse_args()

# Trace the light once, with two materials left open
scene = burnish.load("cornell-box", resolution=(options.side, options.side))
bundle = burnish.bake(scene, editable=["back", "large-box"], spp=options.spp)

# A picture by a path tracer, of materials that the fit is not told
session = burnish.edit(bundle)
before = session.frame()
session.set("large-box.diffuse.color", (0.6, 0.25, 0.08))
session.set("back.diffuse.color", (0.1, 0.2, 0.35))
session.set("back.specular.color", 0.5)
session.set("back.specular.exponent", 150)
session.set("back.specular.weight", 1)
target = burnish.path_trace(scene, session.materials, spp=options.spp, bounces=4)
session.reset()

# Any gloss at all is a guess to begin with; the fit finds which
session.set("back.specular.weight", 1)
found = burnish.fit(
    session,
    target,
    parameters=[
        "large-box.diffuse.color",
        "back.diffuse.color",
        "back.specular.color",
        "back.specular.exponent",
    ],
)
print(found.report())
for path, value in found.values.items():
    print(path, value)

gap = np.ones((options.side, max(options.side // 40, 1), 3), np.float32)
after, heat = session.frame(), found.heat_map()
write_picture(options.picture, np.hstack([target, gap, before, gap, after, gap, heat]))
