"""Which Mitsuba variant renders, and the LLVM library that it needs.

Dr.Jit compiles through libLLVM. With version 15 or older it dies inside LLVM in a way
that no `except` catches, so the library is found and its version known *before* a
variant is set; the library itself is never opened in this process to find out.
"""

from __future__ import annotations

import ctypes
import ctypes.util
import glob
import os
import re
import subprocess
import sys
import sysconfig
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from burnish.core.errors import DeviceError, InvalidValue

VARIANTS = ("llvm_ad_rgb", "cuda_ad_rgb")
OLDEST_LLVM = 16

_INSTALL = (
    "sudo apt-get install libllvm19 (Debian/Ubuntu), sudo dnf install llvm-libs (Fedora), "
    "brew install llvm (macOS)"
)

# Prints the major version of the library named on the command line, or 0: LLVMGetVersion
# came with LLVM 16. It runs in a child process, because loading may crash.
_PROBE = """
import ctypes, sys
library = ctypes.CDLL(sys.argv[1])
if not hasattr(library, "LLVMGetVersion"):
    print(0)
else:
    major = ctypes.c_uint()
    library.LLVMGetVersion(ctypes.byref(major), None, None)
    print(major.value)
"""


def activate(variant: str | None = None) -> str:
    """Set Mitsuba's variant, and return its name.

    variant: "llvm_ad_rgb" or "cuda_ad_rgb"; without it the environment's BURNISH_VARIANT,
    then a variant that is active already, then CUDA where a GPU is usable, then LLVM.
    Raises DeviceError when the machine lacks what the variant needs, InvalidValue for any
    other variant.
    """
    import mitsuba as mi

    active: str | None = mi.variant()
    wanted = variant or os.environ.get("BURNISH_VARIANT") or None
    if wanted is None and active in VARIANTS:
        return str(active)
    name = wanted or ("cuda_ad_rgb" if gpu_usable() else "llvm_ad_rgb")
    if name not in VARIANTS:
        where = "variant" if variant else "BURNISH_VARIANT"
        raise InvalidValue(f"{where} must be one of {', '.join(VARIANTS)}; got {name!r}")
    if name == active:
        return name
    if name == "cuda_ad_rgb" and not gpu_usable():
        raise DeviceError(
            "variant cuda_ad_rgb needs an NVIDIA GPU with its driver (libcuda and OptiX), and "
            "none is usable here; leave the variant out to render on the CPU"
        )
    if name == "llvm_ad_rgb":
        os.environ["DRJIT_LIBLLVM_PATH"] = str(find_llvm())
    mi.set_variant(name)
    return name


@cache
def gpu_usable() -> bool:
    """Whether a CUDA device, its driver and the OptiX library are there."""
    try:
        cuda = ctypes.CDLL("libcuda.so.1")
        ctypes.CDLL("libnvoptix.so.1")
    except OSError:
        return False
    count = ctypes.c_int()
    return bool(
        cuda.cuInit(0) == 0 and cuda.cuDeviceGetCount(ctypes.byref(count)) == 0 and count.value
    )


def find_llvm() -> Path:
    """The newest LLVM library, version 16 or later.

    DRJIT_LIBLLVM_PATH, where it is set, is taken or refused, never passed over.
    Raises DeviceError, saying what to type, when there is none.
    """
    chosen = os.environ.get("DRJIT_LIBLLVM_PATH")
    if chosen:
        path = Path(chosen)
        if path.parent != Path() and not path.exists():
            raise DeviceError(
                f"DRJIT_LIBLLVM_PATH names {chosen!r}, which does not exist; unset it, or let it "
                "name a libLLVM of version 16 or newer"
            )
        version = llvm_version(path)
        if version < OLDEST_LLVM:
            raise DeviceError(
                f"DRJIT_LIBLLVM_PATH names {chosen!r}, which is {_called(version)}; version "
                f"{OLDEST_LLVM} or newer is needed. Unset it, or install one: {_INSTALL}"
            )
        return path
    found: list[tuple[int, Path]] = []
    for candidates in (_in_folders(), _known_to_linker()):
        found += [(llvm_version(path), path) for path in candidates]
        version, path = max(found, key=lambda item: item[0], default=(0, Path()))
        if version >= OLDEST_LLVM:
            return path
    newest = f"the newest here is {path}" if found else "there is none here"
    raise DeviceError(
        f"the LLVM library, version {OLDEST_LLVM} or newer, is needed and {newest}; "
        f"install it: {_INSTALL}"
    )


def llvm_version(path: Path) -> int:
    """An LLVM library's major version; 0 when it is not known or older than 16."""
    for name in (path.name, path.resolve().name):
        match = re.search(r"(?:libLLVM-|libLLVM\.so\.|libLLVM\.)(\d+)", name)
        if match:
            return int(match[1])
    try:
        answer = subprocess.run(
            [sys.executable, "-c", _PROBE, str(path)], capture_output=True, timeout=60, check=False
        )
        return int(answer.stdout or 0)
    except (OSError, ValueError, subprocess.TimeoutExpired):
        return 0


def _called(version: int) -> str:
    return f"version {version}" if version else "older than 16 or no LLVM library"


def _in_folders() -> Iterator[Path]:
    """LLVM libraries in the places where Linux and macOS keep them, each file once."""
    triple = sysconfig.get_config_var("MULTIARCH") or ""
    folders = [
        *os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep),
        *os.environ.get("DYLD_LIBRARY_PATH", "").split(os.pathsep),
        str(Path(sys.prefix) / "lib"),
        f"/usr/lib/{triple}",
        "/usr/lib64",
        "/usr/lib",
        "/usr/local/lib",
        "/usr/lib/llvm*/lib",
        "/usr/lib64/llvm*/lib",
        "/usr/local/opt/llvm*/lib",
        "/opt/homebrew/opt/llvm*/lib",
        "/opt/local/libexec/llvm-*/lib",
    ]
    seen: set[Path] = set()
    for folder in filter(None, folders):
        for name in ("libLLVM*.so*", "libLLVM*.dylib"):
            for text in sorted(glob.glob(f"{folder}/{name}")):
                path = Path(text)
                if path.exists() and path.resolve() not in seen:
                    seen.add(path.resolve())
                    yield path


def _known_to_linker() -> Iterator[Path]:
    """LLVM libraries that the dynamic linker finds by name, wherever they lie."""
    for name in ("LLVM", *(f"LLVM-{version}" for version in range(OLDEST_LLVM, 31))):
        known = ctypes.util.find_library(name)
        if known:
            yield Path(known)
