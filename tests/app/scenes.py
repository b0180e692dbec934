"""Small scene files, whole and broken."""

from __future__ import annotations

CAMERA = '<sensor type="perspective"><film type="hdrfilm"/></sensor>'
LIGHT = '<emitter type="constant"/>'
BALL = '<shape type="sphere" id="ball"><bsdf type="diffuse"/></shape>'
GLASS = '<shape type="sphere" id="ball"><bsdf type="dielectric"/></shape>'
MESH = '<shape type="obj" id="mesh"><string name="filename" value="broken.obj"/></shape>'

BROKEN_MESH = "v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n"


def scene(*parts: str) -> str:
    """A Mitsuba 3 scene file of these parts."""
    return '<scene version="3.0.0">' + "\n".join(parts) + "</scene>"
