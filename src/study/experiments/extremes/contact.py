"""Axes of the data and the contact: their size, the start, contact that is degenerate or small."""

from __future__ import annotations

import numpy as np

from study.experiments.extremes.outcome import Axis, Budget, attempts, predicted, within
from study.experiments.extremes.problem import (
    ExtremeProblem,
    condensed,
    full,
    made,
    on_square,
    place,
    structured_square,
    waves,
)
from unilateral.arrays import Array
from unilateral.fem.spaces import mixed_spaces
from unilateral.geometry.partition import Partition, uniform
from unilateral.geometry.polygon import square
from unilateral.solvers.uzawa import DIVERGED, LEAST
from unilateral.solvers.uzawa_steps import STEPS

TOUCH = 1 / 3
SCALES = 1e-10
"""If the data are multiplied by a number, so has to be the multiplier, up to this relative difference."""


def data(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """f and g are multiplied by the value.

    The number tells how far the active set's lambda_H is from that of the value 1, multiplied alike.
    """

    def change(problem: ExtremeProblem, mu: Array) -> float:
        unit = problem.lambda_H.max()
        return float(np.abs(mu / unit - problem.lambda_H / unit).max())

    def problem(times: float) -> ExtremeProblem:
        return on_square(h, H, waves, times)

    rows = attempts(values, problem, budget, change)
    unit = problem(1.0)
    least, most = LEAST / budget.tolerance(unit), DIVERGED / _first_residual(unit)
    limit = least if values[-1] < values[0] else most
    return Axis(within(predicted(rows, np.zeros(len(rows))), SCALES), limit, limit)


def start(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """lambda^0 has that size everywhere, and |boundary|^(1/2) times it in L2.

    It is refused if its norm in L2 is above DIVERGED; below that the steps grow like the size's logarithm.
    """
    problem = on_square(h, H, waves)
    rows = attempts(values, lambda _: problem, budget, _held, start=lambda size, _: size)
    limit = DIVERGED / float(np.sqrt(square().perimeter))
    return Axis(rows, limit, limit)


def flat(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """lambda = 0 and u = g on that share of the boundary, reached from above."""

    def problem(share: float) -> ExtremeProblem:
        def contact(partition: Partition) -> tuple[Array, Array]:
            lambda_H, gap = waves(partition)
            kept = place(partition) > share
            return lambda_H * kept, gap * kept

        return on_square(h, H, contact)

    return Axis(attempts(values, problem, budget, _held, start=1.0))


def touching(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """lambda = 0, and the gap is 0 at one point inside a cell, on which lambda^0 = 1; the axis is H.

    The gap is 1 - cos(pi (s - TOUCH) / 2): the cell's mean is (pi H)^2/72 to leading order, as TOUCH is a
    third of the cell from one of its ends.
    """

    def contact(partition: Partition) -> tuple[Array, Array]:
        integral = np.diff(np.sin(np.pi / 2 * (partition.points - TOUCH))) * 2 / np.pi
        return np.zeros(partition.n_cells), 1 - integral / partition.lengths

    def there(_: float, of: ExtremeProblem) -> Array:
        points = of.spaces.partition.points
        return ((points[:-1] < TOUCH) & (points[1:] > TOUCH)).astype(float)

    def smallest_gap(of: ExtremeProblem, mu: Array) -> float:
        return float(of.spaces.operator.gap(mu, of.discrete.offset).min())

    rows = attempts(values, lambda size: on_square(size * h / H, size, contact), budget, smallest_gap, there)
    return Axis(predicted(rows, (np.pi * values) ** 2 / 72))


def shrinking(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """f = 0, and g = -1 but for a hat 4 high, of that width over H: from H/2 downwards no cell is held."""
    mesh, partition = structured_square(h), uniform(square(), H)
    D = mixed_spaces(condensed(mesh), partition).operator.D
    unit = square().area / square().perimeter

    def problem(width: float) -> ExtremeProblem:
        g = np.where(np.arange(partition.n_cells) == 1, 2 * width - 1, -1.0)
        held = np.maximum(g, 0) * partition.lengths / np.diag(D)
        gap = D @ held / partition.lengths - g
        return made(mesh, partition, held / unit, np.where(held > 0, 0.0, gap))

    rows = attempts(values, problem, budget, _held)
    return Axis(predicted(rows, (values > 0.5).astype(float)))


def vertex(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """Contact on two opposite sides and a gap on the others: all vertices are transitions; the axis is H."""

    def contact(partition: Partition) -> tuple[Array, Array]:
        here = partition.side % 2 == 0
        return full(partition)[0] * here, 1.0 * ~here

    return Axis(attempts(values, lambda size: on_square(size * h / H, size, contact), budget, _held))


def nothing(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """f = g = 0, from lambda^0 = 1 on cells of that size, h in proportion."""

    def problem(size: float) -> ExtremeProblem:
        return on_square(size * h / H, size, lambda cells: (np.zeros(cells.n_cells),) * 2, 0.0)

    rows = attempts(values, problem, budget, _held, start=1.0)
    return Axis(predicted(rows, np.zeros(len(rows))))


def _first_residual(problem: ExtremeProblem) -> float:
    """The first residual of plain Uzawa from 0, ||min(0, rho F(0))||_0."""
    of = problem.spaces.operator
    rho = STEPS["uzawa"].share / of.lambda_max
    return float(np.linalg.norm(np.sqrt(of.H_i) * np.minimum(0, rho * problem.discrete.offset)))


def _held(problem: ExtremeProblem, mu: Array) -> float:
    """How many cells the active set loads."""
    return float(np.count_nonzero(mu > problem.rounding * problem.norm(problem.u)))
