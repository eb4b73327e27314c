"""Axes of the domain, its mesh and T_H: its size and place, thin parts, flat triangles, short cells."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from study.experiments.extremes.outcome import NEVER_RIGHT, Axis, Budget, find_crossing, measure_condition
from study.experiments.extremes.problem import (
    ContactRule,
    ExtremeProblem,
    full_contact,
    pose_contact,
    pose_on_square,
    structured_square,
    wave_contact,
)
from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.fem.condense import MAX_CONSTANT_ERROR
from unilateral.fem.p1 import stiffness_and_mass
from unilateral.geometry import mesh as meshes
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import (
    Partition,
    from_points,
    make_shifted_partition,
    make_uniform_partition,
)
from unilateral.geometry.polygon import Polygon, square
from unilateral.geometry.structured import make_tensor_mesh

ROUNDING_CHANGE = 1e-12
"""Relative changes below this number are rounding."""


def ratio_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """The axis is h/H on structured meshes, below 1/2 at the given H, else at the given h.

    S is singular from 1 on.
    """

    def pose(value: float) -> ExtremeProblem:
        """The problem with that h/H, of which one is the axis's own."""
        edge, cell = (H * value, H) if value < 0.5 else (h, h / value)
        return pose_on_square(edge, cell, wave_contact)

    return Axis(
        pose=pose, measure=measure_condition, predicted=np.where(values >= 1, np.inf, np.nan), limit=1.0
    )


