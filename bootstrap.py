"""Set up burnish in a fresh clone: virtual environment, package, LLVM.

Standard library only, because it runs before anything is installed. `make` calls it and
leaves a stamp, so that it runs again only when this file or pyproject.toml has changed.
Where something must come from the system's package manager it is installed when we are
root on Debian or Ubuntu; otherwise the command to type is printed and nothing else happens.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
VENV = HERE / ".venv"
MINIMUM_PYTHON = (3, 11)
MINIMUM_LLVM = 16
"""Dr.Jit's kernels kill the process inside older LLVM releases ("Cannot select: fminimum")."""
ATOMIC = "libatomic.so.1"
"""GCC's atomics, which Dr.Jit is linked with; small Linux installations lack them."""
CHROMIUM_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


def say(message: str) -> None:
    """Report a step."""
    print(f"set-up: {message}", flush=True)


def stop(message: str) -> None:
    """End the set-up with a message for the user."""
    print(f"\nset-up stopped: {message}\n", file=sys.stderr)
    sys.exit(2)


def run(*command: str | Path) -> None:
    """Run a command quietly; on failure stop with its name and its last words."""
    result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    if result.returncode:
        words = "\n".join(result.stdout.splitlines()[-15:])
        stop(f"`{' '.join(str(word) for word in command)}` failed.\n{words}".rstrip())


# -- the system's package manager -----------------------------------------------------------


def can_apt() -> bool:
    """Whether packages can be installed here without asking anybody."""
    return shutil.which("apt-get") is not None and os.geteuid() == 0


def apt_install(*packages: str) -> None:
    """Install Debian packages without questions. Only where `can_apt`."""
    say(f"installing {' '.join(packages)} with apt")
    run("env", "DEBIAN_FRONTEND=noninteractive", "apt-get", "install", "-y", "-q",
        "--no-install-recommends", *packages)  # fmt: skip


def newest_llvm_package() -> str | None:
    """The Debian package of the newest LLVM that apt offers, such as libllvm19."""
    listing = subprocess.run(
        ["apt-cache", "pkgnames", "libllvm"], capture_output=True, text=True
    ).stdout
    versions = [int(n) for n in re.findall(r"^libllvm(\d+)(?:t64)?$", listing, re.MULTILINE)]
    newest = max(versions, default=0)
    if newest < MINIMUM_LLVM:
        return None
    name = f"libllvm{newest}"
    return name if name in listing.split() else f"{name}t64"


# -- steps --------------------------------------------------------------------------------


def check_python() -> None:
    """Stop when this Python is too old."""
    if sys.version_info < MINIMUM_PYTHON:
        stop(
            f"Python {'.'.join(map(str, MINIMUM_PYTHON))} or newer is needed; this is "
            f"{sys.version.split()[0]}. Install one and name it: make PYTHON=python3.12 …"
        )


def check_venv_module() -> None:
    """Debian splits `venv` and `ensurepip` off from Python."""
    if importlib.util.find_spec("ensurepip") and importlib.util.find_spec("venv"):
        return
    package = f"python{sys.version_info.major}.{sys.version_info.minor}-venv"
    if can_apt():
        run("apt-get", "update", "-q")
        apt_install(package)
        return
    stop(
        "this Python cannot make virtual environments. Type one of these, then make again:\n"
        f"  Debian, Ubuntu:  sudo apt-get install {package}\n"
        "  Fedora:          sudo dnf install python3-pip\n"
        "  macOS:           brew install python"
    )


def make_environment() -> None:
    """Create .venv and install the package into it, editable, with the developers' tools."""
    python = VENV / "bin" / "python"
    if not python.exists() or subprocess.run([python, "-m", "pip", "--version"],
                                             capture_output=True).returncode:  # fmt: skip
        say("making the virtual environment .venv")
        shutil.rmtree(VENV, ignore_errors=True)
        run(sys.executable, "-m", "venv", VENV)
    say("installing burnish and what it needs (the first time takes a minute or two)")
    run(python, "-m", "pip", "install", "-q", "--disable-pip-version-check",
        "-e", f"{HERE}[dev]")  # fmt: skip


def ensure_atomics() -> None:
    """Dr.Jit cannot even be imported without libatomic, and says so badly."""
    if not sys.platform.startswith("linux") or can_load(ATOMIC):
        return
    if can_apt():
        run("apt-get", "update", "-q")
        apt_install("libatomic1")
    if not can_load(ATOMIC):
        stop(
            f"the library {ATOMIC} is missing. Type one of these, then make again:\n"
            "  Debian, Ubuntu:  sudo apt-get update && sudo apt-get install libatomic1\n"
            "  Fedora:          sudo dnf install libatomic"
        )


def can_load(library: str) -> bool:
    """Whether the dynamic linker finds a library."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def device_problem() -> str:
    """Why the installed package finds no device to trace rays on; empty when it does."""
    question = (
        "from burnish.core.errors import BurnishError\n"
        "try:\n"
        "    from burnish.scene.device import find_llvm, gpu_usable\n"
        "    gpu_usable() or find_llvm()\n"
        "except BurnishError as error:\n"
        "    print(error)\n"
    )
    answer = subprocess.run(
        [VENV / "bin" / "python", "-c", question], capture_output=True, text=True
    )
    if answer.returncode:
        stop(f"Mitsuba cannot be imported.\n{answer.stderr.rstrip()}")
    return answer.stdout.strip()


def ensure_device() -> None:
    """Mitsuba compiles for the CPU with LLVM; a machine with CUDA can do without."""
    if not device_problem():
        return
    if can_apt():
        run("apt-get", "update", "-q")
        package = newest_llvm_package()
        if package:
            apt_install(package)
    problem = device_problem()
    if problem:
        stop(
            f"{problem}.\nThen make again. Where apt has no package of that name, take the newest "
            "that `apt-cache pkgnames libllvm` lists; where the library lies somewhere unusual, "
            "set DRJIT_LIBLLVM_PATH to its file."
        )


def ensure_browser() -> None:
    """Chromium serves the browser tests alone, so that doing without is no failure."""
    if any(shutil.which(name) for name in CHROMIUM_NAMES):
        return
    if can_apt():
        say("installing chromium with apt for the browser tests")
        installed = subprocess.run(
            "apt-get update -q && DEBIAN_FRONTEND=noninteractive "
            "apt-get install -y -q --no-install-recommends chromium",
            shell=True, capture_output=True,
        )  # fmt: skip
        if not installed.returncode:
            return
    say("no Chromium: the browser tests will be skipped (Debian: sudo apt-get install chromium)")


def main() -> None:
    """Set up everything, or with --browser what the browser tests need."""
    if "--browser" in sys.argv[1:]:
        ensure_browser()
        return
    check_python()
    check_venv_module()
    ensure_atomics()
    make_environment()
    ensure_device()
    say("done")


if __name__ == "__main__":
    main()
