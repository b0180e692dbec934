"""The command line as users meet it: in a process of its own."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

NO_RAY_TRACER = """
import sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("mitsuba", "drjit"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Refuse())
"""
"""A sitecustomize module under which Mitsuba and Dr.Jit cannot be imported."""


@dataclass(frozen=True)
class Outcome:
    """What a command left behind."""

    code: int
    out: str
    err: str

    @property
    def complaint(self) -> str:
        """The one line of a refusal, checked to be nothing but that."""
        assert self.code == 2, (self.code, self.out, self.err)
        lines = self.err.splitlines()
        assert len(lines) == 1, self.err
        assert lines[0].startswith("burnish: ")
        return lines[0]


Runner = Callable[..., Outcome]


@pytest.fixture(scope="session")
def no_ray_tracer(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for PYTHONPATH that hides Mitsuba."""
    folder = tmp_path_factory.mktemp("no-ray-tracer")
    (folder / "sitecustomize.py").write_text(NO_RAY_TRACER)
    return folder


@pytest.fixture(scope="session")
def burnish(no_ray_tracer: Path) -> Runner:
    """Runs `burnish …` in a folder and gives its outcome.

    ray_tracer: whether Mitsuba can be imported. largest_file: bytes after which the system
    refuses to write on, as a full disk does.
    """

    def run(
        *arguments: object,
        cwd: Path,
        ray_tracer: bool = True,
        largest_file: int | None = None,
    ) -> Outcome:
        environment = dict(os.environ)
        if not ray_tracer:
            environment["PYTHONPATH"] = str(no_ray_tracer)

        def limit() -> None:
            if largest_file is not None:
                resource.setrlimit(resource.RLIMIT_FSIZE, (largest_file, largest_file))

        done = subprocess.run(
            [sys.executable, "-m", "burnish.app.cli", *map(str, arguments)],
            cwd=cwd,
            env=environment,
            capture_output=True,
            text=True,
            timeout=300,
            preexec_fn=limit,
            check=False,
        )
        return Outcome(done.returncode, done.stdout, done.stderr)

    return run


@pytest.fixture(scope="session")
def bundle(burnish: Runner, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small bundle of the Cornell box; not to be changed."""
    folder = tmp_path_factory.mktemp("bundle")
    baked = burnish(
        "bake", "cornell-box", "-o", "box.burnish", "--resolution", "24x24",
        "--series", "8,1,1", "--spp", "16", cwd=folder,
    )  # fmt: skip
    assert baked.code == 0, baked.err
    return folder / "box.burnish"


def contents(folder: Path) -> dict[str, int]:
    """Every file under a folder and its size, hidden ones too."""
    return {
        str(path.relative_to(folder)): path.stat().st_size if path.is_file() else -1
        for path in folder.rglob("*")
    }
