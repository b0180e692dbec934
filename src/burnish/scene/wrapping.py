"""What a scene puts round a BSDF and edits leave alone: masks, bent normals, both faces.

Mitsuba's `mask`, `bumpmap`, `normalmap` and `twosided` hold one BSDF and change where, or
in which frame, it reflects. The material inside is edited as if they were not there; they
are put round it again for the path tracer and for export.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi

from burnish.scene.reader import Description, Fixed

BENDS = ("bumpmap", "normalmap")
"""Plugins that bend the shading normal."""


@dataclass(frozen=True)
class Wrapping:
    """Plugins round a BSDF, outermost first, each its dictionary without what it holds."""

    plugins: tuple[Description, ...] = ()

    @property
    def two_sided(self) -> bool:
        """Whether both faces reflect."""
        return any(plugin["type"] == "twosided" for plugin in self.plugins)

    @property
    def is_plain(self) -> bool:
        """Whether nothing but `twosided` is there."""
        return all(plugin["type"] == "twosided" for plugin in self.plugins)

    def around(self, inner: Any) -> Any:
        """The dictionary of the plugins round a BSDF (its dictionary, or mi.BSDF)."""
        for plugin in reversed(self.plugins):
            inner = {**plugin, "bsdf": inner}
        return inner

    def opacity(self) -> Any:
        """The texture of the mask (mi.Texture, its first channel counts), or None."""
        for plugin in self.plugins:
            if plugin["type"] == "mask":
                value = plugin.get("opacity", 0.5)
                constant = {"type": "uniform", "value": value}
                return mi.load_dict(dict(value) if isinstance(value, Mapping) else constant)
        return None

    def bend(self, two_sided: bool) -> Bend | None:
        """How it bends the shading normal. two_sided: whether the whole BSDF is."""
        outside = False
        for plugin in self.plugins:
            outside |= plugin["type"] == "twosided"
            if plugin["type"] in BENDS:
                return Bend.of(plugin, two_sided and not outside)
        return None


def unwrap(description: Description) -> tuple[Wrapping, Description]:
    """What is round a BSDF, and the BSDF inside. Raises Fixed."""
    plugins: list[Description] = []
    while description["type"] in ("mask", "twosided", *BENDS):
        kind = description["type"]
        nested = {name: value for name, value in description.items() if _is_bsdf(value)}
        if len(nested) != 1:
            what = "its two faces have different BSDFs" if kind == "twosided" else f"its '{kind}'"
            raise Fixed(what if kind == "twosided" else f"{what} does not hold one BSDF")
        (name,) = nested
        plugins.append({key: value for key, value in description.items() if key != name})
        description = nested[name]
    kinds = [plugin["type"] for plugin in plugins]
    if "mask" in kinds[1:]:
        raise Fixed("its 'mask' lies inside another plugin; put it outermost")
    for group in (("twosided",), BENDS):
        if sum(kind in group for kind in kinds) > 1:
            raise Fixed(f"it has more than one {' or '.join(group)}")
    return Wrapping(tuple(plugins)), description


def _is_bsdf(value: Any) -> bool:
    """Whether a property of a description is the description of a BSDF."""
    return isinstance(value, Mapping) and value["type"] not in _TEXTURES


_TEXTURES = (
    *("bitmap", "checkerboard", "mesh_attribute", "volume", "rgb", "srgb", "spectrum", "uniform"),
    *("regular", "irregular", "blackbody", "rawconstant", "d65"),
)


@dataclass(frozen=True)
class Bend:
    """A bump or normal map: a frame of its own at each point, relative to the shading frame.

    texture: mi.Texture. scale: of a bump map's height; None for a normal map. flips: turn a
    normal that faces away from the viewer. shadows: weigh what a bent surface reflects by the
    share of it that its own slopes leave lit (Estevez et al. 2019).
    two_sided_inside: the BSDF within, not the bent surface, is the same on both faces.
    """

    texture: Any
    scale: float | None
    flips: bool = True
    shadows: bool = True
    two_sided_inside: bool = False

    @staticmethod
    def of(plugin: Description, two_sided_inside: bool) -> Bend:
        """The bend of a `bumpmap` or `normalmap` plugin, for the variant in use."""
        bump = plugin["type"] == "bumpmap"
        texture = (
            next(value for value in plugin.values() if isinstance(value, Mapping))
            if bump
            else plugin["normalmap"]
        )
        return Bend(
            mi.load_dict(dict(texture)),
            float(plugin.get("scale", 1.0)) if bump else None,
            bool(plugin.get("flip_invalid_normals", True)),
            bool(plugin.get("use_shadowing_function", True)),
            two_sided_inside,
        )

    def normal(self, si: Any, wi: Any, active: Any) -> Any:
        """The bent normal in the shading frame, where the viewer is at `wi`: mi.Vector3f."""
        if self.scale is None:
            n = dr.fma(mi.Vector3f(self.texture.eval_3(si, active)), 2, -1)
        else:
            slope = self.scale * self.texture.eval_1_grad(si, active)
            up = mi.Vector3f(si.sh_frame.n)
            along = [
                dr.fma(up, part - dr.dot(up, tangent), tangent)
                for part, tangent in ((slope.x, si.dp_du), (slope.y, si.dp_dv))
            ]
            n = dr.normalize(dr.cross(*along))
            n = si.to_local(dr.select(dr.dot(si.n, n) < 0, -n, n))
        if self.flips:
            away = wi.z * dr.dot(wi, n) <= 0
            n = dr.select(away, mi.Vector3f(-n.x, -n.y, n.z), n)
        return dr.normalize(n)
