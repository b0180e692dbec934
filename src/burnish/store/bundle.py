"""Reading a bundle: the header at once, tiles when they are first needed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import zarr

from burnish.core.errors import BundleError
from burnish.core.parallel import parallel_map
from burnish.core.types import Float32
from burnish.store.header import BundleHeader, Json, ViewHeader
from burnish.store.tiles import read_tile
from burnish.store.writer import read_header
from burnish.transport.basis import Basis
from burnish.transport.pack import Pack, TiledBlocks, join
from burnish.transport.rows import Rows
from burnish.transport.stack import Stack


class StoredView:
    """A view of a bundle: a `BlockSource` that reads its tiles on first use."""

    revision = 0

    def __init__(self, folder: Path, header: ViewHeader, basis: Basis) -> None:
        self.folder = folder
        self.header = header
        self.basis = basis

    @property
    def width(self) -> int:
        return self.header.width

    @property
    def height(self) -> int:
        return self.header.height

    @property
    def rows(self) -> Rows:
        return self._content.rows

    @property
    def base(self) -> Float32:
        return self._content.base

    @property
    def emission(self) -> Float32:
        return self._content.emission

    @cached_property
    def _content(self) -> TiledBlocks:
        """The view with its blocks laid out in stacks, and not as packs as well."""
        content = self._read()
        content.stacks()
        content.content = []
        return content

    def _read(self) -> TiledBlocks:
        tiles = parallel_map(
            read_tile, [self.folder / str(number) for number in range(len(self.header.tiles))]
        )
        return join(self.basis, self.width, self.height, tiles)

    def packs(self) -> Sequence[Pack]:
        """All blocks, read anew. Raises BundleError where a tile is damaged."""
        return self._read().packs()

    def stacks(self) -> Sequence[Stack]:
        """All blocks, as freezing and frames read them. Raises BundleError."""
        return self._content.stacks()


@dataclass(frozen=True)
class Bundle:
    """An opened bundle.

    >>> bundle = open_bundle("cornell.burnish")        # doctest: +SKIP
    >>> bundle.info()["series"]                        # doctest: +SKIP
    [64, 1, 1, 1]
    """

    path: Path
    header: BundleHeader
    views: Mapping[str, StoredView]

    @property
    def basis(self) -> Basis:
        return self.header.basis

    @cached_property
    def size(self) -> int:
        """Bytes on disk."""
        return sum(file.stat().st_size for file in self.path.rglob("*") if file.is_file())

    @property
    def preview(self) -> Float32 | None:
        """A small picture, float32 [h, w, 3], linear RGB, where the bundle has one."""
        array = zarr.open_group(self.path, mode="r", zarr_format=3).get("preview")
        return np.asarray(array[...], np.float32) if isinstance(array, zarr.Array) else None

    def info(self) -> Json:
        """What `burnish info --json` prints."""
        return self.header.info() | {"bytes": self.size}


def open_bundle(path: str | Path) -> Bundle:
    """Open a finished bundle; reads the header alone.

    Raises MissingFile, and BundleError when it is foreign, cut short or of a newer format.
    """
    path = Path(path)
    header = read_header(path)
    views = {}
    for view in header.views:
        folder = path / "views" / view.name
        for number in range(len(view.tiles)):
            if not (folder / str(number) / "zarr.json").is_file():
                raise BundleError(
                    f"{folder / str(number)}: missing or cut short; copy the bundle again, "
                    "or finish its bake with --resume"
                )
        views[view.name] = StoredView(folder, view, header.basis)
    return Bundle(path, header, views)
