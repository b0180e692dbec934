"""A space of materials spanned by measured ones (Matusik et al. 2003; 2010, §8; 2015 report).

Every material of the space is a mixture of the given tables, with the nearest weights to
1/n + Σ_j z_j u_j / √n + Σ_t amount_t trait_t that are not negative and add to 1,

    ρ = Σ_i w_i ρ_i.

So whatever the sliders say, it is reciprocal, reflects no less than nothing and no more than the
most reflecting of the given materials. (Matusik et al. also go on beyond the given materials,
in logarithms; sums that do turn highlights black.)

The sliders z_j go along the principal components of the set, in logarithms as in the 2003
paper: highlights are thousands of times brighter than what is beside them, and eyes compare
ratios. One unit is a standard deviation of the set. The u_j are orthonormal and sum to 0, so
all sliders together reach every given material, exactly. A trait leads from the mean of the
materials without it to the mean of those with it.

Edits are amplitudes of tables that stay what they are, so the transport has one column for
each principal component of the tables' channels.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from burnish.core.errors import InvalidValue, MeasurementError, UnknownName
from burnish.core.types import Float32, Float64, Value
from burnish.materials.layer import Layer, LayerState, Material, MaterialState
from burnish.materials.maths import Maths, Vector, theta_half
from burnish.materials.measured.merl import read_merl
from burnish.materials.measured.register import find, keep, path_of
from burnish.materials.measured.table import ReflectanceTable, closed
from burnish.materials.model import Fixed, Model, Values
from burnish.materials.parameter import Parameter
from burnish.materials.principal import leading, same_signs

MOST = 21
"""Materials that a space may have: three channels of each are at most 63 components."""
COLOUR = Parameter("color", 1.0, 0.0, 4.0, 0.0, 2.0, kind="colour", description="as measured: 1")
BEYOND = 1e-9
"""How far a component's slider goes beyond the outermost material, before rounding."""
FLOOR = 1e-3
"""Of a table's mean: what is darker counts as this dark in logarithms."""
TRAIT_NAME = re.compile(r"[a-z][a-z0-9_]*")


