"""Path-trace the papers' scenes and put them on one sheet.

    python examples/gallery.py docs/scenes.png

writes the picture of docs/scenes.md (about five minutes on two cores).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import burnish
from burnish.app.pictures import write_picture
from burnish.core.types import Float32
from burnish.precompute.denoise import Denoiser, available

ROWS = (("vase", "room", "earrings"), ("still-life", "interior", "tableau"))

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("picture", type=Path, help="the .png or .exr to write")
parser.add_argument("--height", type=int, default=288, help="pixels of a picture's height")
parser.add_argument("--spp", type=int, default=256, help="samples per pixel")
parser.add_argument("--only", help="one scene, by itself")
options = parser.parse_args()


def portrait(name: str) -> Float32:
    """A scene as it comes, without its noise where Open Image Denoise is installed."""
    view = burnish.load(name).view()
    width = round(options.height * view.width / view.height)
    scene = burnish.load(name, resolution=(width, options.height))
    picture = burnish.path_trace(scene, spp=options.spp, bounces=8)
    return Denoiser.of(scene, scene.view()).clean(picture) if available() else picture


rows = ((options.only,),) if options.only else ROWS
write_picture(
    options.picture, np.vstack([np.hstack([portrait(name) for name in row]) for row in rows])
)
