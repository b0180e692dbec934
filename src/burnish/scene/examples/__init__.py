"""The scenes that come along; their geometry, textures and lights are made by code."""

from __future__ import annotations

from burnish.scene.examples.catalogue import EXAMPLES, Example, Finish, find

__all__ = ["EXAMPLES", "Example", "Finish", "find"]
