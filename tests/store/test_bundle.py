"""Bundles: what was written is what is read, and damage is told in one line."""

from __future__ import annotations

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from burnish.core.errors import (
    BundleError,
    CannotWrite,
    InvalidValue,
    MissingFile,
    UnknownName,
)
from burnish.materials.lights import Light, LightGroup, LightState
from burnish.runtime.freeze import freeze
from burnish.runtime.renderer import Renderer
from burnish.store import BundleHeader, BundleWriter, ObjectHeader, ViewHeader, open_bundle
from burnish.store import writer as writer_module
from burnish.store.writer import partial_path
from burnish.transport.basis import initial_state
from burnish.transport.block import Tile
from tests.runtime.worlds import basis_of, plain_image, random_world

WIDTH, HEIGHT = 20, 12


def header_of(series: tuple[int, ...] = (6, 1, 1)) -> BundleHeader:
    basis = basis_of(series)
    rectangles = ((0, 0, 10, HEIGHT), (10, 0, 10, HEIGHT))
    return BundleHeader(
        basis=basis,
        views=(ViewHeader("front", WIDTH, HEIGHT, rectangles, {"fov": 40.0}),),
        objects=(
            *(ObjectHeader(item.id, True) for item in basis.objects),
            ObjectHeader("lens", False, "dielectric cannot be edited"),
        ),
        provenance={"seed": 3, "samples": 16},
        name="test",
    )


def tiles_of(header: BundleHeader) -> list[Tile]:
    return [tile for tile, _ in random_world(header.basis, WIDTH, HEIGHT)[1]]


def written(path: Path) -> BundleHeader:
    header = header_of()
    writer = BundleWriter.create(path, header)
    for number, tile in enumerate(tiles_of(header)):
        writer.write_tile("front", number, tile)
    writer.close(preview=np.full((3, 5, 3), 0.5, np.float32))
    return header


def test_a_bundle_reads_as_it_was_written(tmp_path: Path) -> None:
    header = written(tmp_path / "a.burnish")
    bundle = open_bundle(tmp_path / "a.burnish")
    assert bundle.header.to_json() == header.to_json()
    assert bundle.preview is not None
    assert bundle.preview.shape == (3, 5, 3)
    assert not partial_path(tmp_path / "a.burnish").exists()
    source, tiles = random_world(header.basis, WIDTH, HEIGHT)
    view = bundle.views["front"]
    assert (view.width, view.height) == (WIDTH, HEIGHT)
    for name in vars(source.rows):
        np.testing.assert_array_equal(getattr(view.rows, name), getattr(source.rows, name))
    np.testing.assert_array_equal(view.base, source.base)
    np.testing.assert_array_equal(view.emission, source.emission)
    state = initial_state(bundle.basis.objects)
    image = Renderer(freeze(view, (0,), state)).image(state)
    expected = plain_image(header.basis, tiles, state, WIDTH, HEIGHT)
    np.testing.assert_allclose(image, expected, rtol=2e-5)


def test_info_lists_what_can_be_edited(tmp_path: Path) -> None:
    written(tmp_path / "a.burnish")
    info = json.loads(json.dumps(open_bundle(tmp_path / "a.burnish").info()))
    assert [item["id"] for item in info["objects"]] == ["box", "floor", "lid", "lens"]
    assert info["objects"][3] == {
        "id": "lens",
        "editable": False,
        "reason": "dielectric cannot be edited",
    }
    exponent = info["objects"][0]["layers"][1]["parameters"]["exponent"]
    assert exponent == {"value": 20.0, "min": 1.0, "max": 5000.0, "unit": ""}
    assert info["series"] == [6, 1, 1]
    assert info["bounces"] == 3
    assert info["resolution"] == [WIDTH, HEIGHT]
    assert info["bytes"] > 0


