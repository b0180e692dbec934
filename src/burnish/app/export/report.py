"""What an export wrote, and what the format could not hold."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path


@dataclass
class Exported:
    """files: what was written, the first one the export itself. remarks: what differs from the
    edited material, one line each, with the measured error where there is one."""

    files: list[Path] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
