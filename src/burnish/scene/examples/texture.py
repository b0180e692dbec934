"""Textures made by code, written as images."""

from __future__ import annotations

from pathlib import Path

import mitsuba as mi
import numpy as np

from burnish.core.types import Float64


def write_wood(path: Path, planks: int = 5, width: int = 1024, height: int = 640) -> str:
    """Planks of wood with their grain along u: an 8-bit sRGB picture. Returns its path."""
    v, u = np.meshgrid(
        (np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width, indexing="ij"
    )
    random = np.random.default_rng(7)
    plank = np.minimum((v * planks).astype(int), planks - 1)
    within = v * planks - plank
    shift = random.uniform(0, 50, (planks, 2))[plank]
    # Annual rings: a slightly tilted cut through cylinders that noise has bent
    bend = noise(u * 3 + shift[..., 0], v * 14 + shift[..., 1], random) - 0.5
    tilt = random.uniform(-0.3, 0.3, planks)[plank]
    across = (within - 0.5 + tilt * (u - 0.5)) * 0.9 + 0.24 * bend
    depth = random.uniform(0.15, 0.6, planks)[plank]
    ring = np.hypot(across, depth) * 17 + 0.6 * noise(u * 9 + shift[..., 1], v * 60, random)
    late = (ring % 1.0) ** 2.5
    # Fibres: streaks far longer than wide
    fibre = 0.6 * noise(u * 16, v * 420, random) + 0.4 * noise(u * 60, v * 900, random)
    tone = 0.62 * (1 - 0.62 * late) + 0.3 * fibre + random.uniform(-0.09, 0.09, planks)[plank]
    pale, dark = np.array([0.5, 0.27, 0.12]), np.array([0.1, 0.038, 0.015])
    colour = dark + np.clip(tone, 0, 1)[..., None] * (pale - dark)
    # Seams between planks
    seam = np.minimum(within, 1 - within) * height / planks
    colour *= (0.35 + 0.65 * np.clip(seam / 2.5, 0, 1))[..., None]
    return write_picture(path, colour)


def write_marble(path: Path, size: int = 640) -> str:
    """Two by two polished tiles, light and dark, with veins: an 8-bit sRGB picture."""
    u, v = texels(size, size)
    column, row = (np.minimum((2 * x).astype(int), 1) for x in (u, v))
    x, y = u * 5 + 7 * column, v * 5 + 11 * row
    bend = 2.2 * clouds(x * 0.6, y * 0.6, 2)
    thin = 1 - np.abs(2 * clouds(x + bend, y - bend, 5) - 1)
    broad = clouds(0.5 * x - bend, 0.5 * y, 9)
    dark = ((column + row) % 2)[..., None]
    light = np.array([0.16, 0.125, 0.095]) * (0.8 + 0.3 * broad[..., None])
    deep = np.array([0.02, 0.024, 0.027]) * (0.6 + 0.8 * broad[..., None])
    vein = (np.clip((thin - 0.93) / 0.07, 0, 1) * np.clip(2 * broad - 0.5, 0, 1))[..., None]
    colour = np.where(dark, deep + 0.12 * vein, light * (1 - 0.35 * vein))
    seam = np.minimum.reduce([0.5 - np.abs((2 * x) % 1 - 0.5) for x in (u, v)]) * size / 2
    return write_picture(path, colour * (0.4 + 0.6 * np.clip(seam / 1.5, 0, 1))[..., None])


def write_tiles(path: Path, size: int = 512) -> str:
    """Four by four glazed tiles with a corner motif, and their joints."""
    u, v = texels(size, size)
    x, y = (4 * u) % 1 - 0.5, (4 * v) % 1 - 0.5
    tone = np.random.default_rng(5).uniform(0.86, 1.1, (4, 4))[
        (4 * v).astype(int), (4 * u).astype(int)
    ]
    corner = np.hypot(0.5 - np.abs(x), 0.5 - np.abs(y))
    centre = np.abs(x) + np.abs(y)
    motif = (np.abs(corner - 0.27) < 0.035) | (corner < 0.14) | (np.abs(centre - 0.2) < 0.03)
    colour = np.where(motif[..., None], (0.08, 0.12, 0.16), (0.42, 0.36, 0.28))
    colour = colour * (tone * (0.85 + 0.3 * clouds(u * 14, v * 14, 8)))[..., None]
    joint = np.minimum(0.5 - np.abs(x), 0.5 - np.abs(y)) * size / 4
    return write_picture(path, colour * (0.35 + 0.65 * np.clip(joint / 2.5, 0, 1))[..., None])


def write_picture(path: Path, colour: Float64) -> str:
    """Write linear RGB [height, width, 3] as an 8-bit sRGB picture. Returns its path."""
    pixels = np.round(255 * np.clip(_srgb(colour), 0, 1)).astype(np.uint8)
    mi.Bitmap(np.ascontiguousarray(pixels)).write(str(path))
    return str(path)


def texels(width: int, height: int) -> tuple[Float64, Float64]:
    """u and v [height, width] at the middles of a picture's texels, as Mitsuba reads them."""
    v, u = np.meshgrid(
        (np.arange(height) + 0.5) / height, (np.arange(width) + 0.5) / width, indexing="ij"
    )
    return u, v


def clouds(x: Float64, y: Float64, seed: int, octaves: int = 4) -> Float64:
    """Fractal noise, 0 to 1, its largest features of size 1."""
    random = np.random.default_rng(seed)
    parts = [noise(x * 2**k, y * 2**k, random) / 2 ** (k + 1) for k in range(octaves)]
    return np.asarray(sum(parts) / (1 - 0.5**octaves))


def noise(x: Float64, y: Float64, random: np.random.Generator) -> Float64:
    """Smooth value noise, 0 to 1, with features of size 1."""
    lattice = random.random((128, 1024))
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = x - i, y - j
    fx, fy = fx * fx * (3 - 2 * fx), fy * fy * (3 - 2 * fy)

    def at(a: int, b: int) -> Float64:
        return lattice[(i + a) % 128, (j + b) % 1024]

    low = at(0, 0) * (1 - fx) + at(1, 0) * fx
    high = at(0, 1) * (1 - fx) + at(1, 1) * fx
    return low * (1 - fy) + high * fy


def _srgb(linear: Float64) -> Float64:
    return np.where(
        linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055
    )
