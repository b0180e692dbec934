"""The device is chosen, and a bad LLVM refused, before Dr.Jit can crash."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from burnish.core.errors import DeviceError, InvalidValue
from burnish.scene import device


@pytest.fixture
def no_llvm_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DRJIT_LIBLLVM_PATH", raising=False)
    monkeypatch.setattr(device, "_known_to_linker", lambda: iter(()))


@pytest.mark.parametrize(
    ("name", "version"),
    [
        ("libLLVM-14.0.6.so.1", 14),
        ("libLLVM-15.so", 15),
        ("libLLVM-19.so.1", 19),
        ("libLLVM.so.19.1", 19),
        ("libLLVM.so.20.1-rust", 20),
    ],
)
def test_version_is_read_from_the_name(tmp_path: Path, name: str, version: int) -> None:
    assert device.llvm_version(tmp_path / name) == version


def test_version_is_read_through_a_link(tmp_path: Path) -> None:
    (tmp_path / "libLLVM.so.17.0").touch()
    (tmp_path / "libLLVM.so").symlink_to("libLLVM.so.17.0")
    assert device.llvm_version(tmp_path / "libLLVM.so") == 17


def test_version_is_asked_of_a_library_whose_name_does_not_say(tmp_path: Path) -> None:
    real = device.find_llvm().resolve()
    (tmp_path / "libLLVM.so").hardlink_to(real) if _same_disk(real, tmp_path) else (
        tmp_path / "libLLVM.so"
    ).write_bytes(real.read_bytes())
    assert device.llvm_version(tmp_path / "libLLVM.so") == device.llvm_version(real)


def _same_disk(a: Path, b: Path) -> bool:
    return os.access(a, os.W_OK) and a.stat().st_dev == b.stat().st_dev


def test_something_else_by_that_name_has_no_version(tmp_path: Path) -> None:
    (tmp_path / "libLLVM.so").write_text("not a library")
    assert device.llvm_version(tmp_path / "libLLVM.so") == 0


@pytest.mark.usefixtures("no_llvm_elsewhere")
def test_the_newest_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    paths = [Path(f"libLLVM-{n}.so") for n in (9, 18, 16, 15)]
    monkeypatch.setattr(device, "_in_folders", lambda: iter(paths))
    assert device.find_llvm() == Path("libLLVM-18.so")


@pytest.mark.usefixtures("no_llvm_elsewhere")
@pytest.mark.parametrize("present", [[], [Path("libLLVM-15.so"), Path("libLLVM-14.so")]])
def test_without_a_usable_one_the_error_says_what_to_type(
    monkeypatch: pytest.MonkeyPatch, present: list[Path]
) -> None:
    monkeypatch.setattr(device, "_in_folders", lambda: iter(present))
    with pytest.raises(DeviceError) as caught:
        device.find_llvm()
    message = str(caught.value)
    for command in ("apt-get install libllvm19", "dnf install llvm-libs", "brew install llvm"):
        assert command in message
    assert "\n" not in message
    assert ("libLLVM-15.so" in message) == bool(present)


@pytest.mark.parametrize("name", ["libLLVM-15.so", "missing/libLLVM-19.so"])
def test_a_bad_path_in_the_environment_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str
) -> None:
    (tmp_path / "libLLVM-15.so").touch()
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(tmp_path / name))
    with pytest.raises(DeviceError, match="DRJIT_LIBLLVM_PATH"):
        device.find_llvm()


def test_loading_stops_before_an_old_llvm_can_crash(tmp_path: Path) -> None:
    (tmp_path / "libLLVM-15.so").touch()
    program = (
        "import burnish.scene\n"
        "from burnish.core.errors import DeviceError\n"
        "try: burnish.scene.load('cornell-box')\n"
        "except DeviceError as error: print('refused', error)\n"
    )
    answer = subprocess.run(
        [sys.executable, "-c", program],
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join(sys.path),
            "DRJIT_LIBLLVM_PATH": str(tmp_path / "libLLVM-15.so"),
            "BURNISH_VARIANT": "llvm_ad_rgb",
        },
        capture_output=True,
        text=True,
        check=True,
    )
    assert answer.stdout.startswith("refused")


@pytest.mark.parametrize("name", ["scalar_rgb", "llvm_ad_spectral", "gpu"])
def test_other_variants_are_refused(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    with pytest.raises(InvalidValue, match="variant must be one of"):
        device.activate(name)
    monkeypatch.setenv("BURNISH_VARIANT", name)
    with pytest.raises(InvalidValue, match="BURNISH_VARIANT must be one of"):
        device.activate()


def test_cuda_without_a_gpu_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device, "gpu_usable", lambda: False)
    with pytest.raises(DeviceError, match="needs an NVIDIA GPU"):
        device.activate("cuda_ad_rgb")
