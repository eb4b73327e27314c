"""The axis c/k: errors and guaranteed bounds of four problems, from no reaction to almost no diffusion.

k = 1 throughout. Errors are in the energy norm, |||v|||^2 = |v|_1^2 + c ||v||_0^2. They are known: by
quadrature where u is smooth for every c, and in closed form where u depends on x alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from scipy.special import ive

from study.experiments.extremes.problem import structured_square
from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.fem.form import Form
from unilateral.fem.p1 import energy_norm, gradients, stiffness_and_mass
from unilateral.fem.quadrature import symmetric_rule
from unilateral.formulas.formula import parse_real
from unilateral.geometry.mesh import Mesh
from unilateral.problems.build import make_problem
from unilateral.problems.problem import Problem
from unilateral.solution.solver import Solver

BOTTOM_SIDE, RIGHT_SIDE, TOP_SIDE, LEFT_SIDE = range(4)
"""The sides of the unit square."""
SMOOTH_FORMULA = "sin(x)*y + x**2"
ERROR_RULE_DEGREE = 8
"""The degree of the quadrature of smooth errors."""
VANISHING_C = 1e-300
"""Stands for c = 0 in closed forms, which are quotients of numbers that vanish with c."""


@dataclass(frozen=True)
class SmoothCase:
    """u = sin(x) y + x^2 for every c, given on all sides, or with `has_contact` on x = 1 and y = 1.

    There g = u, and du/dn is not negative.
    """

    has_contact: bool

    def pose(self, mesh: Mesh, c: float) -> Problem:
        """The problem with this u, whose Laplacian is 2 - sin(x) y."""
        contact_sides = (RIGHT_SIDE, TOP_SIDE) if self.has_contact else ()
        return make_problem(
            mesh,
            f=f"sin(x)*y - 2 + {c!r}*({SMOOTH_FORMULA})",
            g=[SMOOTH_FORMULA if side in contact_sides else None for side in range(4)],
            u={side: SMOOTH_FORMULA for side in range(4) if side not in contact_sides},
            c=c,
        )

    def error(self, mesh: Mesh, u_h: Array, c: float) -> float:
        """|||u - u_h||| of the values u_h (n,) at nodes, by quadrature on every triangle."""
        barycentric, weights = symmetric_rule(ERROR_RULE_DEGREE)
        x, y = np.moveaxis(barycentric @ mesh.points[mesh.triangles], -1, 0)
        nodal = u_h[mesh.triangles]
        slopes = np.einsum("tid,ti->td", gradients(mesh), nodal)
        value = np.sin(x) * y + x**2 - nodal @ barycentric.T
        along_x = np.cos(x) * y + 2 * x - slopes[:, :1]
        along_y = np.sin(x) - slopes[:, 1:]
        return math.sqrt(mesh.areas @ ((along_x**2 + along_y**2 + c * value**2) @ weights))


@dataclass(frozen=True)
class StepCase:
    """f = c w + s, with w in V_h a function of x alone, and s a constant.

    For c = 1/dt this is a step of implicit Euler from w, with the heat source s. u = 0 on x = 0 and x = 1,
    and du/dn = 0 on the other two sides, so that u depends on x alone.

    Parameters
    ----------
    w
        The values of w at nodes with these x; 0 at x = 0 and x = 1.
    s
        The constant for a given c.
    """

    w: Callable[[Array], Array]
    s: Callable[[float], float]

    def pose(self, mesh: Mesh, c: float) -> Problem:
        """The problem with f by its values at nodes.

        Their rounding changes u by at most 2^-53 max |w|, and its error by less than 0.1 % up to c = 1e16.
        """
        return make_problem(
            mesh,
            f=c * self.w(mesh.points[:, 0]) + self.s(c),
            g=None,
            free_sides=[BOTTOM_SIDE, TOP_SIDE],
            u={RIGHT_SIDE: 0, LEFT_SIDE: 0},
            c=c,
        )

    def error(self, mesh: Mesh, u_h: Array, c: float) -> float:
        """|||u - u_h||| of the values u_h (n,) at nodes, 0 at x = 0 and x = 1, in closed form.

        Let e = w - u_h and a(v, z) = (grad v, grad z) + c (v, z). For z in V
        a(u - w, z) = s (1, z) - (grad w, grad z), and so
        |||u - u_h|||^2 = |||u - w|||^2 + 2 s (1, e) - 2 (grad w, grad e) + |||e|||^2.
        """
        s = self.s(c)
        w = self.w(mesh.points[:, 0])
        e = w - u_h
        stiffness, mass = stiffness_and_mass(mesh)
        # s (1, e) - (grad w, grad e), for |||u - u_h|||^2 = |||u - w|||^2 + 2 mixed + |||e|||^2
        mixed = s * mass.sum(axis=0) @ e - w @ (stiffness @ e)
        return math.sqrt(
            self.squared_distance_to_w(mesh, c) + 2 * mixed + energy_norm(mesh, e, Form(c=c)) ** 2
        )

    def squared_distance_to_w(self, mesh: Mesh, c: float) -> float:
        """|||u - w|||^2.

        -(u - w)'' + c (u - w) = s + sum_i J_i delta(x - x_i) with the jumps J_i of w' at x_i. So
        u - w = s p + sum_i J_i G(., x_i), with p for the right side 1 and Green's function G, and the square
        of its norm is s^2 int p + 2 s sum_i J_i p(x_i) + sum_ij J_i J_j G(x_i, x_j).
        """
        s = self.s(c)
        m = math.sqrt(max(c, VANISHING_C))
        ticks = np.unique(mesh.points[:, 0])
        x = ticks[1:-1]
        jumps = np.diff(np.diff(self.w(ticks)) / np.diff(ticks))
        # p = (1 - cosh(m (x - 1/2)) / cosh(m / 2)) / m^2, without cancellation or overflow
        p = np.expm1(-m * x) * np.expm1(-m * (1 - x)) / (m**2 * (1 + math.exp(-m)))
        # int p = (z - tanh z) / (4 z^3) with z = m / 2, and z cosh z - sinh z = (pi z^3 / 2)^(1/2) I_{3/2}(z)
        z = m / 2
        p_integral = math.sqrt(math.pi / (8 * z)) / (z * (1 + math.exp(-m))) * float(ive(1.5, z))
        # G = sinh(m a) sinh(m (1 - b)) / (m sinh m) with a the smaller and b the larger of x_i, x_j
        a = np.minimum.outer(x, x)
        b = np.maximum.outer(x, x)
        G = np.exp(-m * (b - a)) * np.expm1(-2 * m * a) * np.expm1(-2 * m * (1 - b))
        G /= -2 * m * math.expm1(-2 * m)
        return float(s**2 * p_integral + 2 * s * jumps @ p + jumps @ G @ jumps)


REACTION_CASES: dict[str, SmoothCase | StepCase] = {
    "smooth, clamped": SmoothCase(has_contact=False),
    "smooth, contact": SmoothCase(has_contact=True),
    "boundary layers": StepCase(w=np.zeros_like, s=lambda c: 1 + c),
    "time step": StepCase(w=lambda x: x * (1 - x), s=lambda c: 1.0),
}
"""The cases; for c = 0 the last two are the same problem."""


def survey_reaction(study: Mapping[str, Any]) -> xr.Dataset:
    """Errors and bounds of all cases on all meshes, for c = 0 and all other c."""
    sizes = [parse_real(h, "extremes.reaction.h") for h in study["h"]]
    ratios = [0.0, *map(float, study["c_over_k"])]
    points = [measure(case, h, c) for case in REACTION_CASES.values() for h in sizes for c in ratios]
    shape = (len(REACTION_CASES), len(sizes), len(ratios))
    table = {name: np.array([point[name] for point in points]).reshape(shape) for name in points[0]}
    return xr.Dataset(
        {name: (("case", "mesh", "c_over_k"), values) for name, values in table.items()},
        coords={"case": list(REACTION_CASES), "h": ("mesh", sizes), "c_over_k": ratios},
    )


def measure(case: SmoothCase | StepCase, h: float, c: float) -> dict[str, Any]:
    """Error and bounds of u_h on a structured mesh with H = 2h, or NaN and the reason why there are none."""
    mesh = structured_square(h)
    try:
        solution = Solver(case.pose(mesh, c), H=2 * h)().bounded
        bounds = {
            "cheap_bound": solution.total_bound("h1"),
            "sharp_bound": solution.total_bound("h1", sharp=True),
        }
        error = case.error(mesh, solution.u_h, c)
        return {"energy_error": error, **bounds, "message": ""}
    except InputError as fault:
        unknown = dict.fromkeys(("energy_error", "cheap_bound", "sharp_bound"), math.nan)
        return {**unknown, "message": str(fault)}
