"""Axes of data, contact and the iteration: their size, the start, degenerate contact, rho and the precision.

The step is taken over its limit 2/lambda_max(S), as (5.1), (5.2) are meant and as they are printed.

The precision is float32 or float64, from the factors of A on, until round-off stops the iteration: A is
assembled, and F(0) computed, in float64, and then rounded. With S y + b known to epsilon ||b||, epsilon the
unit round-off, iterates stay about epsilon cond(S) ||y|| from lambda_H in L2. S is not known as well as that:
it comes from the factors of A, and their rounding is seen on top.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import DTypeLike
from scipy.linalg import solve_triangular

from study.experiments.extremes.outcome import Axis, Budget, find_crossing
from study.experiments.extremes.problem import (
    ExtremeProblem,
    cell_middles,
    condense_mesh,
    full_contact,
    pose_on_square,
    pose_solution,
    structured_square,
    wave_contact,
)
from study.uzawa_variants import AS_MEANT, AS_PRINTED, iterate_variant
from unilateral.arrays import Array
from unilateral.fem.linear_systems import elimination_order, factorise, schur_factor
from unilateral.fem.spaces import DualOperator, mixed_spaces
from unilateral.geometry.partition import Partition, make_uniform_partition
from unilateral.geometry.polygon import square
from unilateral.solvers.uzawa import MAX_RESIDUAL, SMALLEST_NORMAL, DualResult, residual_bound
from unilateral.solvers.uzawa_steps import UZAWA_STEP_FACTOR

TOUCHING_POINT = 1 / 3
MAX_SCALING_CHANGE = 1e-10
"""If the data are multiplied by a number, so has to be the multiplier, up to this relative difference."""


def data_size_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """f and g are multiplied by the value.

    The number tells how far the active set's lambda_H is from that of the value 1, multiplied alike.
    """

    def pose(times: float) -> ExtremeProblem:
        """The problem with all data multiplied by `times`."""
        return pose_on_square(h, H, wave_contact, times)

    def change(times: float, problem: ExtremeProblem, mu: Array) -> float:
        """max |mu - lambda_H| / max lambda_H, without overflow."""
        unit = problem.lambda_H.max()
        return float(np.abs(mu / unit - problem.lambda_H / unit).max())

    unit = pose(1.0)
    downwards = values[-1] < values[0]
    # Both grow like the data: the tolerance has to be a normal number, the first residual below MAX_RESIDUAL
    limit = SMALLEST_NORMAL / budget.tolerance(unit) if downwards else MAX_RESIDUAL / first_residual(unit)
    return Axis(
        pose=pose, measure=change, predicted=0.0, max_change=MAX_SCALING_CHANGE, limit=limit, tool_limit=limit
    )


def start_size_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """lambda^0 has that size everywhere, and |boundary|^(1/2) times it in L2.

    It is refused if its norm in L2 is above MAX_RESIDUAL; below that the steps grow like its logarithm.
    """
    problem = pose_on_square(h, H, wave_contact)
    limit = MAX_RESIDUAL / float(np.sqrt(square().perimeter))
    return Axis(
        pose=lambda size: problem,
        measure=_count_loaded_cells,
        start=lambda size, problem: size,
        limit=limit,
        tool_limit=limit,
    )


def flat_contact_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """lambda = 0 and u = g on that share of the boundary, reached from above."""

    def pose(share: float) -> ExtremeProblem:
        """The problem with flat contact on that share."""

        def contact(partition: Partition) -> tuple[Array, Array]:
            """lambda_H and the gap, both 0 on the cells up to that share."""
            lambda_H, gap = wave_contact(partition)
            is_loaded = cell_middles(partition) > share
            return lambda_H * is_loaded, gap * is_loaded

        return pose_on_square(h, H, contact)

    return Axis(pose=pose, measure=_count_loaded_cells, start=_start_from_one)


def touching_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """lambda = 0, and the gap is 0 at one point inside a cell, on which lambda^0 = 1; the axis is H.

    The gap is 1 - cos(pi (s - 1/3) / 2): the cell's mean is (pi H)^2/72 to leading order, as 1/3 is a third
    of the cell from one of its ends.
    """

    def contact(partition: Partition) -> tuple[Array, Array]:
        """lambda_H = 0, and the cell means of the gap by the antiderivative of the cosine."""
        integral = np.diff(np.sin(np.pi / 2 * (partition.points - TOUCHING_POINT))) * 2 / np.pi
        return np.zeros(partition.n_cells), 1 - integral / partition.lengths

    def start_on_cell(size: float, problem: ExtremeProblem) -> Array:
        """lambda^0 = 1 on the cell with the touching point, else 0."""
        points = problem.spaces.partition.points
        return ((points[:-1] < TOUCHING_POINT) & (points[1:] > TOUCHING_POINT)).astype(float)

    def smallest_gap(size: float, problem: ExtremeProblem, mu: Array) -> float:
        """The least cell mean of u_h - g."""
        return float(problem.spaces.operator.gap(mu, problem.discrete.offset).min())

    return Axis(
        pose=lambda size: pose_on_square(size * h / H, size, contact),
        measure=smallest_gap,
        start=start_on_cell,
        predicted=(np.pi * values) ** 2 / 72,
    )


def shrinking_contact_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """f = 0, and g = -1 but for a hat 4 high, of that width over H: from H/2 downwards no cell is loaded."""
    mesh = structured_square(h)
    partition = make_uniform_partition(square(), H)
    D = mixed_spaces(condense_mesh(mesh), partition).operator.D
    unit = square().area / square().perimeter

    def pose(width: float) -> ExtremeProblem:
        """The problem whose g is a hat of that width on one cell: lambda_H is the load there, if g > 0."""
        g = np.where(np.arange(partition.n_cells) == 1, 2 * width - 1, -1.0)
        loaded = np.maximum(g, 0) * partition.lengths / np.diag(D)
        gap = D @ loaded / partition.lengths - g
        return pose_solution(mesh, partition, loaded / unit, np.where(loaded > 0, 0.0, gap))

    return Axis(pose=pose, measure=_count_loaded_cells, predicted=(values > 0.5).astype(float))


def vertex_contact_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """Contact on two opposite sides and a gap on the others: all vertices are transitions; the axis is H."""

    def contact(partition: Partition) -> tuple[Array, Array]:
        """Contact on the sides with even numbers, and the gap 1 on the others."""
        has_contact = partition.side % 2 == 0
        return full_contact(partition)[0] * has_contact, 1.0 * ~has_contact

    return Axis(pose=lambda size: pose_on_square(size * h / H, size, contact), measure=_count_loaded_cells)


def zero_data_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """f = g = 0, from lambda^0 = 1 on cells of that size, h in proportion."""

    def pose(size: float) -> ExtremeProblem:
        """The problem with f = g = 0 on cells of that size."""
        return pose_on_square(size * h / H, size, lambda cells: (np.zeros(cells.n_cells),) * 2, 0.0)

    return Axis(pose=pose, measure=_count_loaded_cells, start=_start_from_one, predicted=0.0)


def _start_from_one(value: float, problem: ExtremeProblem) -> float:
    return 1.0


def _count_loaded_cells(value: float, problem: ExtremeProblem, mu: Array) -> float:
    """How many cells the active set loads."""
    return float(np.count_nonzero(mu > problem.rounding * problem.norm(problem.u)))


def first_residual(problem: ExtremeProblem) -> float:
    """The first residual of plain Uzawa from 0, ||min(0, rho F(0))||_0."""
    operator = problem.spaces.operator
    rho = UZAWA_STEP_FACTOR / operator.lambda_max
    return float(np.linalg.norm(np.sqrt(operator.H_i) * np.minimum(0, rho * problem.discrete.offset)))


# The step: rho over 2/lambda_max(S).


def full_step_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """Full contact, where 1 is the limit: above it the clip leaves a bounded cycle."""
    return _meant_step_axis(pose_on_square(h, H, full_contact), budget)


def partial_step_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """Contact on three intervals, where 1 is proved to be safe; larger steps may do."""
    problem = pose_on_square(h, H, wave_contact)
    return replace(_meant_step_axis(problem, budget), local_limit=local_limit(problem))


def full_printed_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """Full contact with the printed index: z^2 - z + rho sigma = 0 halves the range."""
    return _printed_step_axis(pose_on_square(h, H, full_contact), budget)


def partial_printed_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """Contact on three intervals, printed index; the half is proved as long as the clip is not active."""
    problem = pose_on_square(h, H, wave_contact)
    return replace(_printed_step_axis(problem, budget), local_limit=0.5 * local_limit(problem))


def local_limit(problem: ExtremeProblem) -> float:
    """lambda_max of S over lambda_max of S on the loaded cells.

    The loaded cells alone decide once no other cell is loaded again.
    """
    loaded = np.flatnonzero(problem.lambda_H)
    S = problem.spaces.operator.S
    return problem.spaces.operator.lambda_max / float(np.linalg.eigvalsh(S[np.ix_(loaded, loaded)])[-1])


def _meant_step_axis(problem: ExtremeProblem, budget: Budget) -> Axis:
    """The axis of all algorithms; the number is the relative error left by plain Uzawa after all steps."""

    def remaining_error(share: float, problem: ExtremeProblem, mu: Array) -> float:
        """The relative error of plain Uzawa's last iterate."""
        return problem.error(_iterate_uzawa(problem, share, budget, AS_MEANT)) / problem.size

    return Axis(pose=lambda share: problem, measure=remaining_error, sets_rho=True, limit=1.0)


