"""The report of `make verify`: every figure beside its limit, in one Markdown file.

A test records figures with the `figures` fixture; each is written down before it is
checked, so that a failing run reports all that it measured. Pictures of what failed stay
beside the report.
"""

from __future__ import annotations

import os
import platform
import re
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pytest
from PIL import Image

from burnish.compare import sheet
from burnish.compare.metrics import Metrics
from burnish.core.types import AnyArray, Float32, Float64
from burnish.core.version import __version__

FOLDER = Path(__file__).resolve().parents[2] / "build" / "verify"
PROPERTY = "figure"
RELATIVE_SIGMA = 0.02
"""Of the median pixel, in a test for noise alone (DESIGN, section 6)."""


class Verdict(Protocol):
    """A statistical test of two pictures, such as `ZTest`."""

    @property
    def p(self) -> float: ...
    @property
    def significance(self) -> float: ...
    @property
    def passed(self) -> bool: ...
    @property
    def relative_sigma(self) -> float: ...
    def p_values(self) -> Float64: ...


@dataclass
class Figures:
    """What one test measures.

    Each method writes a line of the report; the checking ones then fail the test when the
    figure is beyond its limit. All figures of a test are taken before it fails.
    """

    node: str
    properties: list[tuple[str, object]]
    broken: list[str] = field(default_factory=list)

    def note(self, what: str, value: float | str) -> None:
        """A figure without a limit."""
        self._line(what, value, "", "")

    def at_most(self, what: str, value: float, limit: float) -> bool:
        return self._check(what, value, f"≤ {limit:.4g}", value <= limit)

    def at_least(self, what: str, value: float, limit: float) -> bool:
        return self._check(what, value, f"≥ {limit:.4g}", value >= limit)

    def equal(self, what: str, test: Verdict, ours: AnyArray, theirs: AnyArray) -> bool:
        """A test that must not tell two pictures apart, by pictures clean enough for it."""
        self.at_most(f"{what}: median relative σ", test.relative_sigma, RELATIVE_SIGMA)
        if self._check(what, test.p, f"p > {test.significance:g}", test.passed):
            return True
        self._keep_test(what, test, ours, theirs)
        self.broken[-1] += f" ({test})"
        return False

    def different(self, what: str, test: Verdict) -> bool:
        """A test that must tell two pictures apart."""
        return self._check(what, test.p, f"p ≤ {test.significance:g}", not test.passed)

    def close(
        self, what: str, found: Metrics, limit: float, ours: Float32, theirs: Float32
    ) -> bool:
        """rel_rmse_beyond_noise within a limit, by a reference that is clean enough to say so."""
        self._check(
            f"{what}: noise of the reference",
            found["noise"],
            f"≤ {limit:.4g}",
            found["noise"] <= limit,
        )
        error = found["rel_rmse_beyond_noise"]
        if self._check(f"{what}: rel_rmse_beyond_noise", error, f"≤ {limit:.4g}", error <= limit):
            return True
        self.keep(what, found, ours, theirs)
        return False

    def keep(self, what: str, found: Metrics, ours: Float32, theirs: Float32) -> None:
        """Keep a comparison sheet beside the report."""
        numbers = {key: float(value) for key, value in found.items()}  # type: ignore[arg-type]
        page = sheet(ours, theirs, numbers, title=what, subtitle=self.node)
        page.save(self._place(what))

    def settle(self) -> None:
        """Fail the test when a figure is beyond its limit."""
        assert not self.broken, "; ".join(self.broken)

    def _check(self, what: str, value: float, limit: str, good: bool) -> bool:
        self._line(what, value, limit, "yes" if good else "**no**")
        if not good:
            self.broken.append(f"{what}: {value:.4g}, must be {limit}")
        return good

    def _line(self, what: str, value: float | str, limit: str, verdict: str) -> None:
        shown = value if isinstance(value, str) else f"{value:.4g}"
        print(f"{what}: {shown} {limit} {verdict}")
        self.properties.append((PROPERTY, (what, shown, limit, verdict)))

    def _keep_test(self, what: str, test: Verdict, ours: AnyArray, theirs: AnyArray) -> None:
        """Ours, theirs and the p-values (white: 1, black: 10⁻⁶ and below), side by side."""
        scale = 0.8 / max(float(np.quantile(theirs, 0.95)), 1e-9)
        shown = [np.clip(np.clip(x * scale, 0, 1) ** (1 / 2.2), 0, 1) for x in (ours, theirs)]
        p = np.clip(1 + np.log10(np.maximum(test.p_values(), 1e-12)) / 6, 0, 1)
        row = np.concatenate([*shown, p], axis=1)
        picture = Image.fromarray((row * 255).astype(np.uint8))
        factor = max(1, 768 // picture.height)
        picture.resize((picture.width * factor, picture.height * factor), 0).save(self._place(what))

    def _place(self, what: str) -> Path:
        FOLDER.mkdir(parents=True, exist_ok=True)
        name = re.sub(r"[^a-z0-9.]+", "-", f"{self.node} {what}".lower()).strip("-")
        return FOLDER / f"{name[:120]}.png"


class Report:
    """A pytest plugin: gathers the figures of all `verify` tests and writes the file."""

    def __init__(self) -> None:
        self.tests: list[tuple[str, str, float, list[Any]]] = []
        self.titles: dict[str, str] = {}

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        chosen = [item for item in session.items if item.get_closest_marker("verify")]
        for item in chosen:
            text = getattr(item, "function", None) and item.function.__doc__  # type: ignore[attr-defined]
            self.titles[item.nodeid] = " ".join((text or "").split())
        if chosen and not session.config.option.collectonly:
            shutil.rmtree(FOLDER, ignore_errors=True)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if "verify" not in report.keywords:
            return
        if report.when == "call" or (report.when == "setup" and not report.passed):
            figures = [value for key, value in report.user_properties if key == PROPERTY]
            self.tests.append((report.nodeid, report.outcome, report.duration, figures))

    def pytest_sessionfinish(self) -> None:
        if self.tests:
            FOLDER.mkdir(parents=True, exist_ok=True)
            (FOLDER / "report.md").write_text(self.text(), encoding="utf-8")

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        if self.tests:
            terminalreporter.write_line(f"figures: {FOLDER / 'report.md'}")

    def text(self) -> str:
        """The report in Markdown."""
        good = sum(outcome == "passed" for _, outcome, _, _ in self.tests)
        total = sum(seconds for _, _, seconds, _ in self.tests)
        lines = [
            "# burnish: acceptance figures",
            "",
            f"burnish {__version__}, Python {platform.python_version()}, {platform.system()} "
            f"{platform.machine()}, {os.cpu_count()} cores. {good} of {len(self.tests)} tests "
            f"passed in {total / 60:.1f} minutes.",
        ]
        lines += ["", "| test | outcome | seconds |", "|---|---|---|"]
        for node, outcome, seconds, _ in self.tests:
            lines += [f"| {node.partition('::')[2]} | {outcome} | {seconds:.0f} |"]
        for node, outcome, seconds, figures in self.tests:
            file, _, test = node.partition("::")
            lines += ["", f"## {test}: {outcome}", ""]
            lines += [f"{self.titles.get(node, '')} ({file}, {seconds:.0f} s)".strip()]
            if figures:
                lines += ["", "| figure | value | limit | within |", "|---|---|---|---|"]
                lines += [f"| {' | '.join(figure)} |" for figure in figures]
        return "\n".join(lines) + "\n"
