"""Problems with solutions made by hand: cases of the catalogue, and u from formulas."""

from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
import sympy
from conftest import discrete
from known_solutions import ForceTrial, Trial, h1_errors
from symbolic import X, Y, evaluate

from unilateral.bounds import source
from unilateral.bounds.boundary_flux import no_given_flux
from unilateral.bounds.constraint import build_constraint
from unilateral.bounds.enclosed_data import EnclosedData
from unilateral.discrete.condensed import solve_condensed_problem
from unilateral.fem.condense import condense
from unilateral.fem.form import Form
from unilateral.fem.p1 import coupling, energy_norm, load_vector
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.norms.dual import build_dual_norm
from unilateral.norms.exact_errors import cell_means
from unilateral.problems.case import ExactSolution
from unilateral.problems.obstacle_and_flux import enclose_obstacle
from unilateral.problems.side_models import side_coordinates

CASES = [
    *[(name, "square") for name in ("natural", "smooth", "thirds", "full_contact", "no_contact", "vertex")],
    *[(name, "square") for name in ("borderline_0.05", "violates_jj", "singular", "rough")],
    *[(name, "lshape") for name in ("smooth", "full_contact", "no_contact", "reentrant", "violates_j")],
]
CRUDE = (None, "zero", "noise")
"""What lambda_H may be: solved for, 0, or spoilt by noise."""
NOISE = (1e-3, 0.1, 3.0)
"""Sizes in ||.||_1 of what u_h is spoilt by."""
ROUNDING = 1e-13
"""Where lambda = lambda_H = 0 the true dual norm is rounding, and so may the bound be."""
LINEAR_SOURCE = "cosh(x - 0.4) + cosh(y - 0.55) + 0.1*x - 0.05*y"
"""-Delta u + u is linear, so f_h = f; lambda > 0 on the unit square."""


class Manufactured:
    """u from a formula and g = u - gap, gap >= 0 a formula in x, y too; no singular points.

    It is the solution where lambda = k du/dn >= 0, and 0 where gap > 0; `trace_flux_and_gap` is as in
    ExactSolution.
    """

    flux_in_L2 = True
    clamped_sides = ()

    def __init__(self, polygon, u, gap="0", k=1.0, c=1.0):
        self.polygon = polygon
        self.k = k
        self.c = c
        u = sympy.sympify(u, {"x": X, "y": Y})
        gap = sympy.sympify(gap, {"x": X, "y": Y})
        f = c * u - k * (sympy.diff(u, X, 2) + sympy.diff(u, Y, 2))
        self.jumps = {}
        self.formula = u
        self.formulas = (f, u - gap)
        self.u = sympy.lambdify((X, Y), u)
        self.u_x = sympy.lambdify((X, Y), sympy.diff(u, X))
        self.u_y = sympy.lambdify((X, Y), sympy.diff(u, Y))
        self.f = sympy.lambdify((X, Y), f)
        self.g = sympy.lambdify((X, Y), u - gap)

    def kinks(self):
        return []

    singular_points = flux_singular_points = kinks

    def transitions(self):
        return np.zeros(0)

    def trace_flux_and_gap(self, side, s, near=None):
        points = self.polygon.at(side, s).T
        (out_x, out_y) = self.polygon.normals[side].T
        u = self.u(*points) + np.zeros(len(s))
        flux = self.k * (self.u_x(*points) * out_x + self.u_y(*points) * out_y)
        return u, flux, u - self.g(*points)

    @property
    def source(self):
        return self

    def model(self, x, y, steps):
        return evaluate(self.formulas[0], {X: x, Y: y})

    def enclose_gap(self, free=()):
        return enclose_obstacle(self.polygon, self.obstacle_model, free)

    def obstacle_model(self, side, t):
        x, y = side_coordinates(self.polygon, side, t)
        return evaluate(self.formulas[1], {X: x, Y: y})

    def error(self, mesh, u_h, features=()):
        """||u - u_h||_1."""
        return h1_errors(self.formula, mesh, [u_h], features)[0]


@cache
def enclose_source(mesh, problem):
    return source.enclose_function(mesh, problem.source)


def given_to(problem, mesh, cells, u_h, lambda_H, free=()):
    """What both bounds take."""
    if isinstance(problem, ExactSolution):
        problem = problem.problem
        g = problem.enclosed_obstacle
    else:
        g = problem.enclose_gap(free)
    form = Form(free=free)
    data = EnclosedData(
        enclose_source(mesh, problem), build_constraint(g, mesh, form), no_given_flux(mesh), total_force=None
    )
    return data, cells, u_h, lambda_H, form


