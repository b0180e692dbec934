"""Mitsuba's `blendbsdf`: two materials side by side, each under a static weight map."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from burnish.materials.images.image import ImageMap, Place
from burnish.materials.layer import Layer, LayerState, Link, Material, MaterialState
from burnish.scene.reader import Description, Fixed
from burnish.scene.textures import Factor, product

if TYPE_CHECKING:
    from burnish.scene.adapters import Adapted

PREFIXES = ("first", "second")
"""What the names of the two materials' layers begin with."""


@dataclass(frozen=True)
class Blend:
    """The parts of a blend, and what became of them.

    weight: the share of the second material, a number or a texture.
    """

    material: Material
    maps: dict[str, Description]
    weight: Any
    parts: tuple[Adapted, Adapted]

    @property
    def two_sided(self) -> bool:
        """Whether its parts reflect on both faces."""
        return self.parts[0].two_sided

    def describe(self, state: MaterialState) -> Description | None:
        """Mitsuba's blendbsdf of a state, None where one of its two has no plugin."""
        if state.conserve:
            return None
        edited: dict[str, Any] = {}
        for prefix, part in zip(PREFIXES, self.parts, strict=True):
            assert part.describe is not None
            start = f"{prefix}_"
            own = {
                name.removeprefix(start): layer
                for name, layer in state.layers.items()
                if name.startswith(start)
            }
            images = {
                (layer.removeprefix(start), parameter): image
                for (layer, parameter), image in state.images.items()
                if layer.startswith(start)
            }
            edited[prefix] = part.describe(MaterialState(own, images=images))
            if edited[prefix] is None:
                return None
        if set(state.layers) != {layer.name for layer in self.material.layers}:
            return None
        return {"type": "blendbsdf", "weight": self.weight, **edited}


def blend(description: Description, adapt: Callable[[Description], Adapted]) -> Blend:
    """A `blendbsdf` as layers. Raises Fixed."""
    children = [
        value
        for name, value in description.items()
        if isinstance(value, Mapping) and name != "weight"
    ]
    if len(children) != 2:
        raise Fixed("its blend does not hold two BSDFs that can be read")
    first, second = (adapt(child) for child in children)
    for prefix, part in zip(PREFIXES, (first, second), strict=True):
        if part.material is None:
            raise Fixed(f"the {prefix} part of its blend cannot be edited: {part.reason}")
        if not part.wrapping.is_plain:
            raise Fixed(f"the {prefix} part of its blend has a mask or bent normals of its own")
    if first.two_sided != second.two_sided:
        raise Fixed("only one part of its blend is two-sided")
    weight = description.get("weight", 0.5)
    texture = weight if isinstance(weight, Mapping) else {"type": "uniform", "value": float(weight)}
    shares = (Factor(texture, -1.0, 1.0, single=True), Factor(texture, single=True))
    layers: list[Layer] = []
    links: list[Link] = []
    states: dict[str, LayerState] = {}
    maps: dict[str, Description] = {}
    images: dict[Place, ImageMap] = {}
    for prefix, part, share in zip(PREFIXES, (first, second), shares, strict=True):
        assert part.material is not None
        for layer in part.material.layers:
            group = f"{prefix}_{layer.group}" if layer.group else prefix
            name = f"{prefix}_{layer.name}"
            layers.append(replace(layer, name=name, group=group))
            states[name] = part.material.initial.layers[layer.name]
            own = [Factor(part.maps[layer.group])] if layer.group else []
            maps[group] = product([share, *own])
        images |= {
            (f"{prefix}_{layer}", parameter): image
            for (layer, parameter), image in part.material.initial.images.items()
        }
        links += [
            replace(
                link,
                layer=f"{prefix}_{link.layer}",
                source_layer=f"{prefix}_{link.source_layer}",
            )
            for link in part.material.links
        ]
    material = Material(tuple(layers), MaterialState(states, images=images), tuple(links))
    return Blend(material, maps, weight, (first, second))
