"""w of V_h, u_h or near it, from which the sharp bound begins, and the flux by `equilibrate_flux` for w.

What a solver left of the discrete equations, and what the flux on the edges leaves of lambda_H, may be
nothing beside the error of u_h, and much beside the error of lambda_H, which is smaller. So w solves these
equations up to a fraction of that.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, row_blocks
from unilateral.bounds.flux_residuals import SUM_ROUNDING
from unilateral.bounds.local_bounds import equilibrate_source
from unilateral.bounds.source import Source
from unilateral.fem.form import Form
from unilateral.fem.p1 import lumped_mass
from unilateral.fem.p2 import QuadraticForm, QuadraticSpace, quadratic_space
from unilateral.geometry.mesh import Mesh
from unilateral.solvers.energy_descent import HatMatrix, build_hat_matrix

MAX_IMBALANCE_FRACTION = 0.01
"""The square of what w leaves of the discrete equations may be this fraction of two others.

They are the squared error of w in L2 over W^4, for W with ||z||_0 <= W |||z|||, and that of what is not known
of f.
"""


class Energy(NamedTuple):
    """P2 on a mesh, its form, and the matrix of the form on V_h."""

    spaces: QuadraticSpace
    quadratic_form: QuadraticForm
    hat_matrix: HatMatrix

    def residual(self, v: Array, f_h: Array, flux: Array) -> Array:
        """The residual (f_h, z) + <flux, z> - k (grad v, grad z) - c (v, z) of v (size,); shape (size,).

        z are the basis functions. f_h (m, 3) is linear on triangles, and the flux (nb, 2) on boundary edges.
        """
        residual = self.spaces.load(f_h)
        residual += self.spaces.edge_load(flux)
        residual -= self.quadratic_form.apply(v)
        return residual


def build_energy(mesh: Mesh, form: Form) -> Energy:
    """The energy of a form on P2 of a mesh."""
    spaces = quadratic_space(mesh)
    return Energy(spaces, spaces.quadratic_form(form), build_hat_matrix(mesh, form))


def balance_potential(source: Source, u_h: Array, sigma: Array, energy: Energy) -> tuple[Array, Array]:
    """w (n,), u_h or a better solution of the discrete equations, and the flux by `equilibrate_flux` for w.

    The flux has the values `sigma` (nb, 2) at the ends of the boundary edges; on free sides these are given.
    """
    mesh = source.mesh
    form = energy.quadratic_form.form
    # what u_h leaves of k (grad w, grad z) + c (w, z) = (f, z) + <sigma, z> for all z of P2 with z = u_D = 0
    r = energy.residual(energy.spaces.embed_linear(u_h), source.f_h, sigma)
    r[energy.spaces.boundary_unknowns[np.tile(form.clamped_edges(mesh), 2)]] = 0.0
    r[: mesh.n_nodes][form.clamped_nodes(mesh)] = 0.0
    hat_residual, bubble_residual = np.split(r, [mesh.n_nodes])
    # S has M_T + E_T: a mean far below E_T hardly counts, nor does one far below the error
    square_error = _estimate_square_error(mesh, bubble_residual, energy.quadratic_form)
    tolerance = max(
        MAX_IMBALANCE_FRACTION * max(square_error, float(source.remainder @ source.remainder)),
        _estimate_square_rounding(source, u_h, form),
    )
    # patch a spreads r_a evenly over the area |a| of its triangles, and at most three patches lie at any
    # place: so the square of what div q lacks is at most sum 3 r_a^2 / |a|
    w = u_h + energy.hat_matrix.solve(hat_residual, lumped_mass(mesh), tolerance)
    return w, equilibrate_source(source, w, sigma, form)


def _estimate_square_error(mesh: Mesh, bubble_residual: Array, quadratic_form: QuadraticForm) -> float:
    """An estimate of the squared error of u_h in L2 over W^4, from the residual (edges,) on bubbles."""
    form = quadratic_form.form
    W = form.value_constant
    start, end = mesh.triangulation.ends.T
    x, y = mesh.points.T
    lengths = np.hypot(x.take(end) - x.take(start), y.take(end) - y.take(start))
    # the energy norm of u - u_h is about that of the bubbles r_b / ||b||^2; k^{-1/2} min(h / W, k^{1/2}) / W
    # times that is nearly the norm of u - u_h in L2 over W^2
    energy_squares = bubble_residual**2 / quadratic_form.nodal_squares[mesh.n_nodes :]
    factors = np.minimum(lengths / W, math.sqrt(form.k)) ** 2 / (form.k * W**2)
    return float(factors @ energy_squares)


def _estimate_square_rounding(source: Source, w: Array, form: Form) -> float:
    """About the square of the part of E that is what rounding may do to f_h + div q - c w."""
    mesh = source.mesh
    square = 0.0
    for block in row_blocks(len(mesh.triangles)):
        area = mesh.areas[block]
        values = w.take(mesh.triangles[block].T)
        rise = values.max(axis=0) - values.min(axis=0)
        # flows are some k |grad w| times an edge, and |grad w| is at most rise times an edge over |T|
        f_h = np.ascontiguousarray(source.f_h[block].T)
        size = form.c * np.abs(values).max(axis=0) + np.abs(f_h).max(axis=0)
        size += form.k * rise * (mesh.longest_edges[block] / area) ** 2
        square += SUM_ROUNDING**2 * float(area @ size**2)
    return square
