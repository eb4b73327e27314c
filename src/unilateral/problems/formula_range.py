"""The guaranteed range of a formula in a polygon, by Taylor models on boxes that are quartered as needed."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from unilateral.arrays import Array, Index, Mask, row_blocks
from unilateral.formulas.expression import Expression
from unilateral.formulas.formula import compile_numpy
from unilateral.formulas.interval import IntervalArrays
from unilateral.formulas.taylor import EPS, TaylorModel, affine_model, monomial_basis
from unilateral.formulas.taylor_enclosures import enclose_formula
from unilateral.geometry.plane import segment_distances
from unilateral.geometry.polygon import Polygon
from unilateral.problems.piecewise import enclose_in_pieces
from unilateral.problems.side_models import side_coordinates

RANGE_DEGREE = 3
RANGE_TOLERANCE_PER_SPREAD = 1e-3
"""A bound that misses the values met by less than this part of their spread is sharp enough."""
RANGE_TOLERANCE_PER_SIZE = 1e-9
"""So is a bound that misses them by less than this part of the largest |value| met."""
MAX_BOXES = 20_000
MAX_BOX_QUARTERINGS = 40
CACHED_RANGES = 16
"""The last so many ranges are kept, for problems in which f stays."""
BOXES_PER_BLOCK = 1 << 11
"""This many boxes are treated at once, so that models of a long formula fit into the processor's cache."""
GRID_POINTS_PER_AXIS = 17
"""Whether a formula is 0 is asked at so many points in each direction, and at vertices."""
MAX_DISTANCES_PER_BLOCK = 1 << 20
"""This many distances of boxes from sides are computed at once."""


@lru_cache(maxsize=CACHED_RANGES)
def range_in_polygon(polygon: Polygon, formula: Expression) -> tuple[float, float]:
    """A lower and an upper bound on the formula in x, y in the polygon, infinite where none is found."""
    v = polygon.vertices
    boxes = np.stack([v.min(axis=0), v.max(axis=0)], axis=1)[None]
    value = compile_numpy([formula], "xy")
    lowest = np.inf
    highest = -np.inf
    met = (np.inf, -np.inf)
    # The true range contains `met`, the values at centres of boxes inside. Boxes whose bounds are close to it
    # are done, and count in `lowest`, `highest`; others are quartered
    for _ in range(MAX_BOX_QUARTERINGS):
        meets, inside = _locate_boxes(polygon, boxes)
        with np.errstate(all="ignore"):
            values = value(*boxes[inside].mean(axis=2).T)[0]
        met = float(np.fmin.reduce(values, initial=met[0])), float(np.fmax.reduce(values, initial=met[1]))
        boxes = boxes[meets]
        lower, upper = _range_on_boxes(formula, boxes)
        if formula.rational is not None:  # a constant is the same on all boxes
            return float(lower[0]), float(upper[0])
        slack = 0.0
        if met[0] <= met[1]:  # a value is met
            slack = RANGE_TOLERANCE_PER_SPREAD * (met[1] - met[0])
            slack += RANGE_TOLERANCE_PER_SIZE * np.abs(met).max()
        wide = ~((lower >= met[0] - slack) & (upper <= met[1] + slack))
        # Where infinite values are met, or boxes become too many, all bounds count as they are
        if not np.isfinite(slack) or 4 * np.count_nonzero(wide) > MAX_BOXES:
            wide[:] = False
        lowest = min(lowest, lower[~wide].min(initial=np.inf))
        highest = max(highest, upper[~wide].max(initial=-np.inf))
        boxes = _quarter_boxes(boxes[wide])
        if len(boxes) == 0:
            break
    # Boxes that are left after so many quarterings count as they are, too
    lower, upper = _range_on_boxes(formula, boxes)
    return float(min(lowest, lower.min(initial=np.inf))), float(max(highest, upper.max(initial=-np.inf)))


def may_be_0(formula: Expression, points: Array) -> bool:
    """Whether the formula in x, y may be 0 at all points (k, 2), as far as enclosures there say."""
    lower, upper = _range_on_boxes(formula, np.stack([points, points], axis=2))
    return bool(np.all((lower <= 0) & (upper >= 0)))


def sample_points(polygon: Polygon) -> Array:
    """The vertices, and the points of a grid that lie in the polygon, (k, 2)."""
    v = polygon.vertices
    along = [
        np.linspace(low, high, GRID_POINTS_PER_AXIS)
        for low, high in zip(v.min(axis=0), v.max(axis=0), strict=True)
    ]
    grid = np.stack(np.meshgrid(*along), axis=-1).reshape(-1, 2)
    return np.concatenate([v, grid[polygon.contains(grid)]])


def range_on_side(polygon: Polygon, formula: Expression, side: int) -> tuple[float, float]:
    """A lower and an upper bound on the formula in x, y on a side, infinite where none is found."""

    def model(sides: Index, t: TaylorModel) -> TaylorModel:
        """The formula on intervals of the sides (k,), t the arc length in side lengths."""
        x, y = side_coordinates(polygon, sides, t)
        return enclose_formula(formula, {"x": x, "y": y})

    other_sides = np.setdiff1d(np.arange(polygon.n_sides), [side]).tolist()
    pieces = enclose_in_pieces(polygon, model, other_sides)
    rows = pieces.side == side
    return float(pieces.lower[rows].min()), float(pieces.upper[rows].max())


def _range_on_boxes(formula: Expression, boxes: Array) -> IntervalArrays:
    """Lower and upper bounds on the formula on the boxes (k, 2, 2): box, axis, ends; (k,) each."""
    lower = np.empty(len(boxes))
    upper = np.empty(len(boxes))
    for block in row_blocks(len(boxes), BOXES_PER_BLOCK):
        x = _coordinate_model(boxes[block], 0)
        y = _coordinate_model(boxes[block], 1)
        lower[block], upper[block] = enclose_formula(formula, {"x": x, "y": y}).range
    return lower, upper


def _coordinate_model(boxes: Array, axis: int) -> TaylorModel:
    """x (axis 0) or y on the boxes: the centre plus half the width times its sigma."""
    lower, upper = boxes[:, axis].T
    arms = np.zeros((2, len(boxes)))
    arms[axis] = 0.5 * (upper - lower)
    return affine_model(monomial_basis(2, RANGE_DEGREE), 0.5 * (lower + upper), arms, (lower, upper))


def _locate_boxes(polygon: Polygon, boxes: Array) -> tuple[Mask, Mask]:
    """Which of the boxes (k, 2, 2) may meet the polygon, and which have their centre in it."""
    # A box may meet the boundary if its centre is no farther from a side than half its diagonal
    centres = boxes.mean(axis=2)
    half = 0.5 * np.hypot(*(boxes[..., 1] - boxes[..., 0]).T)
    v = polygon.vertices
    blocks = np.array_split(centres, 1 + len(boxes) * polygon.n_sides // MAX_DISTANCES_PER_BLOCK)
    away = [segment_distances(block, v, np.roll(v, -1, axis=0)).min(axis=1) for block in blocks]
    rounding = 64 * EPS * np.abs(boxes).max(axis=(1, 2))
    near = np.concatenate(away) <= half + rounding
    inside = polygon.contains(centres)
    return near | inside, inside


def _quarter_boxes(boxes: Array) -> Array:
    """The four equal parts of each box, (k, 2, 2): box, axis, ends."""
    for axis in range(2):
        middle = boxes[:, axis].mean(axis=1)
        lower = boxes.copy()
        upper = boxes.copy()
        lower[:, axis, 1] = middle
        upper[:, axis, 0] = middle
        boxes = np.concatenate([lower, upper])
    return boxes
