"""Move the lights of a scene with no bake, edit materials meanwhile, and ask the truth.

    python examples/moving_lights.py docs/moving-lights.png

writes a picture of docs/lights.md: a ring as it is; its lamp moved to the other side, nearer and
smaller; the studio around it turned; the same with a rougher ring; and that path traced.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import burnish
from burnish.app.live import settle
from burnish.app.pictures import write_picture


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("picture", type=Path, help="the .png or .exr to write")
    parser.add_argument("--width", type=int, default=192, help="pixels of each picture's width")
    parser.add_argument("--spp", type=int, default=2048, help="samples per pixel")
    options = parser.parse_args()

    scene = burnish.load("ring", resolution=(options.width, options.width * 3 // 4))
    steps: list[dict[str, object]] = [
        {},
        # Places in the scene's units; a lamp is aimed by the way it faces
        {
            "light:lamp.position": (-3.0, -2.0, 2.5),
            "light:lamp.direction": (3.0, 2.0, -2.5),
            "light:lamp.size": 0.6,
        },
        {"light:studio.rotation": 120.0, "light:studio.exposure": 0.5},
        {"ring.specular.roughness": 0.35},
    ]
    pictures = []
    with burnish.edit(scene) as live:
        for step in steps:
            for path, value in step.items():
                live.set(path, value)
            # A live picture is there at once, and ever cleaner
            settle(live, None, options.spp, lambda fraction, text: None)
            pictures.append(live.frame())
        pictures.append(burnish.path_trace(scene, live.materials, spp=options.spp, bounces=4))

    gap = np.ones((pictures[0].shape[0], max(options.width // 40, 1), 3), np.float32)
    write_picture(options.picture, np.hstack([x for image in pictures for x in (image, gap)][:-1]))


# The process that traces begins by reading this file
if __name__ == "__main__":
    main()