def u_of(problem, mesh, cells, lambda_H):
    """u_h by (5.1); (f, v) = (f_h, v) for v in V_h."""
    f = load_vector(mesh, enclose_source(mesh, problem).moments())
    f[mesh.boundary] += coupling(mesh, cells).T @ lambda_H
    return condense(mesh).solve(f)


@cache
def norm_for(name, m, polygon):
    case = discrete(name, 2 * m, m, polygon).exact.ritz.case
    return build_dual_norm(partitions.make_uniform_partition(case.polygon, 1 / m), [case])


class Pair(NamedTuple):
    """u_h and lambda_H, and their true errors: ||u - u_h||_1, and bounds of ||lambda - lambda_H||_{-1/2}."""

    case: ExactSolution
    mesh: meshes.Mesh
    cells: partitions.Partition
    u_h: np.ndarray
    lambda_H: np.ndarray
    h1_error: float
    lower: float
    upper: float

    @property
    def bound_arguments(self):
        """What both bounds take."""
        return given_to(*self[:5])

    def is_below(self, bound):
        """Neither error is larger."""
        return self.h1_error <= bound.u and self.lower <= bound.lambda_ + ROUNDING

    def add_noise(self, size, rng):
        """u_h off by a random function of that norm."""
        noise = rng.standard_normal(self.mesh.n_nodes)
        return self._replace(u_h=self.u_h + noise * (size / energy_norm(self.mesh, noise)))


@cache
def pair(name, n, polygon="square", crude=None):
    """h = 1/n, H = 2/n; lambda_H solved for, 0, or spoilt by noise, u_h always by (5.1)."""
    d = discrete(name, n, n // 2, polygon)
    mesh = d.mesh
    solution = solve_condensed_problem(d)
    lambda_H = solution.lambda_H
    rng = np.random.default_rng(n)
    if crude == "zero":
        lambda_H = np.zeros_like(lambda_H)
    elif crude == "noise":
        lambda_H = np.maximum(lambda_H + rng.normal(0, 0.3 * lambda_H.max() + 0.01, len(lambda_H)), 0)
    lambda_load = d.spaces.B.T @ lambda_H
    load = d.exact.ritz.load.copy()
    load[mesh.boundary] += lambda_load
    u_h = d.spaces.condensed.solve(load)
    dual = norm_for(name, n // 2, polygon).bound_error(d.exact.ritz.case, lambda_H[None])
    h1_error = d.exact.ritz.h1_and_dual_errors(d.exact.ritz.multiplier_load - lambda_load)[0]
    dual_lower = float(dual.lower[0])
    dual_upper = float(dual.upper[0])
    return Pair(d.exact.ritz.case, mesh, d.spaces.partition, u_h, lambda_H, h1_error, dual_lower, dual_upper)


def exact_forces(case, cells):
    """By the boundary's quadrature, over the whole boundary and over each side."""
    per_cell = cells.lengths * cell_means(case, cells).lambda_means
    per_side = np.bincount(cells.side, per_cell, cells.polygon.n_sides)
    return [per_side.sum(), *per_side]


class CatalogueSolution:
    """A case on coarse meshes; on finer ones bounds are sharp, see `test_bounds`."""

    def __init__(self, name, polygon, crude):
        """Take what lambda_H is spoilt by, see CRUDE."""
        self.pairs = [pair(name, n, polygon, crude) for n in (4, 8)]
        self.noisy = crude is None
        self.smooth = name not in ("rough", "singular", "violates_jj")

    @cached_property
    def trials(self):
        """With noise of a size in u_h its error is no less than that size less the error without."""
        trials = [
            Trial(known_pair.bound_arguments, known_pair.h1_error, known_pair.lower - ROUNDING)
            for known_pair in self.pairs
        ]
        pair = self.pairs[-1]
        for size in NOISE if self.noisy else ():
            spoilt_arguments = pair.add_noise(size, np.random.default_rng(3)).bound_arguments
            trials.append(Trial(spoilt_arguments, max(size - pair.h1_error, 0), pair.lower - ROUNDING))
        return trials

    @cached_property
    def force_trials(self):
        """With the true error in place of its bound, which is the hardest; lambda is integrated up to 1e-12.

        Where lambda is not smooth it is not integrated up to rounding.
        """
        force_trials = []
        for known_pair in self.pairs if self.smooth else ():
            sides = range(known_pair.mesh.polygon.n_sides)
            exact = [
                (force - 1e-12, force + 1e-12) for force in exact_forces(known_pair.case, known_pair.cells)
            ]
            components = [[*sides], *([side] for side in sides)]
            force_trials.append(
                ForceTrial(
                    known_pair.mesh,
                    known_pair.cells,
                    known_pair.lambda_H,
                    known_pair.upper + 1e-12,
                    components,
                    exact,
                )
            )
        return force_trials
