"""A function w of V_h near u_h whose flux by `equilibrated` has the divergence w - f on every triangle.

For u_h that is so but for what the solver left of the discrete equations, and for what the flux on the edges
leaves of lambda_H. To the error of u_h that may be nothing, and much to that of lambda_H, which is smaller.
"""

from __future__ import annotations

import numpy as np

from unilateral.arrays import Array
from unilateral.bounds.equilibrated import equilibrated
from unilateral.bounds.misfit import defects
from unilateral.bounds.source import Source
from unilateral.fem.p1 import edge_load, lumped_mass, stiffness_and_mass
from unilateral.solvers.descent import solved

SHARE = 0.01
"""Of the squares of min(h, 1) ||grad w - q||, like ||u - w||_0: what w - f - div q may have."""


def balanced(source: Source, u_h: Array, sigma: Array) -> tuple[Array, Array, Array, float]:
    """w (n,), its flux as `equilibrated` tells it, w - f_h - div q (m,), and what rounding adds to the norms.

    The flux has the values `sigma` (nb, 2) at the ends of the boundary edges, on free sides the given ones.
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
    """w with (w, psi_a)_1 = (f, psi_a) + <sigma, psi_a>, until the patches lack that of their divergence.

    A patch spreads its r_a over the area |a| of its triangles, of which at most three lie at any place: that
    is no more than sum 3 r_a^2 / |a|.
    """
    mesh = source.mesh
    stiffness, mass = stiffness_and_mass(mesh)
    rhs = source.load + edge_load(mesh, sigma)
    return solved(stiffness + mass, rhs, w, lumped_mass(mesh), least)[0]
