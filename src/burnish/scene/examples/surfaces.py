"""Mitsuba's dictionaries of what the scenes are made of."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mitsuba as mi

from burnish.core.types import RGB
from burnish.scene.examples.geometry import Mesh, rgb


def solid(mesh: Mesh, path: Path, bsdf: Mapping[str, Any]) -> dict[str, Any]:
    """A mesh, written to a file, with its BSDF."""
    return {"type": "ply", "filename": mesh.write(path), "bsdf": dict(bsdf)}


def matte(colour: RGB | Mapping[str, Any]) -> dict[str, Any]:
    """Diffuse: a linear colour or a texture."""
    return {"type": "diffuse", "reflectance": _coloured(colour)}


def glossy(alpha: float, colour: RGB | Mapping[str, Any]) -> dict[str, Any]:
    """Diffuse under a coat of roughness alpha: a linear colour or a texture."""
    return {
        "type": "roughplastic",
        "distribution": "ggx",
        "alpha": alpha,
        "diffuse_reflectance": _coloured(colour),
    }


def metal(material: str, alpha: float) -> dict[str, Any]:
    """One of Mitsuba's metals."""
    return {"type": "roughconductor", "distribution": "ggx", "material": material, "alpha": alpha}


def upholstery(colour: RGB, roughness: float, sheen: float) -> dict[str, Any]:
    """Cloth with the bright edges of its fibres."""
    return {
        "type": "principled",
        "base_color": rgb(*colour),
        "roughness": roughness,
        "specular": 0.35,
        "sheen": sheen,
        "sheen_tint": 0.9,
    }


def both_faces(bsdf: Mapping[str, Any]) -> dict[str, Any]:
    """The BSDF on the inside and the outside of a thin surface."""
    return {"type": "twosided", "inner": dict(bsdf)}


def picture(filename: str, across: float = 1.0, along: float = 1.0, turn: float = 0.0) -> Any:
    """A texture from a picture, repeated so many times, turned by so many degrees."""
    to_uv = mi.ScalarTransform4f().rotate([0, 0, 1], turn).scale([across, along, 1.0])
    return {"type": "bitmap", "filename": filename, "to_uv": to_uv}


def _coloured(colour: RGB | Mapping[str, Any]) -> dict[str, Any]:
    return dict(colour) if isinstance(colour, Mapping) else rgb(*colour)
