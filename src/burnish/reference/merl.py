"""A MERL file as a Mitsuba BSDF: the truth for measured materials.

Nothing here knows how burnish reads, interpolates, factorises or edits a table: the file is
read anew, directions are turned into half and difference angles by two rotations as in the
code that came with the data (Matusik et al. 2003, `BRDFRead.cpp`), and cells are looked up or
interpolated by its own arithmetic.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from burnish.core.errors import InvalidValue, MeasurementError, MissingFile
from burnish.core.types import Float32, Float64

PLUGIN = "merl"
CELLS = (90, 90, 180)
"""Of θh, θd and φd."""
CHANNEL_SCALE = (1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0)
NODES = 361
"""Of the density that half vectors are drawn from."""
COSINE_SHARE = 0.3
"""Of the sampled directions; the others follow the table's highlight."""


def merl_bsdf(path: str | Path, interpolation: str = "linear") -> Any:
    """The BSDF of a file, for the variant in use; two-sided materials need `twosided` around it.

    interpolation: "linear" between the centres of cells, or "nearest", the cell itself, as the
    data's own code reads them. Negative cells count as 0. Raises MissingFile, MeasurementError,
    InvalidValue.
    """
    props = mi.Properties(PLUGIN)
    props["filename"] = str(path)
    props["interpolation"] = interpolation
    return merl_class()(props)


def merl_class() -> Any:
    """The plugin `merl` of the variant in use: string `filename`, string `interpolation`."""
    return _merl_class(mi.variant())


def reflectances(path: Path) -> Float64:
    """The cells of a file: float64 [3, 90, 90, 180], 1/sr."""
    if not path.is_file():
        raise MissingFile(f"{path}: no such file; give a MERL .binary file")
    counts = np.fromfile(path, "<i4", 3)
    values = np.fromfile(path, "<f8", offset=12)
    if tuple(counts) != CELLS or values.size != 3 * int(np.prod(CELLS)):
        raise MeasurementError(
            f"{path}: {values.size} values of {tuple(counts)} cells; a MERL file has "
            f"{3 * int(np.prod(CELLS))} of {CELLS}"
        )
    return values.reshape(3, *CELLS) * np.reshape(CHANNEL_SCALE, (3, 1, 1, 1))


