"""The part of a session that is about maps: pictures in place of parameters' values."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from burnish.core.errors import InvalidValue
from burnish.core.types import Value
from burnish.materials.images.files import Channel, read_texels
from burnish.materials.images.image import (
    ImageMap,
    Place,
    Placement,
    Wrap,
    placed,
    transform_of,
)
from burnish.materials.layer import Material, MaterialState
from burnish.materials.models.plastic_base import PlasticBase
from burnish.materials.names import Address, resolve, with_image
from burnish.materials.parameter import Parameter
from burnish.session.history import History


class MapEditing:
    """Mixed into `Session`, which has the history and the materials."""

    _history: History

    def map_of(self, path: str) -> ImageMap | None:
        """The picture in place of a parameter's value, or None. Raises UnknownName."""
        address, _, _ = self._mapped(path)
        return self._history.state[address.object].images.get((address.layer, address.parameter))

    def set_map(
        self,
        path: str,
        file: str | os.PathLike[str] | None = None,
        *,
        scale: float | None = None,
        offset: float | None = None,
        transform: Sequence[float] | None = None,
        repeat: float | tuple[float, float] | None = None,
        rotate: float | None = None,
        shift: tuple[float, float] | None = None,
        wrap: Wrap | None = None,
        channel: Channel = "",
    ) -> None:
        """Put a picture in place of a parameter's value, or edit the one that is there.

        file: PNG, JPEG or EXR, its top row at v = 0; the picture that is there without it. A
        scalar takes one channel ("red", "green", "blue", "alpha", or the luminance), as it
        stands in the file, which is read again for another one; a colour takes all, sRGB where
        the file has eight or sixteen bits.
        Each point has scale · picture + offset, inside the parameter's limits; a colour times
        the parameter's own value, which begins as white. repeat, rotate, shift: how often it
        lies along u and v, turned by degrees about the middle, moved; or transform: a, b, c, d,
        e, f of u' = a u + b v + c, v' = d u + e v + f. wrap: "repeat", "clamp" or "mirror".

        >>> session.set_map("floor.diffuse.color", "oak.jpg", repeat=4)          # doctest: +SKIP
        >>> session.set_map("helmet.specular.roughness", scale=0.5, offset=0.1)  # doctest: +SKIP

        Exact row by row where the object is met first; further on it counts by the mean of its
        coefficients. Raises UnknownName, InvalidValue, MissingFile.
        """
        address, parameter, material = self._mapped(path)
        state = self._history.state[address.object]
        place = address.layer, address.parameter
        before = image = state.images.get(place)
        if file is not None:
            self._check_replaceable(material, address)
            source = Path(file).expanduser().resolve()
            texels = read_texels(source, parameter.kind == "colour", channel)
            image = ImageMap(texels, source.as_posix(), channel)
        if image is None:
            raise InvalidValue(f"{path} has no map yet: name the picture's file")
        if channel and file is None:
            if not image.source:
                raise InvalidValue(
                    f"{path}: the scene's own map has no channel to choose; name a picture's file"
                )
            texels = read_texels(image.source, parameter.kind == "colour", channel)
            image = replace(image, texels=texels, channel=channel)
        if scale is not None:
            image = replace(image, scale=float(scale))
        if offset is not None:
            image = replace(image, offset=float(offset))
        if transform is not None:
            image = replace(image, transform=transform_of(transform))
        if (repeat, rotate, shift) != (None, None, None):
            now = Placement.of(image.transform)
            wide = (repeat, repeat) if isinstance(repeat, (int, float)) else repeat
            turned = now.rotate if rotate is None else float(rotate)
            image = replace(image, transform=placed(wide or now.repeat, turned, shift or now.shift))
        if wrap is not None:
            image = replace(image, wrap=wrap)
        if parameter.kind == "colour" and before is None:
            state = _valued(state, address, (1.0, 1.0, 1.0))
        shown = "" if file is None else f" to {Path(file).name}"
        changed = with_image(parameter, state, place, image)
        self._change(address.object, changed, f"Set the map of {path}{shown}")

    def clear_map(self, path: str) -> None:
        """Give a parameter one value again: the mean of its map. Raises UnknownName."""
        address, parameter, _ = self._mapped(path)
        state = self._history.state[address.object]
        place = address.layer, address.parameter
        image = state.images.get(place)
        if image is None:
            return
        if parameter.kind == "colour":
            tint = state.layers[address.layer].values[address.parameter]
            assert isinstance(tint, tuple)
            wide = image.mean * 3 if len(image.mean) == 1 else image.mean
            r, g, b = (
                min(max(m * t, parameter.minimum), parameter.maximum)
                for m, t in zip(wide, tint, strict=True)
            )
            state = _valued(state, address, (r, g, b))
        images = {key: item for key, item in state.images.items() if key != place}
        self._change(address.object, replace(state, images=images), f"Took the map off {path}")

    def _mapped(self, path: str) -> tuple[Address, Parameter, Material]:
        """What a path names, where that can have a map. Raises UnknownName, InvalidValue."""
        materials = self._current()
        address = resolve(materials, path)
        material = materials[address.object]
        if address.parameter == "weight" or address.of_map:
            raise InvalidValue(f"{path} has no map; a layer's parameters have, such as its color")
        parameter = material.layer(address.layer).parameter(address.parameter)
        if parameter.kind not in ("scalar", "colour"):
            raise InvalidValue(f"{path} is a {parameter.kind}, which has no map")
        return address, parameter, material

    @staticmethod
    def _check_replaceable(material: Material, address: Address) -> None:
        model = material.layer(address.layer).model
        held = isinstance(model, PlasticBase) and model.textured and model.nonlinear
        if held and address.parameter == "color":
            raise InvalidValue(
                f"{address.object}.{address.layer}.color is a texture seen through a coat that "
                "changes its colours (nonlinear); another picture cannot take its place"
            )

    def _current(self) -> Mapping[str, Material]:
        raise NotImplementedError

    def _change(self, object_id: str, material: MaterialState, label: str) -> None:
        raise NotImplementedError


def own_maps(
    state: MaterialState, material: Material, layer: str, parameter: str | None = None
) -> MaterialState:
    """The state with the scene's own maps of a layer, or of one of its parameters."""

    def meant(place: Place) -> bool:
        return place[0] == layer and parameter in (None, place[1])

    kept = {place: image for place, image in state.images.items() if not meant(place)}
    own = {place: image for place, image in material.initial.images.items() if meant(place)}
    return replace(state, images=kept | own)


def _valued(state: MaterialState, address: Address, value: Value) -> MaterialState:
    layer = state.layers[address.layer]
    layer = replace(layer, values={**layer.values, address.parameter: value})
    return replace(state, layers={**state.layers, address.layer: layer})