def test_a_bake_can_be_resumed(tmp_path: Path) -> None:
    header, path = header_of(), tmp_path / "a.burnish"
    tiles = tiles_of(header)
    BundleWriter.create(path, header).write_tile("front", 1, tiles[1])
    assert not path.exists()
    writer = BundleWriter.resume(path)
    assert writer.header.to_json() == header.to_json()
    assert writer.finished("front") == {1}
    with pytest.raises(BundleError, match="1 of 2 tiles of view front are missing"):
        writer.close()
    writer.write_tile("front", 0, tiles[0])
    writer.close()
    assert open_bundle(path).views["front"].rows.pixel.size
    with pytest.raises(BundleError, match="already finished"):
        BundleWriter.resume(path)


def test_an_old_bundle_stays_until_the_new_one_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.burnish"
    written(path)
    header = header_of((6, 1))
    writer = BundleWriter.create(path, header)
    assert open_bundle(path).basis.series == (6, 1, 1)
    with pytest.raises(BundleError, match="--resume"):
        BundleWriter.create(path, header)
    for number, tile in enumerate(tiles_of(header)):
        writer.write_tile("front", number, tile)
    writer.close()
    assert open_bundle(path).basis.series == (6, 1)
    assert os.listdir(tmp_path) == ["a.burnish"]


def test_kill_while_writing_loses_at_most_the_tile_in_work(tmp_path: Path) -> None:
    path = tmp_path / "a.burnish"
    program = """
        import sys
        from pathlib import Path
        from tests.store.test_bundle import header_of, tiles_of
        from burnish.store import BundleWriter
        header = header_of()
        tiles = tiles_of(header)
        writer = BundleWriter.create(Path(sys.argv[1]), header)
        writer.write_tile("front", 0, tiles[0])
        print("one", flush=True)
        while True:
            writer.write_tile("front", 1, tiles[1])
    """
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(program), str(path)],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(["src", ".", *sys.path])},
    )
    assert process.stdout is not None
    with process.stdout:
        assert process.stdout.readline() == b"one\n"
        time.sleep(0.1)
        process.send_signal(signal.SIGKILL)
        process.wait()
    writer = BundleWriter.resume(path)
    assert writer.finished("front") >= {0}
    tiles = tiles_of(writer.header)
    for number in {0, 1} - writer.finished("front"):
        writer.write_tile("front", number, tiles[number])
    writer.close()
    view = open_bundle(path).views["front"]
    source, _ = random_world(writer.header.basis, WIDTH, HEIGHT)
    np.testing.assert_array_equal(view.base, source.base)
    assert [len(pack.rows) for pack in view.packs()] == [len(pack.rows) for pack in source.packs()]