@dataclass(frozen=True)
class MeasuredSpace(Model):
    """A space of measured materials as one layer, by principal components.

    | parameter | range | meaning |
    |---|---|---|
    | color | [0, 4] per channel, linear RGB | scales the material; 1 is as measured |
    | component_1 … | as far as the given materials go | standard deviations along a component |
    | each trait | [−1, 1] | 1 leads from the mean without it to the mean with it |

    Sliders that ask for less than nothing of a material get none of it.

    Static: tables (SHA-256 of each, none for a matte grey), paths (their MERL files), names,
    traits: (name, direction in the weights) pairs; error, the relative RMS that the components
    may have over all channels of all tables, each relative to itself and its cells weighted by
    cosθi cosθo and their solid angles.
    """

    tables: tuple[str, ...] = ("",)
    paths: tuple[str, ...] = field(default=(), compare=False)
    names: tuple[str, ...] = ("matte",)
    traits: tuple[tuple[str, tuple[float, ...]], ...] = ()
    error: float = 3e-3

    name = "measured-space"
    coordinate_maximum = math.pi / 2
    lobe = "half"
    quadrature_points = 256

    def __post_init__(self) -> None:
        # JSON has no tuples
        for each in ("tables", "paths", "names"):
            object.__setattr__(self, each, tuple(getattr(self, each)))
        object.__setattr__(self, "paths", self.paths or ("",) * len(self.tables))
        traits = tuple((name, tuple(float(x) for x in along)) for name, along in self.traits)
        object.__setattr__(self, "traits", traits)
        count = len(self.tables)
        if not 1 <= count <= MOST:
            raise InvalidValue(f"a space needs 1 to {MOST} measured materials; got {count}")
        if not 1e-3 <= self.error <= 0.5:
            raise InvalidValue(f"error must lie in [0.001, 0.5]; got {self.error!r}")
        lengths = {len(self.paths), len(self.names), *(len(along) for _, along in self.traits)}
        if lengths != {count}:
            raise InvalidValue(
                f"paths, names and traits must have an entry for each of {count} tables; got "
                f"{sorted(lengths)}"
            )
        # What can be edited follows from the data
        object.__setattr__(self, "parameters", (COLOUR, *self._sliders()))

    def _sliders(self) -> list[Parameter]:
        place = self.coordinates
        found = [
            Parameter(
                f"component_{j + 1}",
                0.0,
                # What one machine's libraries round to stays within the limits of another's
                round(float(place[:, j].min()) - BEYOND, 9),
                round(float(place[:, j].max()) + BEYOND, 9),
                description=self._towards(place[:, j]),
            )
            for j in range(place.shape[1])
        ]
        for name, along in self.traits:
            known = {"color", "weight", *(item.name for item in found)}
            if not TRAIT_NAME.fullmatch(name) or name in known:
                raise InvalidValue(
                    f"a trait's name must be of small letters, digits and _, and no other "
                    f"parameter's; got {name!r}"
                )
            if abs(sum(along)) > 1e-9:
                raise InvalidValue(f"trait {name}: its weights must sum to 0; got {along!r}")
            found.append(Parameter(name, 0.0, -1.0, 1.0, description=f"how much {name}"))
        return found

    def _towards(self, place: Float64) -> str:
        low, high = (self.names[int(i)] for i in (place.argmin(), place.argmax()))
        return f"from {low} to {high}"

    @property
    def data(self) -> tuple[ReflectanceTable, ...]:
        """The tables. Raises MissingFile, MeasurementError."""
        return tuple(find(key, path) for key, path in zip(self.tables, self.paths, strict=True))

    @property
    def coordinates(self) -> Float64:
        """Where each given material is along the components: float64 [n, n − 1]."""
        return _coordinates(self.tables, self.paths)

    @property
    def span(self) -> Span:
        """The components, computed once per set and error."""
        return _span(self.tables, self.paths, self.error)

    def values_of(self, material: str) -> dict[str, Value]:
        """The parameters of a given material. Raises UnknownName."""
        if material not in self.names:
            raise UnknownName("measured material", material, self.names)
        place = self.coordinates[self.names.index(material)]
        sliders = {f"component_{j + 1}": float(z) for j, z in enumerate(place)}
        return {"color": (1.0, 1.0, 1.0), **sliders, **{name: 0.0 for name, _ in self.traits}}

    def weights(self, values: Mapping[str, Any]) -> list[Any]:
        """w_i, not negative and adding to 1; floats, or numbers of a kernel."""
        n, place = len(self.tables), self.coordinates
        asked: list[Any] = []
        for i in range(n):
            w: Any = 1.0 / n
            for j in range(n - 1):
                w = w + values[f"component_{j + 1}"] * (float(place[i, j]) / n)
            for name, along in self.traits:
                w = w + values[name] * along[i]
            asked.append(w)
        return _mixture(asked)

    @property
    def rank(self) -> int:
        return len(self.span.tables)

    def coordinate(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> Any:
        return theta_half(xp, wi, wo) * (2 / xp.pi)

    def quotients(self, xp: Maths, wi: Any, wo: Any, fixed: Fixed) -> list[Any]:
        return xp.lookup3(self.span.tables, *self.data[0].place(xp, wi, wo))

    def profile(self, t: Float64, values: Values, fixed: Fixed) -> Float64:
        return np.ones((len(t), 1))

    def amplitudes(self, values: Values, fixed: Fixed) -> Float64:
        mixed = np.tensordot(np.asarray(self.weights(values), np.float64), self.span.shares, axes=1)
        return np.asarray(mixed * np.asarray(values["color"], np.float64))

    def amplitude_sizes(self) -> Float64:
        return self.span.sizes

    def evaluate(self, xp: Maths, wi: Any, wo: Any, values: Mapping[str, Any]) -> list[Any]:
        lit = (wi.z > 0) & (wo.z > 0)
        up = [Vector(w.x, w.y, xp.select(lit, w.z, 1.0)) for w in (wi, wo)]
        total: list[Any] = [0.0, 0.0, 0.0]
        for w, table in zip(self.weights(values), self.data, strict=True):
            total = [a + w * b for a, b in zip(total, table.evaluate(xp, *up), strict=True)]
        return [xp.select(lit, c * t, 0.0) for c, t in zip(values["color"], total, strict=True)]


def measured_space(
    sources: Sequence[ReflectanceTable | str | Path] | Mapping[str, ReflectanceTable | str | Path],
    traits: Mapping[str, tuple[Sequence[str], Sequence[str]]] | None = None,
    start: str | None = None,
    error: float = 3e-3,
) -> Material:
    """The material of a space: one layer "measured", with a slider for each component and trait.

    sources: MERL files or tables, by name; files without names have those of their stems.
    traits: by name, the materials with and those without it. start: the material that it starts
    as, the mean without it. A bundle needs the files to be where they were.
    Raises InvalidValue, UnknownName, MissingFile, MeasurementError.
    """
    if isinstance(sources, Mapping):
        named = dict(sources)
    else:
        named = {
            Path(item).stem if isinstance(item, (str, Path)) else f"material_{i + 1}": item
            for i, item in enumerate(sources)
        }
        if len(named) != len(sources):
            raise InvalidValue("two of the files have one name; give a mapping of names to files")
    tables = [
        item if isinstance(item, ReflectanceTable) else read_merl(item) for item in named.values()
    ]
    keys = tuple(keep(table) for table in tables)
    if len(set(keys)) != len(keys):
        raise InvalidValue("two of the materials have the same data; leave one out")
    names = tuple(named)
    directions = tuple(
        (trait, _direction(trait, names, *both)) for trait, both in (traits or {}).items()
    )
    model = MeasuredSpace(keys, tuple(path_of(key) for key in keys), names, directions, error)
    if start is None:
        values = {item.name: item.validate(item.default) for item in model.parameters}
    else:
        values = model.values_of(start)
    layer = Layer.starting_at("measured", model, values)
    return Material((layer,), MaterialState({"measured": LayerState(values)}))


def _direction(
    trait: str, names: Sequence[str], having: Sequence[str], lacking: Sequence[str]
) -> tuple[float, ...]:
    """From the mean of those that lack a trait to the mean of those that have it."""
    for name in (*having, *lacking):
        if name not in names:
            raise UnknownName("measured material", name, names)
    if not having or not lacking or set(having) & set(lacking):
        raise InvalidValue(
            f"trait {trait}: name at least one material with it and one without, and none twice"
        )
    up, down = (
        np.array([name in group for name in names]) / len(set(group)) for group in (having, lacking)
    )
    return tuple((up - down).tolist())


def _mixture(asked: Sequence[Any]) -> list[Any]:
    """The nearest weights to those asked for that are not negative and add to 1.

    max(w_i − τ, 0) with the one τ that they add to 1 for (Michelot 1986): each step leaves out
    what the last one made negative, so that as many steps as weights are enough. In plain
    arithmetic, for a kernel's numbers too.
    """
    kept: list[Any] = [1.0 + 0.0 * w for w in asked]
    limit: Any = 0.0
    for _ in asked:
        count = sum(kept)
        limit = (sum(k * w for k, w in zip(kept, asked, strict=True)) - 1.0) / count
        kept = [k * (1.0 * (w > limit)) for k, w in zip(kept, asked, strict=True)]
    return [k * (w - limit) for k, w in zip(kept, asked, strict=True)]


@dataclass(frozen=True, eq=False)
class Span:
    """The principal components of the channels of n tables, the mean first.

    tables: float32 [k, h, d, p + 2], as `ReflectanceTable.samples`. shares: float64 [n, k, 3],
    what each table's channels have of them. errors: float64, the relative RMS over all channels
    with 1, 2, … components. sizes: float64 [k], the RMS of a share of a channel of size one.
    """

    tables: Float32
    shares: Float64
    errors: Float64
    sizes: Float64


@lru_cache(maxsize=8)
def _coordinates(keys: tuple[str, ...], paths: tuple[str, ...]) -> Float64:
    n = len(keys)
    if n == 1:
        return np.zeros((1, 0))
    tables = _tables(keys, paths)
    # Every few cells are enough for angles between materials
    some = (slice(None), slice(None), slice(None, None, 3), slice(None, None, 6))
    weight = _cell_weights(tables[0])[some[1:]]
    sampled = np.stack([table.filled[some] for table in tables]).astype(np.float64)
    mean = (sampled * weight).sum(axis=(1, 2, 3, 4), keepdims=True) / weight.sum() / 3
    rows = np.log(np.maximum(sampled, FLOOR * mean)) * np.sqrt(weight)
    rows = rows.reshape(n, -1)
    rows -= rows.mean(axis=0)
    _, vectors = np.linalg.eigh(rows @ rows.T)
    # The eigenvector left out is the constant one: what is centred has none of it
    basis = np.linalg.qr(np.concatenate([np.ones((n, 1)), vectors[:, :0:-1]], axis=1))[0][:, 1:]
    # The material that has most of a component has it positive
    return same_signs(basis) * math.sqrt(n)


@lru_cache(maxsize=4)
def _span(keys: tuple[str, ...], paths: tuple[str, ...], error: float) -> Span:
    tables = _tables(keys, paths)
    root = np.sqrt(_cell_weights(tables[0]).ravel()).astype(np.float32)
    members = np.concatenate([table.filled.reshape(3, -1) for table in tables])
    norms = np.linalg.norm(members * root, axis=1)
    norms = np.maximum(norms, 1e-12 * norms.max()).astype(np.float32)
    members /= norms[:, None]
    mean = members.mean(axis=0)
    size = float(np.linalg.norm(mean * root))
    lengths = (members * root) @ (mean * root) / size
    rest = members - lengths[:, None] * (mean / size)
    found = leading(rest * root, error, 3 * len(tables) - 1)
    mixing = found.mixing.astype(np.float32)
    components = np.concatenate([mean[None], mixing.T @ rest])
    # Orthogonal to each other under the weights, and of size one but for the mean
    own = np.concatenate([lengths[:, None] / size, (rest * root) @ ((rest * root).T @ mixing)], 1)
    shares = (own * norms[:, None]).astype(np.float64).reshape(len(tables), 3, -1)
    shape = tables[0].filled.shape[1:]
    return Span(
        closed(components.reshape(-1, *shape)),
        np.ascontiguousarray(np.moveaxis(shares, 1, 2)),
        found.errors,
        np.sqrt((own.astype(np.float64) ** 2).mean(axis=0)),
    )


def _tables(keys: tuple[str, ...], paths: tuple[str, ...]) -> list[ReflectanceTable]:
    tables = [find(key, path) for key, path in zip(keys, paths, strict=True)]
    shapes = {table.raw.shape[1:] for table in tables}
    if len(shapes) > 1:
        raise MeasurementError(
            "the tables of a space must have the same numbers of cells; got "
            + " and ".join(" x ".join(map(str, shape)) for shape in sorted(shapes))
        )
    return tables


def _cell_weights(table: ReflectanceTable) -> Float64:
    """cosθi cosθo and the solid angles of both directions: float64 [h, d, p], sum 1."""
    h, d, _ = (
        a.reshape(s)
        for a, s in zip(table.angles(), ((-1, 1, 1), (1, -1, 1), (1, 1, -1)), strict=True)
    )
    wi, wo = table.directions()
    weight = np.maximum(wi.z, 0) * np.maximum(wo.z, 0) * np.sin(h) * np.sqrt(h)
    weight = weight * np.sin(d) * np.cos(d)
    return np.asarray(weight / weight.sum())
