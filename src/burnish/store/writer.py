"""Writing a bundle so that a crash loses no more than the tile in work.

A bake grows in a folder beside the bundle, `NAME.partial`. Each tile is written next to
its place and moved there when it is whole; the bundle itself appears, whole, on `close`.
"""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import zarr

from burnish.core.errors import BundleError, CannotWrite, InvalidValue, MissingFile, UnknownName
from burnish.core.types import Float32
from burnish.store.header import BundleHeader
from burnish.store.tiles import write_tile
from burnish.transport.block import Tile

_FRESH = "fresh-"


def partial_path(path: str | Path) -> Path:
    """Where the bundle of that path grows."""
    path = Path(path)
    return path.with_name(path.name + ".partial")


class BundleWriter:
    """Adds finished tiles to a bundle in work.

    >>> writer = BundleWriter.create("cornell.burnish", header)   # doctest: +SKIP
    >>> for number in range(len(header.views[0].tiles)):          # doctest: +SKIP
    ...     if number not in writer.finished("view"):
    ...         writer.write_tile("view", number, trace(number))
    >>> writer.close()                                            # doctest: +SKIP
    """

    def __init__(self, path: Path, header: BundleHeader) -> None:
        self.path = path
        self.header = header
        self._folder = partial_path(path)

    @staticmethod
    def create(path: str | Path, header: BundleHeader, overwrite: bool = False) -> BundleWriter:
        """Begin a bundle. One that exists at `path` is replaced on `close`, not before.

        overwrite: throw an unfinished bake of the same path away. Raises MissingFile when
        the folder does not exist, BundleError for an unfinished bake or when `path` is
        something else than a bundle, CannotWrite.
        """
        path = Path(path)
        folder = partial_path(path)
        if not path.parent.is_dir():
            raise MissingFile(f"{path.parent}: this folder does not exist; create it first")
        if path.exists() and not _is_bundle(path):
            raise BundleError(f"{path}: exists and is not a bundle; choose another name")
        if folder.exists() and not overwrite:
            raise BundleError(
                f"{folder}: an unfinished bake; continue it with --resume or delete it"
            )
        writer = BundleWriter(path, header)
        with _writing(folder):
            if folder.exists():
                shutil.rmtree(folder)
            fresh = folder.with_name(f".{folder.name}-{os.getpid()}")
            group = zarr.create_group(fresh, zarr_format=3)
            for view in header.views:
                group.create_group(f"views/{view.name}")
            # The header goes last: a folder that has one is a bake that can be resumed
            group.attrs["burnish"] = header.to_json()
            os.replace(fresh, folder)
        return writer

    @staticmethod
    def resume(path: str | Path) -> BundleWriter:
        """Go on with an unfinished bundle. Raises MissingFile, BundleError."""
        path = Path(path)
        folder = partial_path(path)
        if not folder.exists():
            if path.exists():
                raise BundleError(f"{path}: already finished; there is nothing to resume")
            raise MissingFile(f"{folder}: no unfinished bake there; start one without --resume")
        return BundleWriter(path, read_header(folder))

    def finished(self, view: str) -> set[int]:
        """Numbers of the tiles that are whole."""
        folder = self._view_folder(view)
        return {int(item.name) for item in folder.iterdir() if item.name.isdigit()}

    def write_tile(self, view: str, number: int, tile: Tile) -> None:
        """Add a tile; it counts once it is whole. A tile written twice is replaced.

        Raises UnknownName, InvalidValue when number or rectangle are not the header's, and
        CannotWrite when the disk is full; what was finished stays.
        """
        folder = self._view_folder(view)
        tiles = next(item.tiles for item in self.header.views if item.name == view)
        if not 0 <= number < len(tiles):
            raise InvalidValue(f"tile number must lie in [0, {len(tiles) - 1}]; got {number}")
        if tiles[number] != (tile.x, tile.y, tile.width, tile.height):
            raise InvalidValue(
                f"tile {number} of view {view} must cover {tiles[number]}; "
                f"got {(tile.x, tile.y, tile.width, tile.height)}"
            )
        fresh, old = folder / f"{_FRESH}{number}", folder / f"{_FRESH}{number}-old"
        place = folder / str(number)
        with _writing(self._folder):
            for stale in (fresh, old):
                if stale.exists():
                    shutil.rmtree(stale)
            write_tile(fresh, tile)
            # A folder with a number is whole at any moment: renames are atomic, removals not
            if place.exists():
                os.replace(place, old)
            os.replace(fresh, place)
            if old.exists():
                shutil.rmtree(old)

    def close(self, preview: Float32 | None = None) -> None:
        """Finish the bundle and move it into place.

        preview: float32 [h, w, 3], linear RGB, a small picture of it. Raises BundleError
        while tiles are missing, CannotWrite.
        """
        for view in self.header.views:
            missing = set(range(len(view.tiles))) - self.finished(view.name)
            if missing:
                raise BundleError(
                    f"{self._folder}: {len(missing)} of {len(view.tiles)} tiles of view "
                    f"{view.name} are missing; continue the bake with --resume"
                )
        with _writing(self._folder):
            for stale in self._folder.glob(f"views/*/{_FRESH}*"):
                shutil.rmtree(stale)
            if preview is not None:
                group = zarr.open_group(self._folder, mode="r+", zarr_format=3)
                group.create_array("preview", data=preview.astype(np.float16), overwrite=True)
            if self.path.exists():
                aside = self.path.with_name(f".{self.path.name}-{os.getpid()}")
                os.replace(self.path, aside)
                os.replace(self._folder, self.path)
                shutil.rmtree(aside)
            else:
                os.replace(self._folder, self.path)

    def _view_folder(self, view: str) -> Path:
        names = [item.name for item in self.header.views]
        if view not in names:
            raise UnknownName("view", view, names)
        return self._folder / "views" / view


def read_header(folder: Path) -> BundleHeader:
    """The header of a bundle, finished or not. Raises MissingFile, BundleError."""
    if not folder.exists():
        raise MissingFile(f"{folder}: no such bundle")
    try:
        attributes = json.loads((folder / "zarr.json").read_text("utf-8"))["attributes"]
    except (OSError, ValueError, KeyError, TypeError):
        raise BundleError(
            f"{folder}: not a burnish bundle, or one cut short; make one with `burnish bake`"
        ) from None
    header = attributes.get("burnish") if isinstance(attributes, dict) else None
    return BundleHeader.from_json(header, str(folder))


def _is_bundle(path: Path) -> bool:
    try:
        read_header(path)
    except MissingFile:
        return False
    except BundleError as error:
        # A bundle of a newer format or with a damaged header is a bundle all the same
        return "not a burnish bundle" not in str(error)
    return True


@contextmanager
def _writing(folder: Path) -> Iterator[None]:
    """Turn the system's complaints into one that says what to do."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise CannotWrite(
                f"{folder}: the disk is full; free some space and continue with --resume"
            ) from error
        raise CannotWrite(f"{folder}: cannot be written ({error.strerror or error})") from error