def test_foreign_newer_and_damaged_bundles(tmp_path: Path) -> None:
    path = tmp_path / "a.burnish"
    with pytest.raises(MissingFile, match="no such bundle"):
        open_bundle(path)
    path.write_text("not a folder")
    with pytest.raises(BundleError, match="not a burnish bundle"):
        open_bundle(path)
    with pytest.raises(BundleError, match="choose another name"):
        BundleWriter.create(path, header_of())
    path.unlink()
    written(path)
    text = (path / "zarr.json").read_text()

    def rewrite(change: str, value: object) -> None:
        data = json.loads(text)
        data["attributes"]["burnish"][change] = value
        (path / "zarr.json").write_text(json.dumps(data))

    rewrite("format_version", 99)
    with pytest.raises(BundleError, match="install a newer burnish"):
        open_bundle(path)
    rewrite("format", "zebra")
    with pytest.raises(BundleError, match="not a burnish bundle"):
        open_bundle(path)
    rewrite("views", [{}])
    with pytest.raises(BundleError, match="header is damaged"):
        open_bundle(path)
    (path / "zarr.json").write_text(text[: len(text) // 2])
    with pytest.raises(BundleError, match="cut short"):
        open_bundle(path)
    (path / "zarr.json").write_text(text)
    shutil.rmtree(path / "views" / "front" / "1")
    with pytest.raises(BundleError, match="missing or cut short"):
        open_bundle(path)


@pytest.mark.parametrize("damage", ["missing", "short", "flipped"])
def test_a_damaged_chunk_never_reads_as_darkness(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "a.burnish"
    written(path)
    chunk = next((path / "views" / "front" / "0" / "core" / "c").rglob("0"))
    data = bytearray(chunk.read_bytes())
    if damage == "missing":
        chunk.unlink()
    elif damage == "short":
        chunk.write_bytes(data[: len(data) // 2])
    else:
        data[len(data) // 2] ^= 1
        chunk.write_bytes(data)
    view = open_bundle(path).views["front"]
    with pytest.raises(BundleError, match="bake the scene again"):
        view.packs()


def test_a_full_disk_is_told_and_what_was_finished_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    header, path = header_of(), tmp_path / "a.burnish"
    tiles = tiles_of(header)
    writer = BundleWriter.create(path, header)
    writer.write_tile("front", 0, tiles[0])

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(writer_module, "write_tile", full)
    with pytest.raises(CannotWrite, match=r"disk is full.*--resume"):
        writer.write_tile("front", 1, tiles[1])
    assert BundleWriter.resume(path).finished("front") == {0}


def test_wrong_tiles_are_refused(tmp_path: Path) -> None:
    header = header_of()
    tiles = tiles_of(header)
    writer = BundleWriter.create(tmp_path / "a.burnish", header)
    with pytest.raises(UnknownName, match="front"):
        writer.write_tile("frnt", 0, tiles[0])
    with pytest.raises(InvalidValue, match=r"\[0, 1\]"):
        writer.write_tile("front", 2, tiles[0])
    with pytest.raises(InvalidValue, match="must cover"):
        writer.write_tile("front", 1, tiles[0])
    with pytest.raises(MissingFile, match="create it first"):
        BundleWriter.create(tmp_path / "no" / "a.burnish", header)


def test_a_bundle_opens_and_edits_without_a_ray_tracer(tmp_path: Path) -> None:
    path = tmp_path / "a.burnish"
    written(path)
    program = """
        import sys

        class Block:
            def find_spec(self, name, *_):
                if name.split(".")[0] in ("mitsuba", "drjit"):
                    raise ImportError(name + " is blocked")

        sys.meta_path.insert(0, Block())
        from burnish.session import Session
        from burnish.store import open_bundle
        bundle = open_bundle(sys.argv[1])
        session = Session(bundle.views, name="test")
        before = session.frame()
        session.set("box.specular.exponent", 200.0)
        assert (session.frame() != before).any()
        assert not {"mitsuba", "drjit"} & set(sys.modules)
    """
    subprocess.run(
        [sys.executable, "-W", "error", "-c", textwrap.dedent(program), str(path)],
        check=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(["src", *sys.path])},
    )


def test_light_groups_read_as_they_were_written(tmp_path: Path) -> None:
    plain = header_of()
    groups = (LightGroup("key", ("lamp", "spot")), LightGroup("sky", ("sky",)))
    header = replace(
        plain,
        basis=replace(plain.basis, lights=groups),
        lights=(Light("lamp", "area"), Light("spot", "spot"), Light("sky", "constant")),
    )
    writer = BundleWriter.create(tmp_path / "a.burnish", header)
    for number, tile in enumerate(tiles_of(header)):
        writer.write_tile("front", number, tile)
    writer.close()
    bundle = open_bundle(tmp_path / "a.burnish")
    assert bundle.header.to_json() == header.to_json()
    assert (bundle.basis.lights, bundle.header.lights) == (groups, header.lights)
    view, (source, tiles) = bundle.views["front"], random_world(header.basis, WIDTH, HEIGHT)
    np.testing.assert_array_equal(view.base, source.base)
    state = initial_state(bundle.basis.objects) | {"light:sky": LightState(intensity=3.0)}
    image = Renderer(freeze(view, (), state)).image(state)
    expected = plain_image(header.basis, tiles, state, WIDTH, HEIGHT)
    np.testing.assert_allclose(image, expected, rtol=3e-3)


def test_bundles_without_light_groups_are_those_of_the_first_format() -> None:
    said = header_of().to_json()
    assert said["format_version"] == 1
    for newer in ("lights", "light_groups"):
        del said[newer]
    header = BundleHeader.from_json(said, "an old bundle")
    assert (header.basis.lights, header.lights) == ((), ())
    grouped = replace(header.basis, lights=(LightGroup("key", ("lamp",)),))
    assert replace(header, basis=grouped).to_json()["format_version"] == 2
