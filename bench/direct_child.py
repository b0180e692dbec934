"""Bake direct light in a process of its own: `python -m bench.direct_child SCENE W H N OUT`."""

from __future__ import annotations

import json
import sys
import time

import burnish


def main() -> None:
    """Print one line of JSON: seconds, and bytes on disk."""
    scene, width, height, triangles, path = sys.argv[1:]
    loaded = burnish.load(scene, resolution=(int(width), int(height)))
    start = time.perf_counter()
    bundle = burnish.bake(loaded, path, mode="direct", triangles=int(triangles), spp=64, seed=1)
    print(json.dumps({"seconds": time.perf_counter() - start, "bytes": bundle.size}))


if __name__ == "__main__":
    main()
