"""How far a picture is from the truth: metrics, tests of equality, a sheet to look at.

Pictures come in as arrays; nothing here traces rays.
"""

from burnish.compare.flip import Flip, flip
from burnish.compare.metrics import metrics, without_emission
from burnish.compare.sheet import sheet
from burnish.compare.tone import auto_exposure, display
from burnish.compare.ztest import Level, ZTest, ztest

__all__ = [
    "Flip",
    "Level",
    "ZTest",
    "auto_exposure",
    "display",
    "flip",
    "metrics",
    "sheet",
    "without_emission",
    "ztest",
]
