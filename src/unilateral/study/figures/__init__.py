"""The figures: drawn from rounded tables alone, as SVG whose bytes depend on nothing else.

Nothing is computed here: every number that a figure shows stands in its CSV file.
"""

from unilateral.study.figures.consistency import consistency
from unilateral.study.figures.dual_norm import dual_norm
from unilateral.study.figures.extremes import extremes
from unilateral.study.figures.grid import grid
from unilateral.study.figures.infsup import infsup
from unilateral.study.figures.multiplier import multiplier
from unilateral.study.figures.portrait import portrait
from unilateral.study.figures.rates import rates
from unilateral.study.figures.sharpness import sharpness
from unilateral.study.figures.verdict import verdict
from unilateral.study.figures.work_precision import work_precision

__all__ = [
    "consistency",
    "dual_norm",
    "extremes",
    "grid",
    "infsup",
    "multiplier",
    "portrait",
    "rates",
    "sharpness",
    "verdict",
    "work_precision",
]