def _printed_step_axis(problem: ExtremeProblem, budget: Budget) -> Axis:
    """The axis of the iteration itself, with the bound and the relative error of its last iterate."""
    return Axis(
        pose=lambda share: problem,
        measure=lambda share, problem, mu: problem.error(mu) / problem.size,
        run=lambda share, problem: _bound_iterate(
            problem, _iterate_uzawa(problem, share, budget, AS_PRINTED), share, budget
        ),
        limit=0.5,
    )


def _iterate_uzawa(problem: ExtremeProblem, share: float, budget: Budget, variant: str) -> Array:
    """Uzawa's last iterate lambda (m,), with rho that share of 2/lambda_max(S)."""
    operator = problem.spaces.operator
    rho = share * 2 / operator.lambda_max
    return iterate_variant(operator, problem.discrete.offset, rho, budget.max_steps, variant)


def _bound_iterate(problem: ExtremeProblem, mu: Array, share: float, budget: Budget) -> DualResult:
    """A last iterate with the bound of its residual, with rho that share of 2/lambda_max(S)."""
    operator = problem.spaces.operator
    rho = share * 2 / operator.lambda_max
    bound = residual_bound(operator, problem.discrete.offset, mu, rho)
    return DualResult(
        lambda_H=mu,
        iterations=budget.max_steps,
        operator_applications=0,
        bound=bound,
        converged=bound <= budget.tolerance(problem),
        rho=rho,
        algorithm="uzawa",
    )


