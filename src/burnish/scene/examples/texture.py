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
    bend = _noise(u * 3 + shift[..., 0], v * 14 + shift[..., 1], random) - 0.5
    tilt = random.uniform(-0.3, 0.3, planks)[plank]
    across = (within - 0.5 + tilt * (u - 0.5)) * 0.9 + 0.24 * bend
    depth = random.uniform(0.15, 0.6, planks)[plank]
    ring = np.hypot(across, depth) * 17 + 0.6 * _noise(u * 9 + shift[..., 1], v * 60, random)
    late = (ring % 1.0) ** 2.5
    # Fibres: streaks far longer than wide
    fibre = 0.6 * _noise(u * 16, v * 420, random) + 0.4 * _noise(u * 60, v * 900, random)
    tone = 0.62 * (1 - 0.62 * late) + 0.3 * fibre + random.uniform(-0.09, 0.09, planks)[plank]
    pale, dark = np.array([0.5, 0.27, 0.12]), np.array([0.1, 0.038, 0.015])
    colour = dark + np.clip(tone, 0, 1)[..., None] * (pale - dark)
    # Seams between planks
    seam = np.minimum(within, 1 - within) * height / planks
    colour *= (0.35 + 0.65 * np.clip(seam / 2.5, 0, 1))[..., None]
    pixels = np.round(255 * np.clip(_srgb(colour), 0, 1)).astype(np.uint8)
    mi.Bitmap(np.ascontiguousarray(pixels)).write(str(path))
    return str(path)


def _noise(x: Float64, y: Float64, random: np.random.Generator) -> Float64:
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
