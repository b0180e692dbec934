"""What a benchmark found: a table, goals, and the numbers behind them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Goal:
    """A figure and the limit that it is held to.

    at_least: whether the limit is the smallest good value, else it is the largest.
    """

    text: str
    value: float
    limit: float
    at_least: bool = False

    @property
    def met(self) -> bool:
        return self.value >= self.limit if self.at_least else self.value <= self.limit


@dataclass(frozen=True)
class Report:
    """One benchmark's result. notes: what is measured, and how. data: raw figures."""

    name: str
    title: str
    notes: str
    rows: Sequence[Mapping[str, Any]]
    goals: Sequence[Goal] = ()
    data: Mapping[str, Any] = field(default_factory=dict)
    seconds: float = 0.0

    def markdown(self) -> str:
        """The section of the report."""
        lines = [f"## {self.title} (`{self.name}`)", "", self.notes, "", *_table(self.rows), ""]
        for goal in self.goals:
            sign = "≥" if goal.at_least else "≤"
            verdict = "met" if goal.met else "**missed**"
            lines.append(f"- {goal.text}: {_shown(goal.value)} ({sign} {goal.limit:g}) {verdict}")
        return "\n".join([*lines, "", f"Took {self.seconds:.0f} s.", ""])

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        result = asdict(self)
        result["goals"] = [{**asdict(goal), "met": goal.met} for goal in self.goals]
        return result


def _table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    if not rows:
        return []
    names = list(dict.fromkeys(name for row in rows for name in row))
    cells = [names, *([_shown(row.get(name, "")) for name in names] for row in rows)]
    lines = ["| " + " | ".join(line) + " |" for line in cells]
    return [lines[0], "|" + "---|" * len(names), *lines[1:]]


def _shown(value: Any) -> str:
    """Three significant digits, without exponents where they are not needed."""
    if isinstance(value, bool) or not isinstance(value, float):
        return str(value)
    if value == 0 or 1e-3 <= abs(value) < 1e3:
        return f"{value:.3g}"
    return f"{value:.0f}" if abs(value) >= 1e3 else f"{value:.2e}"