# The precision, in full contact.


def single_precision_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """The axis is H, h in proportion; the number is the floor of lambda's relative L2 error in float32."""
    return _precision_axis(values, h / H, budget, np.float32)


def double_precision_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """The axis of H, h in proportion, with the floor of lambda's relative L2 error in float64."""
    return _precision_axis(values, h / H, budget, np.float64)


def _precision_axis(values: Array, h_over_H: float, budget: Budget, precision: DTypeLike) -> Axis:
    """The axis of a precision, judged by the bound in float64 with rho = 1/lambda_max(S).

    Predicted are the floor epsilon cond(S), in L2, and the limit by the bound there.
    """
    problems = {size: pose_on_square(h_over_H * size, size, full_contact) for size in values.tolist()}
    unit_roundoff = 0.5 * float(np.finfo(precision).eps)
    # epsilon cond(S), and the bound that an error of this size has
    floors = np.array([unit_roundoff * problem.condition for problem in problems.values()])
    bounds = floors * [bound_per_error(problem) for problem in problems.values()]

    def run(size: float, problem: ExtremeProblem) -> DualResult:
        """The last iterate in that precision, with its bound in float64."""
        mu = iterate_in_precision(problem, round_operator(problem, precision), budget.max_steps)
        return _bound_iterate(problem, mu, 0.5, budget)

    return Axis(
        pose=lambda size: problems[size],
        measure=lambda size, problem, mu: problem.distance(mu, problem.lambda_H),
        run=run,
        predicted=floors,
        limit=find_crossing(values, bounds, budget.accuracy),
    )


def round_operator(problem: ExtremeProblem, precision: DTypeLike) -> DualOperator:
    """The dual operator of A rounded to that precision, its factors, A_3, D and S computed in it."""
    spaces = problem.spaces
    boundary = problem.spaces.mesh.boundary
    A = spaces.condensed.A.astype(precision)
    cholesky = schur_factor(factorise(A, elimination_order(A, boundary)), len(boundary))
    # A_3 = R^T R, D = B A_3^{-1} B^T = half^T half with half = R^{-T} B^T
    half = solve_triangular(cholesky, spaces.B.T.toarray().astype(precision), trans="T")
    return replace(spaces.operator, D_factor=half, H_i=spaces.partition.lengths.astype(precision))


def bound_per_error(problem: ExtremeProblem) -> float:
    """How large the bound with rho = 1/lambda_max(S) may be, over `size`, per relative error e in L2.

    In full contact R = rho S e, so ||R||_0 <= ||e||_0 and ||R||_S <= lambda_max^(1/2) ||e||_0.
    """
    operator = problem.spaces.operator
    in_L2 = float(np.sqrt(operator.H_i @ problem.lambda_H**2))
    return float(np.sqrt(operator.lambda_max) * (1 + np.sqrt(problem.condition))) * in_L2 / problem.size


def iterate_in_precision(problem: ExtremeProblem, operator: DualOperator, steps: int) -> Array:
    """Uzawa's last iterate lambda (m,), every operation in the operator's precision."""
    root = np.sqrt(operator.H_i)
    S = operator.S
    b = (root * problem.discrete.offset).astype(root.dtype)
    rho = root.dtype.type(UZAWA_STEP_FACTOR / operator.lambda_max)
    # (5.1)-(5.3) in y = H_i^{1/2} lambda: y <- max(0, y - rho (S y + b))
    y = np.zeros_like(b)
    for _ in range(steps):
        y = np.maximum(0, y - rho * (S @ y + b))
    return np.asarray(y / root, dtype=float)
