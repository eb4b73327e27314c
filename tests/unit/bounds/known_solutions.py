"""Problems with a known solution, and true errors by a quadrature of its own.

It is refined to features that are declared here and that the certificate does not know.
"""

from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import sympy
from skfem.quadrature import get_quadrature_tri
from symbolic import X, Y, compile_numpy, plain

from unilateral.fem.condense import condense
from unilateral.fem.p1 import coupling
from unilateral.fem.splitting import quarter
from unilateral.formulas import formula
from unilateral.norms.ritz import h1_distance, multiplier_load
from unilateral.problems.problem import Problem

SIZE = 1 / 2
"""Pieces near a feature may be as large as this fraction of its width."""
QUADRATURE = 1e-4
"""The quadrature of ||u - u_h||_1 is off by at most this fraction of it; a test holds that for features."""
OF_MOMENTS = 1e-6
"""The quadrature of lambda is off by at most this fraction of the norm of lambda - lambda_H on a mesh."""


class Feature(NamedTuple):
    """What is narrow or not smooth: within `width` of a point, or of a line or circle {level = 0}."""

    level: sympy.Expr
    width: float


def h1_errors(u, mesh, functions, features=(), size=SIZE, k=1, c=1):
    """(k |u - v_h|_1^2 + c ||u - v_h||_0^2)^(1/2) of each, by a rule of degree 8.

    Its pieces are small against the features.
    """
    value = compile_numpy([u, u.diff(X), u.diff(Y)], (X, Y))
    distances = [(compile_numpy([feature.level], (X, Y)), feature.width) for feature in features]
    corners = np.broadcast_to(np.eye(3), (len(mesh.triangles), 3, 3))
    parent = np.arange(len(mesh.triangles))
    total = np.zeros(len(functions))
    for _ in range(14):
        vertices = corners @ mesh.points[mesh.triangles[parent]]
        centre = vertices.mean(axis=1)
        radius = np.linalg.norm(vertices - centre[:, None], axis=2).max(axis=1)
        coarse = np.zeros(len(parent), dtype=bool)
        for level, width in distances:
            away = np.abs(level(*centre.T)[0])
            coarse |= (radius > size * np.maximum(width, 0.5 * (away - radius))) & (away < radius + 8 * width)
        total += _squares(mesh, functions, corners[~coarse], parent[~coarse], value, k, c)
        corners = quarter(corners[coarse])
        parent = np.repeat(parent[coarse], 4)
    return np.sqrt(total + _squares(mesh, functions, corners, parent, value, k, c))


def _squares(mesh, functions, corners, parent, value, k, c):
    points, weights = get_quadrature_tri(8)
    nodes = mesh.points[mesh.triangles[parent]]
    places = np.column_stack([1 - points.sum(axis=0), *points]) @ corners
    x, y = np.moveaxis(places @ nodes, 2, 0)
    u, u_x, u_y = value(x, y)
    edges = nodes[:, 1:] - nodes[:, :1]
    areas = 0.5 * np.abs(np.linalg.det(edges)) * np.abs(np.linalg.det(corners))
    square_norms = []
    for v_h in functions:
        nodal = v_h[mesh.triangles[parent]]
        slope = np.linalg.solve(edges, (nodal[:, 1:] - nodal[:, :1])[..., None])[..., 0]
        remaining = c * (u - np.einsum("kqb,kb->kq", places, nodal)) ** 2
        remaining += k * ((u_x - slope[:, :1]) ** 2 + (u_y - slope[:, 1:]) ** 2)
        square_norms.append(areas @ (remaining @ (2 * weights)))
    return np.array(square_norms)


def fluxes(u, vertices):
    """du/dn on the sides of a polygon, exact."""
    corners = [[sympy.Rational(float(c)) for c in vertex] for vertex in vertices]
    computed = []
    for start, end in zip(corners, corners[1:] + corners[:1], strict=True):
        x = end[0] - start[0]
        y = end[1] - start[1]
        computed.append((y * u.diff(X) - x * u.diff(Y)) / sympy.sqrt(x**2 + y**2))
    return computed


