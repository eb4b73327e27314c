"""A function w of V_h near u_h whose flux by `equilibrated` has the divergence w - f on every triangle.

For u_h itself this holds up to what the solver left of the discrete equations and what the flux on the edges
leaves of lambda_H. This may be nothing beside the error of u_h, and much beside the error of lambda_H, which
is smaller.
"""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array
from unilateral.bounds.equilibrated_flux import equilibrated
from unilateral.bounds.flux_residuals import defects
from unilateral.bounds.source import Source
from unilateral.fem.linear_systems import solved
from unilateral.fem.p1 import edge_load, lumped_mass, stiffness_and_mass

SHARE = 0.01
"""||w - f - div q||^2 may be this fraction of the sum over the triangles of min(h, 1)^2 ||grad w - q||^2.

That sum is like ||u - w||_0^2.
"""


def balanced(source: Source, u_h: Array, sigma: Array) -> tuple[Array, Array, Array, float]:
    """w (n,), its flux as `equilibrated` gives it, w - f_h - div q (m,), and what rounding adds to the norms.

    The flux has the values `sigma` (nb, 2) at the ends of the boundary edges; on free sides these are given.
    """
    w = u_h
    for last in (False, True):
        q = equilibrated(source.mesh, w, source.moments_on, sigma)
        of_gradient, residual, rounding = defects(source, w, q)
        sizes = np.minimum(source.mesh.longest_edges, 1.0)
        least = max(SHARE * float(sizes**2 @ of_gradient), rounding**2)
        if last or source.mesh.areas @ residual**2 <= least:
            break
        w = _solved(source, w, sigma, least)
    return w, q, residual, rounding


def _solved(source: Source, w: Array, sigma: Array, least: float) -> Array:
    """w with (w, psi_a)_1 = (f, psi_a) + <sigma, psi_a>, up to an error that div q may have.

    Let r_a be what is left of this equation. Patch a spreads it over the area |a| of its triangles, and at
    most three patches lie at any place. So the square of what div q lacks is at most sum 3 r_a^2 / |a|, which
    is brought down to `least`.
    """
    mesh = source.mesh
    stiffness, mass = stiffness_and_mass(mesh)
    rhs = source.load + edge_load(mesh, sigma)
    return solved(stiffness + mass, rhs, w, lumped_mass(mesh), least)[0]
