"""glTF's metallic-roughness materials as Mitsuba's `principled`."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

import mitsuba as mi
import numpy as np
from PIL import Image, UnidentifiedImageError

from burnish.core.colour import linear_from_srgb, srgb_from_linear
from burnish.core.errors import SceneError
from burnish.core.types import AnyArray, Float64

LARGEST = 8192
"""The longest side of a texture; larger ones are scaled down, with a warning."""
MOST_PIXELS = 1 << 28
"""Of a picture that is read at all: 16k × 16k."""


class Source(Protocol):
    """What materials need of a parsed file."""

    path: Path

    def item(self, kind: str, index: int) -> Any: ...
    def view(self, index: int) -> bytes: ...
    def uri(self, uri: str, what: str) -> bytes: ...


class Materials:
    """Describes materials, and writes their textures into a folder, each once."""

    def __init__(self, source: Source, folder: Path, warnings: list[str]) -> None:
        self.source = source
        self.folder = folder
        self.warnings = warnings
        self._images: dict[int, AnyArray] = {}
        self._files: dict[object, str] = {}

    def describe(self, index: int | None) -> tuple[dict[str, Any], dict[str, Any] | None]:
        """The BSDF of a material (glTF's default for None), and what it emits, if anything.

        Raises MissingFile, SceneError.
        """
        material = {} if index is None else self.source.item("materials", index)
        extensions = material.get("extensions", {})
        bsdf: dict[str, Any] = {"type": "principled", **self._base(material)}
        bsdf |= _index(extensions)
        coat = extensions.get("KHR_materials_clearcoat", {})
        if coat.get("clearcoatFactor", 0.0) > 0:
            bsdf["clearcoat"] = float(coat["clearcoatFactor"])
            if "clearcoatTexture" in coat:
                bsdf["clearcoat"] = self._channel(coat["clearcoatTexture"], 0, bsdf["clearcoat"])
            alpha = float(coat.get("clearcoatRoughnessFactor", 0.0)) ** 2
            bsdf["clearcoat_gloss"] = float(np.clip((0.1 - alpha) / 0.099, 0.0, 1.0))
            for name in ("clearcoatRoughnessTexture", "clearcoatNormalTexture"):
                if name in coat:
                    self.warnings.append(f"a {name} is left out")
        sheen = extensions.get("KHR_materials_sheen", {})
        if max(sheen.get("sheenColorFactor", (0.0,))) > 0:
            bsdf["sheen"] = float(min(max(sheen["sheenColorFactor"]), 1.0))
        strength = extensions.get("KHR_materials_anisotropy", {}).get("anisotropyStrength", 0.0)
        if strength > 0:
            bsdf["anisotropic"] = float(strength)
        through = extensions.get("KHR_materials_transmission", {}).get("transmissionFactor", 0.0)
        if through > 0:
            bsdf["spec_trans"] = float(through)
        return self._wrapped(material, bsdf), self._emission(material, extensions)

    def _base(self, material: Mapping[str, Any]) -> dict[str, Any]:
        surface = material.get("pbrMetallicRoughness", {})
        factor = [float(c) for c in surface.get("baseColorFactor", (1, 1, 1, 1))]
        result: dict[str, Any] = {"base_color": {"type": "rgb", "value": factor[:3]}}
        if "baseColorTexture" in surface:
            result["base_color"] = self._colour(surface["baseColorTexture"], factor[:3])
        for name, key, channel in (
            ("roughness", "roughnessFactor", 1),
            ("metallic", "metallicFactor", 2),
        ):
            result[name] = float(surface.get(key, 1.0))
            if "metallicRoughnessTexture" in surface:
                texture = surface["metallicRoughnessTexture"]
                result[name] = self._channel(texture, channel, result[name])
        return result

    def _wrapped(self, material: Mapping[str, Any], bsdf: dict[str, Any]) -> dict[str, Any]:
        if "normalTexture" in material:
            texture = self._bitmap(material["normalTexture"], "normal", lambda pixels: pixels, True)
            bsdf = {"type": "normalmap", "normalmap": texture, "bsdf": bsdf}
        bsdf = {"type": "twosided", "bsdf": bsdf}
        mode = material.get("alphaMode", "OPAQUE")
        if mode == "OPAQUE":
            return bsdf
        surface = material.get("pbrMetallicRoughness", {})
        opacity: Any = float(surface.get("baseColorFactor", (1, 1, 1, 1))[3])
        if "baseColorTexture" in surface:
            cutoff = float(material.get("alphaCutoff", 0.5)) if mode == "MASK" else None
            opacity = self._opacity(surface["baseColorTexture"], opacity, cutoff)
        return {"type": "mask", "opacity": opacity, "bsdf": bsdf} if opacity != 1 else bsdf

    def _emission(
        self, material: Mapping[str, Any], extensions: Mapping[str, Any]
    ) -> dict[str, Any] | None:
        factor = np.asarray(material.get("emissiveFactor", (0.0, 0.0, 0.0)), np.float64)
        strength = extensions.get("KHR_materials_emissive_strength", {}).get(
            "emissiveStrength", 1.0
        )
        if not (factor * strength).any():
            return None
        if "emissiveTexture" not in material:
            return {"type": "rgb", "value": [float(c) for c in factor * strength]}
        if strength != 1:
            self.warnings.append("an emissive texture's strength is limited to 1")
        pixels = self._pixels(material["emissiveTexture"])
        if not pixels[..., :3].any():
            return None
        return self._colour(material["emissiveTexture"], [float(min(c, 1.0)) for c in factor])

    # -- textures -------------------------------------------------------------------------

    def _colour(self, info: Mapping[str, Any], factor: list[float]) -> dict[str, Any]:
        """An sRGB texture times a linear colour."""

        def scaled(pixels: AnyArray) -> AnyArray:
            if all(c == 1 for c in factor):
                return pixels[..., :3]
            linear = linear_from_srgb(pixels[..., :3] / 255) * factor
            return np.asarray(np.round(255 * srgb_from_linear(linear)), np.uint8)

        return self._bitmap(info, ("colour", *factor), scaled, False)

    def _channel(self, info: Mapping[str, Any], channel: int, factor: float) -> Any:
        """A channel of a linear texture times a factor; a number where it is constant."""
        values = self._pixels(info)[..., channel]
        if values.min() == values.max():
            return factor * float(values.flat[0]) / 255
        return self._bitmap(
            info,
            ("channel", channel, factor),
            lambda pixels: np.asarray(np.round(pixels[..., channel] * factor), np.uint8),
            True,
        )

    def _opacity(self, info: Mapping[str, Any], factor: float, cutoff: float | None) -> Any:
        alpha = self._pixels(info)[..., 3] * (factor / 255)
        alpha = alpha if cutoff is None else (alpha >= cutoff).astype(np.float64)
        if alpha.min() == alpha.max():
            return float(alpha.flat[0])
        values = np.asarray(np.round(255 * alpha), np.uint8)
        return self._bitmap(info, ("opacity", factor, cutoff), lambda _: values, True)

    def _bitmap(self, info: Mapping[str, Any], key: object, edit: Any, raw: bool) -> dict[str, Any]:
        """A texture as a bitmap plugin over a PNG file of its own."""
        if info.get("texCoord", 0) != 0:
            self.warnings.append("second texture coordinates are left out")
        texture = self.source.item("textures", info["index"])
        known = (self._image_index(texture), key)
        if known not in self._files:
            path = self.folder / f"texture_{len(self._files)}.png"
            Image.fromarray(np.ascontiguousarray(edit(self._pixels(info)))).save(path)
            self._files[known] = str(path)
        result: dict[str, Any] = {"type": "bitmap", "filename": self._files[known], "raw": raw}
        if "sampler" in texture:
            wrap = self.source.item("samplers", texture["sampler"]).get("wrapS", 10497)
            result["wrap_mode"] = {33071: "clamp", 33648: "mirror"}.get(wrap, "repeat")
        transform = info.get("extensions", {}).get("KHR_texture_transform")
        if transform is not None:
            result["to_uv"] = mi.ScalarTransform3f(_uv_matrix(transform))
        return result

    def _pixels(self, info: Mapping[str, Any]) -> AnyArray:
        """The texels of a texture: uint8 [height, width, 4]."""
        index = self._image_index(self.source.item("textures", info["index"]))
        if index not in self._images:
            self._images[index] = self._read(index)
        return self._images[index]

    def _image_index(self, texture: Mapping[str, Any]) -> int:
        if "source" not in texture:
            raise SceneError(
                f"{self.source.path}: a texture has no PNG or JPEG image; export it with one"
            )
        return int(texture["source"])

    def _read(self, index: int) -> AnyArray:
        image = self.source.item("images", index)
        where = f"images[{index}]"
        if "uri" in image:
            data = self.source.uri(image["uri"], where)
        else:
            data = self.source.view(int(image["bufferView"]))
        try:
            with _any_size(), Image.open(io.BytesIO(data)) as picture:
                width, height = picture.size
                if width * height > MOST_PIXELS:
                    raise SceneError(
                        f"{self.source.path}: {where} has {width} × {height} pixels, more than "
                        f"can be read ({MOST_PIXELS:,}); scale it down"
                    )
                if max(picture.size) > LARGEST:
                    self.warnings.append(
                        f"{where} of {width} × {height} pixels is scaled down to {LARGEST}"
                    )
                    picture.thumbnail((LARGEST, LARGEST))
                return np.asarray(picture.convert("RGBA"))
        except (UnidentifiedImageError, OSError):
            raise SceneError(
                f"{self.source.path}: {where} is not a picture that can be read; export it anew"
            ) from None


@contextmanager
def _any_size() -> Iterator[None]:
    """Let Pillow open what it takes for an attack: a texture of 16k is large, not hostile."""
    before, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
    try:
        yield
    finally:
        Image.MAX_IMAGE_PIXELS = before


def _index(extensions: Mapping[str, Any]) -> dict[str, float]:
    """Mitsuba's `specular` of an index of refraction and a specular weight."""
    ior = float(extensions.get("KHR_materials_ior", {}).get("ior", 1.5))
    weight = float(extensions.get("KHR_materials_specular", {}).get("specularFactor", 1.0))
    return {"specular": float(np.clip(weight * ((ior - 1) / (ior + 1)) ** 2 / 0.08, 1e-6, 1.0))}


def _uv_matrix(transform: Mapping[str, Any]) -> Float64:
    """KHR_texture_transform: translation · rotation · scale."""
    angle = float(transform.get("rotation", 0.0))
    sx, sy = transform.get("scale", (1.0, 1.0))
    ox, oy = transform.get("offset", (0.0, 0.0))
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c * sx, s * sy, ox], [-s * sx, c * sy, oy], [0.0, 0.0, 1.0]])
