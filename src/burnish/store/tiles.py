"""One tile as a Zarr group: a handful of flat arrays, each in one checked chunk."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from zarr.codecs import BloscCodec, Crc32cCodec

from burnish.core.errors import BundleError
from burnish.core.types import AnyArray
from burnish.transport.block import Tile
from burnish.transport.pack import Pack, packs_of
from burnish.transport.rows import Rows

_ARRAYS = (
    "rows_index",
    "rows_geometry",
    "rows_spread",
    "blocks",
    "block_rows",
    "column_scale",
    "U",
    "core",
    "S",
    "fixed",
    "emission",
)


def write_tile(folder: Path, tile: Tile) -> None:
    """Write a tile as a new Zarr group. Raises OSError.

    rows_index: int32 [r, 3], pixel, object, indirect. rows_geometry: float32 [r, 10],
    weight, position, normal, uv, cos_theta_o. rows_spread: float16 [fine rows, points, 2].
    blocks: int32 [k, 7], object, indirect,
    first column, r, a, b, columns, pack after pack; the blocks' numbers follow in that
    order in block_rows, column_scale (once per pack), U, core and S as `Pack` has them,
    flattened.
    """
    rows, packs = tile.rows, packs_of(tile.blocks)
    geometry = np.column_stack([rows.weight, rows.position, rows.normal, rows.uv, rows.cos_theta_o])
    arrays: dict[str, AnyArray] = {
        "rows_index": np.column_stack([rows.pixel, rows.object, rows.indirect]).astype(np.int32),
        "rows_geometry": geometry.astype(np.float32),
        "rows_spread": rows.spread[~rows.indirect].astype(np.float16),
        "blocks": _concatenated([_table(pack) for pack in packs], np.int32).reshape(-1, 7),
        "block_rows": _concatenated([pack.rows for pack in packs], np.int32),
        "column_scale": _concatenated([pack.column_scale for pack in packs], np.float32),
        "U": _concatenated([pack.U for pack in packs], np.float32),
        "core": _concatenated([pack.core for pack in packs], np.float16),
        "S": _concatenated([_narrow(pack) for pack in packs], np.float16),
        "fixed": tile.fixed.astype(np.float32),
        "emission": tile.emission.astype(np.float32),
    }
    attributes = {
        "x": tile.x,
        "y": tile.y,
        "width": tile.width,
        "height": tile.height,
        "samples": tile.samples,
        "lost": tile.lost,
        "tails": int(packs[0].S.shape[1]) if packs else 0,
    }
    group = zarr.create_group(folder, zarr_format=3, attributes=attributes)
    for name in _ARRAYS:
        data = arrays[name]
        codec = BloscCodec(
            typesize=data.dtype.itemsize, cname="zstd", clevel=3, shuffle="bitshuffle"
        )
        stored = group.create_array(
            name,
            shape=data.shape,
            chunks=tuple(max(n, 1) for n in data.shape),
            dtype=data.dtype,
            compressors=[codec, Crc32cCodec()],
            config={"write_empty_chunks": True},
        )
        if data.size:
            stored[...] = data


def read_tile(folder: Path) -> tuple[Tile, list[Pack]]:
    """A tile without its blocks, and the blocks as packs. Raises BundleError."""
    try:
        group = zarr.open_group(folder, mode="r", zarr_format=3)
        # Bundles of earlier versions know the rows' mean alone
        names = [name for name in _ARRAYS if name != "rows_spread" or name in group]
        a = {name: _read(group, name, folder) for name in names}
        attributes: dict[str, Any] = dict(group.attrs)
        index, geometry = a["rows_index"], a["rows_geometry"]
        rows = Rows(
            pixel=np.ascontiguousarray(index[:, 0]),
            object=np.ascontiguousarray(index[:, 1]),
            indirect=index[:, 2].astype(np.bool_),
            weight=np.ascontiguousarray(geometry[:, 0]),
            position=geometry[:, 1:4],
            normal=geometry[:, 4:7],
            uv=geometry[:, 7:9],
            cos_theta_o=np.ascontiguousarray(geometry[:, 9]),
        )
        if "rows_spread" in a:
            rows.spread[~rows.indirect] = a["rows_spread"]
        tile = Tile(
            x=attributes["x"],
            y=attributes["y"],
            width=attributes["width"],
            height=attributes["height"],
            rows=rows,
            blocks=[],
            fixed=a["fixed"],
            emission=a["emission"],
            samples=attributes["samples"],
            lost=attributes["lost"],
        )
        return tile, _packs(a, int(attributes["tails"]))
    except BundleError:
        raise
    except Exception as error:  # noqa: BLE001
        # Whatever Zarr and its codecs raise on damaged bytes; they share no base class
        raise BundleError(
            f"{folder}: this tile of the bundle is damaged "
            f"({type(error).__name__}: {error}); bake the scene again"
        ) from None


def _read(group: zarr.Group, name: str, folder: Path) -> AnyArray:
    """One array. A missing chunk must not read as zeros."""
    array = group[name]
    if not isinstance(array, zarr.Array):
        raise BundleError(f"{folder}: {name} is no array; bake the scene again")
    chunk = folder / name / array.metadata.encode_chunk_key((0,) * array.ndim)
    if array.size and not chunk.is_file():
        raise BundleError(f"{chunk}: missing from the bundle; bake the scene again")
    return np.asarray(array[...])


def _table(pack: Pack) -> AnyArray:
    """int32 [blocks, 7] of a pack."""
    count = len(pack.shape)
    fixed = np.broadcast_to([pack.object, pack.indirect, pack.start], (count, 3))
    columns = np.full((count, 1), len(pack.column_scale))
    return np.concatenate([fixed, pack.shape, columns], axis=1).astype(np.int32)


def _narrow(pack: Pack) -> AnyArray:
    """S in the core's precision: its rows have unit length, which half precision holds."""
    return pack.S.astype(pack.core.dtype)


def _concatenated(parts: list[AnyArray], empty: type[np.generic]) -> AnyArray:
    return np.concatenate([part.ravel() for part in parts]) if parts else np.zeros(0, empty)


def _packs(a: dict[str, AnyArray], tails: int) -> list[Pack]:
    """Cut the flat arrays into packs; views, not copies."""
    table = a["blocks"]
    changes = np.diff(table[:, :3], axis=0).any(axis=1)
    cuts = [0, *(np.flatnonzero(changes) + 1).tolist(), len(table)]
    at = dict.fromkeys(("block_rows", "column_scale", "U", "core", "S"), 0)

    def take(name: str, count: int) -> AnyArray:
        start = at[name]
        at[name] = start + count
        return a[name][start : start + count]

    packs = []
    for first, last in pairwise(cuts):
        if first == last:
            continue
        shape = np.ascontiguousarray(table[first:last, 3:6])
        r, p, q = shape.T.astype(np.int64)
        columns, cells = int(table[first, 6]), int((p * q).sum())
        packs.append(
            Pack(
                object=int(table[first, 0]),
                indirect=bool(table[first, 1]),
                shape=shape,
                rows=take("block_rows", int(r.sum())),
                U=take("U", int((r * p).sum())),
                core=take("core", 3 * columns * cells).reshape(3, columns, cells),
                S=take("S", int(q.sum()) * tails).reshape(-1, tails),
                column_scale=take("column_scale", columns),
                start=int(table[first, 2]),
            )
        )
    return packs
