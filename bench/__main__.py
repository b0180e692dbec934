"""Run the benchmarks and write one report.

python -m bench [NAME …] [--quick] [--output build/bench]
"""

from __future__ import annotations

import argparse
import json
import platform
import time
from dataclasses import replace
from importlib import import_module
from pathlib import Path

from burnish.core.parallel import core_count
from burnish.core.version import __version__

BENCHES = {
    "bake-rate": "bench.bake_rate",
    "table": "bench.table",
    "direct": "bench.direct",
    "bundle-size": "bench.bundle_size",
    "equal-error": "bench.equal_error",
    "runtime": "bench.runtime",
    "incremental": "bench.incremental",
    "live": "bench.live",
    "live-drag": "bench.live_drag",
    "relight": "bench.relight",
    "editor": "bench.editor",
}


def main() -> None:
    """Measure, print each section as it is done, and write report.md and report.json."""
    parser = argparse.ArgumentParser(prog="bench", description="burnish's benchmarks")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"some of {', '.join(BENCHES)}")
    parser.add_argument("--quick", action="store_true", help="small sizes: two minutes in all")
    parser.add_argument("--output", type=Path, default=Path("build/bench"), help="report's folder")
    options = parser.parse_args()
    unknown = [name for name in options.names if name not in BENCHES]
    if unknown:
        parser.error(f"no benchmark {unknown[0]!r}; there are {', '.join(BENCHES)}")

    options.output.mkdir(parents=True, exist_ok=True)
    about = {
        "burnish": __version__,
        "python": platform.python_version(),
        "machine": f"{core_count()} cores, {platform.machine()}",
        "quick": options.quick,
    }
    sections = ["# Benchmarks", "", ", ".join(f"{k}: {v}" for k, v in about.items()), ""]
    found = []
    for name in options.names or BENCHES:
        start = time.perf_counter()
        report = import_module(BENCHES[name]).run(options.quick)
        report = replace(report, seconds=time.perf_counter() - start)
        print(report.markdown(), flush=True)
        sections.append(report.markdown())
        found.append(report.to_json())
        # After each, so that an interrupted run leaves what it has
        (options.output / "report.md").write_text("\n".join(sections), "utf-8")
        (options.output / "report.json").write_text(
            json.dumps({"about": about, "benchmarks": found}, indent=1), "utf-8"
        )


if __name__ == "__main__":
    main()