class Known(NamedTuple):
    """A problem, its u, and what is narrow in it; the `doubt` is what lambda may lack of solving it."""

    problem: Problem
    u: sympy.Expr
    features: tuple[Feature, ...] = ()
    doubt: float = 0.0

    def errors(self, mesh, functions, size=SIZE):
        """||u - v_h||_1 of each."""
        return h1_errors(self.u, mesh, functions, self.features, size)

    def flux_moments(self, mesh):
        """(nb,) the moments of lambda with the boundary hats, by 2000 points on every edge."""
        slopes = compile_numpy([self.u.diff(X), self.u.diff(Y)], (X, Y))
        x = (np.arange(2000) + 0.5) / 2000
        start = mesh.points[mesh.boundary]
        end = mesh.points[np.roll(mesh.boundary, -1)]
        position = start[:, None] + x[:, None] * (end - start)[:, None]
        normals = mesh.polygon.normals[mesh.side]
        flux = sum(
            slope * normals[:, i, None] for i, slope in enumerate(slopes(*np.moveaxis(position, 2, 0)))
        )
        flux = np.where(np.isin(mesh.side, self.problem.free_sides)[:, None], 0.0, flux)
        first = np.diff(mesh.s) * (flux * (1 - x)).mean(axis=1)
        second = np.diff(mesh.s) * (flux * x).mean(axis=1)
        return first + np.roll(second, 1)

    def boundary(self, side, s):
        """(k,) u, lambda and u - g at places s of the sides; on free ones du/dn less what is given, and 1."""
        polygon = self.problem.polygon
        problem = self.problem
        x, y = polygon.at(side, s).T
        u, u_x, u_y = compile_numpy([self.u, self.u.diff(X), self.u.diff(Y)], (X, Y))(x, y)
        gap = np.choose(side, formula.compile_numpy([plain(self.u) - g for g in problem.g], "xy")(x, y))
        flux = np.sum(np.column_stack([u_x, u_y]) * polygon.normals[side], axis=1)
        if problem.q:
            flux = flux - np.choose(side, formula.compile_numpy(problem.q, "xy")(x, y))
        return u, flux, np.where(np.isin(side, problem.free_sides), 1.0, gap)


class Catalogued(NamedTuple):
    """A case made of the catalogue's atoms, whose quadrature knows its singular points."""

    problem: Problem
    doubt: float = 0.0

    def errors(self, mesh, functions):
        return np.array([h1_distance(self.problem.exact, mesh, v_h) for v_h in functions])

    def flux_moments(self, mesh):
        return multiplier_load(self.problem.exact, mesh)

    def boundary(self, side, s):
        return self.problem.exact.trace_flux_and_gap(side, s)


class Trial(NamedTuple):
    """What both bounds take, and lower bounds of the true errors of u_h and of lambda_H."""

    bound_arguments: tuple
    u_error: float
    lambda_error: float


class ForceTrial(NamedTuple):
    """What `forces` takes, and for each of the parts two numbers between which the exact force lies."""

    mesh: Any
    cells: Any
    lambda_H: np.ndarray
    bound: float
    side_groups: list
    exact: list
    free: tuple = ()


class KnownSolution:
    """A problem with a known solution, and solutions of discrete problems, each with pairs to be tried."""

    def __init__(self, manufactured, solutions):
        """Take `solutions` with their pairs (u_h, lambda_H)."""
        self.known_solution = manufactured
        self.solutions = solutions

    @cached_property
    def trials(self):
        return [
            trial for solved, pairs in self.solutions for trial in trials(self.known_solution, solved, pairs)
        ]

    @cached_property
    def force_trials(self):
        return [make_force_trial(self.known_solution, solved) for solved, _ in self.solutions]


@lru_cache(maxsize=8)
def flux_moments(manufactured, mesh):
    """(nb,) the moments of lambda on a mesh, which trials and forces share."""
    return manufactured.flux_moments(mesh)


def trials(manufactured, solved, pairs):
    """The error of lambda_H is at least its norm over V_h, and its integral over |Omega|^{1/2}."""
    mesh = solved.mesh
    cells = solved.partition
    moments = flux_moments(manufactured, mesh)
    on_mesh = condense(mesh)
    to_mesh = coupling(mesh, cells).T
    errors = manufactured.errors(mesh, [u_h for u_h, _ in pairs]) / (1 + QUADRATURE)
    for pair, error in zip(pairs, errors, strict=True):
        remaining = moments - to_mesh @ pair[1]
        dual = np.sqrt(max(remaining @ on_mesh.solve_boundary(remaining), 0.0))
        lambda_error = (
            max(dual, abs(remaining.sum()) / np.sqrt(mesh.polygon.area)) / (1 + OF_MOMENTS)
            - manufactured.doubt
        )
        yield Trial((solved.data, cells, *pair, solved.form), error, lambda_error)


def make_force_trial(manufactured, solved):
    """The whole boundary, and each side.

    The moments of lambda with the hats of a side's nodes, with its ends and without, have its force between
    them.
    """
    mesh = solved.mesh
    moments = flux_moments(manufactured, solved.mesh)
    components = [[*range(mesh.polygon.n_sides)], *([side] for side in range(mesh.polygon.n_sides))]
    displaced = (
        OF_MOMENTS * np.abs(moments).sum() + 1e-12 * solved.u_norm
    )  # of the quadrature, and of rounding
    exact = []
    for component in components:
        subset = np.isin(mesh.side, component)
        inner = subset & np.roll(subset, 1)
        touching = subset | np.roll(subset, 1)
        exact.append((moments[inner].sum() - displaced, moments[touching].sum() + displaced))
    bound = solved.bound().lambda_
    free = manufactured.problem.free_sides
    return ForceTrial(mesh, solved.partition, solved.lambda_H, bound, components, exact, free)