def _highlight(values: Float64) -> Float32:
    """Where half vectors are drawn, as a density over u = √(θh / 90°): float32 [NODES].

    As the table shines beyond its least value, and for a tenth evenly over the hemisphere.
    """
    u = np.linspace(0.0, 1.0, NODES)
    mean = values[:, :, : CELLS[1] // 2].mean(axis=(0, 2, 3))
    shine = np.interp(u, (np.arange(CELLS[0]) + 0.5) / CELLS[0], mean - mean.min())
    # dωh = 2π sinθh dθh, dθh = πu du
    ring = np.sin(np.pi / 2 * u * u) * u
    lobe = shine * ring * np.cos(np.pi / 2 * u * u)
    return np.asarray(lobe / max(lobe.mean(), 1e-12) + 0.1 * ring / ring.mean(), np.float32)


@cache
def _merl_class(variant: str) -> Any:
    # Mitsuba's classes belong to a variant, and so must what is derived from them
    class MerlBSDF(mi.BSDF):
        """Isotropic reflection by a table over θh, θd and φd, on the upper side."""

        def __init__(self, props: Any) -> None:
            mi.BSDF.__init__(self, props)
            self.nearest = str(props.get("interpolation", "linear")) == "nearest"
            if not self.nearest and str(props.get("interpolation", "linear")) != "linear":
                raise InvalidValue(
                    f"interpolation must be linear or nearest; got {str(props['interpolation'])!r}"
                )
            self.path = str(props["filename"])
            values = np.maximum(reflectances(Path(str(mi.file_resolver().resolve(self.path)))), 0)
            self.table = mi.Float(np.moveaxis(values, 0, -1).astype(np.float32).ravel())
            self.spread = mi.ContinuousDistribution(mi.ScalarVector2f(0, 1), _highlight(values))
            flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.FrontSide
            self.m_components, self.m_flags = [flags], flags

        def reflectance(self, wi: Any, wo: Any, active: Any) -> Any:
            """ρ(ωi, ωo), symmetric; mi.Color3f."""
            half = dr.normalize(wi + wo)
            sin_h = dr.sqrt(dr.square(half.x) + dr.square(half.y))
            safe = dr.select(sin_h > 1e-7, sin_h, 1)
            cos_phi = dr.select(sin_h > 1e-7, half.x / safe, 1)
            sin_phi = dr.select(sin_h > 1e-7, half.y / safe, 0)
            # Turn by −φh about the normal, then by −θh about the second axis
            x, y = cos_phi * wi.x + sin_phi * wi.y, cos_phi * wi.y - sin_phi * wi.x
            x, z = half.z * x - sin_h * wi.z, sin_h * x + half.z * wi.z
            theta_h = dr.atan2(sin_h, half.z)
            theta_d = dr.atan2(dr.sqrt(dr.square(x) + dr.square(y)), z)
            phi_d = dr.atan2(y, x)
            phi_d = dr.select(phi_d < 0, phi_d + dr.pi, phi_d)
            place = (
                dr.sqrt(dr.clip(theta_h * (2 / dr.pi), 0, 1)) * CELLS[0],
                dr.clip(theta_d * (2 / dr.pi), 0, 1) * CELLS[1],
                phi_d * (CELLS[2] / dr.pi),
            )
            return self._cell(place, active) if self.nearest else self._between(place, active)

        def _at(self, h: Any, d: Any, p: Any, active: Any) -> Any:
            return dr.gather(mi.Color3f, self.table, (h * CELLS[1] + d) * CELLS[2] + p, active)

        def _cell(self, place: Any, active: Any) -> Any:
            h, d, p = (mi.UInt32(dr.minimum(x, n - 1)) for x, n in zip(place, CELLS, strict=True))
            return self._at(h, d, p, active)

        def _between(self, place: Any, active: Any) -> Any:
            low, share = [], []
            for x in place:
                floor = dr.floor(x - 0.5)
                low.append(mi.Int32(floor))
                share.append(x - 0.5 - floor)
            result = mi.Color3f(0)
            for corner in range(8):
                weight, index = mi.Float(1), list[Any]()
                for axis in range(3):
                    up = corner >> axis & 1
                    weight *= share[axis] if up else 1 - share[axis]
                    at = low[axis] + up
                    if axis < 2:
                        at = dr.clip(at, 0, CELLS[axis] - 1)
                    else:
                        at = dr.select(at < 0, at + CELLS[2], at)
                        at = dr.select(at >= CELLS[2], at - CELLS[2], at)
                    index.append(mi.UInt32(at))
                result += weight * self._at(index[0], index[1], index[2], active)
            return result

        def sample(
            self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True
        ) -> tuple[Any, Any]:
            cosine = mi.warp.square_to_cosine_hemisphere(sample2)
            u = self.spread.sample(sample2.x)
            sin_h, cos_h = dr.sincos(dr.pi / 2 * dr.square(u))
            sin_phi, cos_phi = dr.sincos(2 * dr.pi * sample2.y)
            half = mi.Vector3f(sin_h * cos_phi, sin_h * sin_phi, cos_h)
            mirrored = 2 * dr.dot(si.wi, half) * half - si.wi
            bs = dr.zeros(mi.BSDFSample3f)
            bs.wo = dr.select(sample1 < COSINE_SHARE, cosine, mirrored)
            value, bs.pdf = self.eval_pdf(ctx, si, bs.wo, active)
            bs.eta = 1.0
            bs.sampled_type = +mi.BSDFFlags.GlossyReflection
            bs.sampled_component = 0
            usable = bs.pdf > 0
            return bs, dr.select(usable, value / dr.select(usable, bs.pdf, 1), 0)

        def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval_pdf(ctx, si, wo, active)[0]

        def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
            return self.eval_pdf(ctx, si, wo, active)[1]

        def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
            lit = active & (si.wi.z > 0) & (wo.z > 0)
            value = self.reflectance(si.wi, wo, lit) * wo.z
            half = dr.normalize(si.wi + wo)
            sin_h = dr.sqrt(dr.square(half.x) + dr.square(half.y))
            u = dr.sqrt(dr.atan2(sin_h, half.z) * (2 / dr.pi))
            # p(u) over the ring 2π sinθh and dθh = π u du, then dωh / dωi
            ring = 2 * dr.square(dr.pi) * dr.maximum(u * sin_h, 1e-12)
            lobe = self.spread.eval_pdf_normalized(u, lit) / ring
            lobe /= 4 * dr.maximum(dr.dot(si.wi, half), 1e-6)
            pdf = COSINE_SHARE * wo.z * dr.inv_pi + (1 - COSINE_SHARE) * lobe
            return dr.select(lit, value, 0), dr.select(lit, pdf, 0)

        def to_string(self) -> str:
            return f"MerlBSDF[{self.path}]"

    mi.register_bsdf(PLUGIN, MerlBSDF)
    return MerlBSDF
