"""Numbers, colours and textures of a BSDF description, read from Mitsuba's own plugin."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mitsuba as mi
import numpy as np

from burnish.core.types import RGB
from burnish.materials.images.image import ImageMap, Place
from burnish.materials.layer import Material
from burnish.materials.models.optics import Distribution
from burnish.scene.images import described, image_of
from burnish.scene.textures import Factor, product

Description = Mapping[str, Any]
"""A Mitsuba dictionary, as for `mi.load_dict`."""


Read = tuple[Material, dict[str, Description]]
"""What a BSDF became: its material, and the texture that is the H of each group with one."""


class Fixed(Exception):
    """The BSDF cannot be edited; the message says why."""


class Reader:
    """The numbers and textures of one plugin."""

    def __init__(self, description: Description) -> None:
        self.description = description
        plugin = mi.load_dict(dict(description), optimize=False)
        self._values = mi.traverse(plugin)
        self._images: dict[str, ImageMap] = {}

    def is_textured(self, name: str) -> bool:
        """Whether a colour varies over the surface."""
        return f"{name}.value" not in self._values and any(
            key.startswith(f"{name}.")
            for key in self._values.keys()  # noqa: SIM118
        )

    def colour(self, name: str, default: float = 1.0) -> RGB:
        """A constant colour, linear RGB. Raises Fixed when it is textured."""
        if self.is_textured(name):
            raise Fixed(f"its {name} is textured; only colours may be")
        if f"{name}.value" not in self._values:
            return (default,) * 3
        value = np.asarray(self._values[f"{name}.value"], np.float64).ravel()
        r, g, b = (float(x) for x in (np.repeat(value, 3) if value.size == 1 else value))
        return (r, g, b)

    def scalar(self, name: str) -> float:
        """A constant number. Raises Fixed when it is textured."""
        if self.is_textured(name):
            raise Fixed(f"its {name} is textured; only colours may be")
        key = f"{name}.value" if f"{name}.value" in self._values else name
        return float(np.asarray(self._values[key]).ravel()[0])

    def has(self, name: str) -> bool:
        """Whether the plugin has a number of that name."""
        return name in self._values

    def distribution(self) -> Distribution:
        """The microfacet distribution; Mitsuba's default is Beckmann."""
        name = str(self.description.get("distribution", "beckmann")).lower()
        return "ggx" if name == "ggx" else "beckmann"

    def texture(self, name: str) -> Description:
        """The description of a colour's texture."""
        texture = self.description[name]
        if not isinstance(texture, Mapping):
            raise Fixed(f"its {name} is a ready-made Mitsuba object")
        if texture["type"] in ("mesh_attribute", "volume"):
            raise Fixed(f"its {name} is a '{texture['type']}'")
        return texture

    def coloured(self, name: str) -> tuple[RGB, bool]:
        """A colour's value, or white over a texture, and whether there is one."""
        if self.is_textured(name):
            self.texture(name)
            return (1.0, 1.0, 1.0), True
        return self.colour(name), False

    def image(self, name: str) -> ImageMap:
        """The picture of a colour's texture. Raises Fixed."""
        if name not in self._images:
            self._images[name] = image_of(self.texture(name), colour=True)
        return self._images[name]

    def images(self, names: Mapping[Place, str]) -> dict[Place, ImageMap]:
        """The pictures of those of some colours that are textured."""
        return {place: self.image(name) for place, name in names.items() if self.is_textured(name)}

    def varying(self, name: str) -> tuple[float, ImageMap | None]:
        """A number, or the mean of its texture, and the picture of that. Raises Fixed."""
        if not self.is_textured(name):
            return self.scalar(name), None
        if name not in self._images:
            self._images[name] = image_of(self.texture(name), colour=False)
        return self._images[name].mean[0], self._images[name]

    def edited_number(self, name: str, value: float, image: ImageMap | None) -> Any:
        """A number, or its texture: the plugin's own while that is what the picture shows."""
        if image is None:
            return value
        return dict(self.texture(name)) if image == self._images.get(name) else described(image)

    def edited_colour(self, name: str, colour: RGB, image: ImageMap | None) -> dict[str, Any]:
        """The dictionary entry of a colour, or of its tinted picture."""
        if max(colour) > 1:
            raise Fixed("a Mitsuba colour ends at 1")
        if image is None and name not in self._images and self.is_textured(name):
            texture: Description = self.texture(name)
        elif image is None:
            return {name: rgb(colour)}
        else:
            own = image == self._images.get(name)
            texture = self.texture(name) if own else described(image)
        if colour != (1.0, 1.0, 1.0):
            texture = product([Factor(texture), Factor(rgb(colour))])
        return {name: dict(texture)}


def rgb(colour: Any) -> dict[str, Any]:
    """A colour as a Mitsuba dictionary."""
    return {"type": "rgb", "value": [float(c) for c in colour]}
