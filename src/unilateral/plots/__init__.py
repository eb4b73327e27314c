"""The figures: drawn from rounded tables alone, as SVG whose bytes depend on nothing else.

Nothing is computed here: every number that a figure shows stands in its CSV file.
"""

from unilateral.plots.consistency import consistency
from unilateral.plots.dual_norm import dual_norm
from unilateral.plots.extremes import extremes
from unilateral.plots.grid import grid
from unilateral.plots.infsup import infsup
from unilateral.plots.multiplier import multiplier
from unilateral.plots.portrait import portrait
from unilateral.plots.rates import rates
from unilateral.plots.sharpness import sharpness
from unilateral.plots.verdict import verdict
from unilateral.plots.work_precision import work_precision

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
