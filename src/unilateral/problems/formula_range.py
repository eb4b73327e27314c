"""The guaranteed range of a formula in a polygon, by Taylor models on boxes that are quartered as needed."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from unilateral.arrays import Array, Index, Mask, blocks
from unilateral.formulas.expression import Expression
from unilateral.formulas.formula import compile_numpy
from unilateral.formulas.interval import Interval
from unilateral.formulas.taylor import EPS, Model, affine, basis
from unilateral.formulas.taylor_enclosures import evaluate
from unilateral.geometry.plane import segment_distances
from unilateral.geometry.polygon import Polygon
from unilateral.problems.piecewise import in_pieces
from unilateral.problems.side_models import places

ORDER = 3
SHARP = 1e-3
"""A bound that misses the values met by less than this part of their spread is sharp enough."""
SAME = 1e-9
"""So is a bound that misses them by less than this part of the largest |value| met."""
MOST_BOXES = 20_000
MOST_LEVELS = 40
KEPT = 16
"""The last so many ranges are kept, for problems in which f stays."""
FEW = 1 << 11
"""This many boxes are treated at once, so that models of a long formula fit into the processor's cache."""
POINTS = 17
"""Whether a formula is 0 is asked at so many points in each direction, and at vertices."""
MOST_DISTANCES = 1 << 20
"""This many distances of boxes from sides are computed at once."""


@lru_cache(maxsize=KEPT)
def range_in(polygon: Polygon, formula: Expression) -> tuple[float, float]:
    """A lower and an upper bound on the formula in x, y in the polygon, infinite where none is found."""
    v = polygon.vertices
    boxes = np.stack([v.min(axis=0), v.max(axis=0)], axis=1)[None]
    value = compile_numpy([formula], "xy")
    bounds = (np.inf, -np.inf)
    met = (np.inf, -np.inf)
    for _ in range(MOST_LEVELS):
        meets, inside = _part(polygon, boxes)
        with np.errstate(all="ignore"):
            values = value(*boxes[inside].mean(axis=2).T)[0]
        met = float(np.fmin.reduce(values, initial=met[0])), float(np.fmax.reduce(values, initial=met[1]))
        boxes = boxes[meets]
        lower, upper = _bounds(formula, boxes)
        if formula.rational is not None:
            return float(lower[0]), float(upper[0])
        slack = SHARP * (met[1] - met[0]) + SAME * np.abs(met).max() if met[0] <= met[1] else 0.0
        wide = ~((lower >= met[0] - slack) & (upper <= met[1] + slack))
        if not np.isfinite(slack) or 4 * np.count_nonzero(wide) > MOST_BOXES:
            wide[:] = False
        bounds = (
            min(bounds[0], lower[~wide].min(initial=np.inf)),
            max(bounds[1], upper[~wide].max(initial=-np.inf)),
        )
        boxes = _quarters(boxes[wide])
        if len(boxes) == 0:
            break
    lower, upper = _bounds(formula, boxes)
    return float(min(bounds[0], lower.min(initial=np.inf))), float(max(bounds[1], upper.max(initial=-np.inf)))


def may_be_0(formula: Expression, points: Array) -> bool:
    """Whether the formula in x, y may be 0 at all points (k, 2), as far as enclosures there say."""
    lower, upper = _bounds(formula, np.stack([points, points], axis=2))
    return bool(np.all((lower <= 0) & (upper >= 0)))


def some_points(polygon: Polygon) -> Array:
    """(k, 2) the vertices, and points of a grid in the polygon."""
    v = polygon.vertices
    along = [np.linspace(low, high, POINTS) for low, high in zip(v.min(axis=0), v.max(axis=0), strict=True)]
    grid = np.stack(np.meshgrid(*along), axis=-1).reshape(-1, 2)
    return np.concatenate([v, grid[polygon.contains(grid)]])


def range_on_side(polygon: Polygon, formula: Expression, side: int) -> tuple[float, float]:
    """A lower and an upper bound on the formula in x, y on a side, infinite where none is found."""

    def model(sides: Index, t: Model) -> Model:
        x, y = places(polygon, sides, t)
        return evaluate(formula, {"x": x, "y": y})

    others = np.setdiff1d(np.arange(polygon.n_sides), [side]).tolist()
    pieces = in_pieces(polygon, model, others)
    here = pieces.side == side
    return float(pieces.lower[here].min()), float(pieces.upper[here].max())


def _bounds(formula: Expression, boxes: Array) -> Interval:
    """(k,), (k,) lower and upper bounds on the formula on the boxes (k, 2, 2)."""
    lower = np.empty(len(boxes))
    upper = np.empty(len(boxes))
    for block in blocks(len(boxes), FEW):
        x = _variable(boxes[block], 0)
        y = _variable(boxes[block], 1)
        lower[block], upper[block] = evaluate(formula, {"x": x, "y": y}).range
    return lower, upper


def _variable(boxes: Array, axis: int) -> Model:
    lower, upper = boxes[:, axis].T
    arms = np.zeros((2, len(boxes)))
    arms[axis] = 0.5 * (upper - lower)
    return affine(basis(2, ORDER), 0.5 * (lower + upper), arms, (lower, upper))


def _part(polygon: Polygon, boxes: Array) -> tuple[Mask, Mask]:
    """Which of the boxes (k, 2, 2) may meet the polygon, and which have their centre in it."""
    centres = boxes.mean(axis=2)
    half = 0.5 * np.hypot(*(boxes[..., 1] - boxes[..., 0]).T)
    v = polygon.vertices
    parts = np.array_split(centres, 1 + len(boxes) * polygon.n_sides // MOST_DISTANCES)
    away = [segment_distances(part, v, np.roll(v, -1, axis=0)).min(axis=1) for part in parts]
    rounding = 64 * EPS * np.abs(boxes).max(axis=(1, 2))
    near = np.concatenate(away) <= half + rounding
    inside = polygon.contains(centres)
    return near | inside, inside


def _quarters(boxes: Array) -> Array:
    """The four equal parts of each box."""
    for axis in range(2):
        middle = boxes[:, axis].mean(axis=1)
        left = boxes.copy()
        right = boxes.copy()
        left[:, axis, 1] = middle
        right[:, axis, 0] = middle
        boxes = np.concatenate([left, right])
    return boxes