def odd_edges_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """H = h and an odd number e of edges: beta is like 1/e, so that cond(S) ~ 1/(H beta^2) is like e^3."""

    def pose(edges: float) -> ExtremeProblem:
        """The problem with so many edges, each a cell; the last side has those that are too many."""
        counts = np.full(4, int(edges) // 4)
        counts[3] += int(edges) - counts.sum()
        points = square().divided(counts)
        return pose_contact(
            meshes.triangulate_from_boundary(square(), points[:-1]), Partition(square(), points), wave_contact
        )

    return _power_law_axis(pose, values, (values / values[0]) ** 3, budget)


def shifted_cells_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """H = h, and points of T_H inside sides are moved by that fraction of a cell: cond(S) ~ fraction^-2."""
    mesh = structured_square(h)

    def pose(fraction: float) -> ExtremeProblem:
        """The problem on the shifted partition."""
        return pose_contact(mesh, make_shifted_partition(square(), h, fraction), wave_contact)

    return _power_law_axis(pose, values, (values[0] / values) ** 2, budget)


def short_cell_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """One cell at a mesh vertex has that length, in units of a side: lambda_min(S) is like that length."""
    mesh = structured_square(h)
    points = make_uniform_partition(square(), H).points

    def pose(length: float) -> ExtremeProblem:
        """The problem with a further point of T_H behind the middle of the first side."""
        return pose_contact(
            mesh, from_points(square(), np.sort(np.append(points, 0.5 + length))), wave_contact
        )

    return _power_law_axis(pose, values, values[0] / values, budget)


def loaded_short_cell_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """One short cell as in `short_cell_axis`, and lambda^0 = 1/length on that cell and 0 on all others."""

    def start(length: float, problem: ExtremeProblem) -> Array:
        """lambda^0 = 1/length on the shortest cell."""
        H_i = problem.spaces.operator.H_i
        return (H_i == H_i.min()) / length

    return replace(short_cell_axis(values, h, H, budget), start=start)


def near_vertices_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """Points of T_H inside the sides are that far from mesh vertices.

    D changes by at most twice that distance over H.
    """
    mesh = structured_square(h)
    aligned = make_uniform_partition(square(), H)
    inside = ~np.isin(aligned.points, square().starts)
    D = pose_contact(mesh, aligned, wave_contact).spaces.operator.D

    def pose(distance: float) -> ExtremeProblem:
        """The problem whose points of T_H inside the sides are moved that far."""
        return pose_contact(mesh, Partition(square(), aligned.points + distance * inside), wave_contact)

    def change(distance: float, problem: ExtremeProblem, mu: Array) -> float:
        """The largest change of D over its largest entry."""
        return float(np.abs(problem.spaces.operator.D - D).max() / np.abs(D).max())

    return Axis(pose=pose, measure=change, predicted=2 * values / H, max_change=ROUNDING_CHANGE)


def kernel_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """H = h takes those values, and g is orthogonal to the kernel of S.

    The number tells how far another multiplier with the same u_h is.
    """

    def distance(size: float, problem: ExtremeProblem, mu: Array) -> float:
        """The relative distance of mu from lambda_H in L2."""
        return problem.distance(mu, problem.lambda_H)

    return Axis(pose=lambda size: pose_equal_sizes(size, 0.0), measure=distance, limit=NEVER_RIGHT)


def loaded_kernel_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """H = h, and that gap on every other cell makes lambda_H unique.

    The number tells how far lambda_H is from a smooth multiplier.
    """

    def distance(gap: float, problem: ExtremeProblem, mu: Array) -> float:
        """The relative distance of mu from lambda_H without its part in the kernel."""
        return problem.distance(mu, remove_kernel(problem.lambda_H))

    mildest = pose_equal_sizes(h, float(values[0]))
    return Axis(
        pose=lambda gap: pose_equal_sizes(h, gap),
        measure=distance,
        predicted=distance(float(values[0]), mildest, mildest.lambda_H),
        limit=NEVER_RIGHT,
    )


def remove_kernel(lambda_H: Array) -> Array:
    """The multiplier (m,) without what B^T does not see, the kernel (-1)^i of equal cells at H = h."""
    kernel = (-1.0) ** np.arange(len(lambda_H))
    return np.asarray(lambda_H - kernel * (kernel @ lambda_H) / len(lambda_H))


def pose_equal_sizes(h: float, gap: float) -> ExtremeProblem:
    """H = h, and contact on all cells, or with that gap on every other one."""

    def contact(partition: Partition) -> tuple[Array, Array]:
        """Contact on all cells, or on those with even numbers and that gap on the others."""
        free = (np.arange(partition.n_cells) % 2 == 1) & (gap > 0)
        return full_contact(partition)[0] * ~free, gap * free

    return pose_on_square(h, h, contact)


def _power_law_axis(
    pose: Callable[[float], ExtremeProblem], values: Array, growth: Array, budget: Budget
) -> Axis:
    """The axis on which cond(S) is predicted to grow like `growth` from that of the mildest problem.

    Its limits follow from the steps that the budget allows.
    """
    numbers = pose(float(values[0])).condition * growth
    return Axis(
        pose=pose,
        measure=measure_condition,
        predicted=numbers,
        limit=find_crossing(values, numbers, budget.max_condition),
        tool_limit=find_crossing(values, numbers, budget.max_condition_nesterov),
    )


def square_size_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """The square has sides of that length L, with h and H in proportion and full contact: cond(S) ~ L^-2."""
    return _polygon_family_axis(
        lambda L: Polygon(L * square().vertices, "square"), values, h, H, budget, full_contact
    )


def needle_angle_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """A right triangle with that angle."""

    def needle(a: float) -> Polygon:
        """The right triangle with the legs 1 and tan(a)."""
        return Polygon(np.array([[0, 0], [1, 0], [1, np.tan(a)]]), "needle")

    return _polygon_family_axis(needle, values, h, H, budget, full_contact)


def slit_width_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """A square with a slit of that width, half as long as a side."""

    def slit_square(w: float) -> Polygon:
        """The unit square without [1/2 - w/2, 1/2 + w/2] x [0, 1/2]."""
        a = 0.5 - w / 2
        b = 0.5 + w / 2
        corners = [[0, 0], [a, 0], [a, 0.5], [b, 0.5], [b, 0], [1, 0], [1, 1], [0, 1]]
        return Polygon(np.array(corners), "slit")

    return _polygon_family_axis(slit_square, values, h, H, budget, wave_contact)


def short_side_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """A square with a corner cut off so that a side of that length is left."""

    def cut_square(length: float) -> Polygon:
        """The unit square without the triangle at (1, 0) whose longest side has that length."""
        d = length / np.sqrt(2)
        return Polygon(np.array([[0, 0], [1 - d, 0], [1, d], [1, 1], [0, 1]]), "cut square")

    return _polygon_family_axis(cut_square, values, h, H, budget, wave_contact)


def aspect_ratio_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """Strips of triangles of that aspect ratio along two sides of the square; cond(S) stays as it is."""
    n = square().counts(h)[0]
    partition = make_uniform_partition(square(), H)

    def strip_mesh(ratio: float) -> Mesh:
        """The tensor mesh with one more line, 1/(n ratio) from the left and from the lower side."""
        return make_tensor_mesh(np.unique(np.append(np.arange(n + 1) / n, 1 / (n * ratio))))

    def pose(ratio: float) -> ExtremeProblem:
        """The problem on the mesh with such strips."""
        return pose_contact(strip_mesh(ratio), partition, wave_contact)

    limit = find_crossing(
        values, np.array([_rounding_of_constants(strip_mesh(ratio)) for ratio in values]), MAX_CONSTANT_ERROR
    )
    mildest = pose(float(values[0])).condition
    return Axis(pose=pose, measure=measure_condition, predicted=mildest, limit=limit, tool_limit=limit)


def square_place_axis(values: Array, h: float, H: float, budget: Budget) -> Axis:
    """The square is moved that far. The number is the change of S.

    Its prediction is the share of an edge by which rounding moves nodes.
    """

    def pose(distance: float) -> ExtremeProblem:
        """The problem on the square that is moved by (distance, -distance)."""
        polygon = Polygon(square().vertices + distance * np.array([1, -1]), "square")
        return pose_contact(
            meshes.make_unstructured_mesh(polygon, h), make_uniform_partition(polygon, H), wave_contact
        )

    S = pose(0.0).spaces.operator.S

    def change(distance: float, problem: ExtremeProblem, mu: Array) -> float:
        """The largest change of S over its largest entry."""
        return float(np.abs(problem.spaces.operator.S - S).max() / np.abs(S).max())

    limit = meshes.MAX_ROUNDING_PER_H * h / float(np.finfo(float).eps)
    return Axis(
        pose=pose,
        measure=change,
        predicted=np.spacing(values) / h,
        max_change=ROUNDING_CHANGE,
        limit=limit,
        tool_limit=limit,
    )


def _polygon_family_axis(
    shape: Callable[[float], Polygon], values: Array, h: float, H: float, budget: Budget, contact: ContactRule
) -> Axis:
    """The axis of a family of polygons, with h and H in units of the longest side.

    cond(S) is predicted to grow like |boundary|/(|Omega| min H_i) from its first value. Where that law would
    have it fall below the first value, nothing is predicted.
    """

    @cache
    def family_mesh(value: float) -> Mesh:
        """The mesh of the polygon with that value."""
        polygon = shape(value)
        return meshes.make_unstructured_mesh(polygon, h * polygon.lengths.max())

    def pose(value: float) -> ExtremeProblem:
        """The problem on that mesh and the uniform cells."""
        polygon = family_mesh(value).polygon
        partition = make_uniform_partition(polygon, H * polygon.lengths.max())
        return pose_contact(family_mesh(value), partition, contact)

    def rounding_of_mesh(value: float) -> float:
        """The number of `_rounding_of_constants`; infinite where there is no mesh."""
        try:
            return _rounding_of_constants(family_mesh(value))
        except InputError:
            return np.inf

    law = np.array([_condition_law(shape(value), H) for value in values])
    mildest = pose(float(values[0])).condition
    # cond(S) ~ mildest law / law_0; the library refuses meshes on which constants change too much
    numbers = np.where(law >= law[0], mildest * law / law[0], np.nan)
    rounding_share = np.array([rounding_of_mesh(value) for value in values.tolist()]) / MAX_CONSTANT_ERROR
    return Axis(
        pose=pose,
        measure=measure_condition,
        predicted=numbers,
        limit=find_crossing(values, numbers, budget.max_condition),
        tool_limit=find_crossing(
            values, np.maximum(numbers / budget.max_condition_nesterov, rounding_share), 1.0
        ),
    )


def _rounding_of_constants(mesh: Mesh) -> float:
    """Bound eps ||diag K||_2 / |Omega| on the change of constants by the rounding of K 1 = 0."""
    diagonal = stiffness_and_mass(mesh)[0].diagonal()
    return float(np.finfo(float).eps * np.linalg.norm(diagonal) / mesh.polygon.area)


def _condition_law(polygon: Polygon, H: float) -> float:
    """The law of cond(S): by constants lambda_max(S) >= |boundary|/|Omega|, and lambda_min(S) ~ min H_i."""
    shortest = make_uniform_partition(polygon, H * polygon.lengths.max()).lengths.min()
    return polygon.perimeter / polygon.area / float(shortest)
