"""Where Theorem 1 is sharp: contact on one half of each cell and a gap on the other, between t = 1/4 and 3/4.

lambda = s^alpha (1 - (s/l)^2)_+^4 and the gap is like s^gamma, l = H/2, so that u and g change with H. Their
norms in H^alpha and in H^gamma stay bounded, and the consistency term is like H^{alpha + gamma}.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import sympy
import xarray as xr

from unilateral.fem.condense import condense
from unilateral.formulas.symbolic import pos
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import uniform
from unilateral.geometry.polygon import Polygon
from unilateral.norms.ritz import ritz_projection
from unilateral.problems.atoms import T
from unilateral.problems.case import Case
from unilateral.problems.harmonic import harmonic
from unilateral.solvers.stop import Stop
from unilateral.study.experiments.cells.measure import MEASURED, on_partition

INSET = sympy.Rational(1, 4)


def alternating(
    polygon: Polygon, H: sympy.Expr, alpha: sympy.Expr, gammas: Sequence[sympy.Expr]
) -> list[Case]:
    """Cases with one u on side 0, and a gap for each exponent; H divides 1/4, in side lengths."""
    starts = [INSET + k * H for k in range(int((1 - 2 * INSET) / H))]
    atoms = tuple(harmonic(polygon, 0, start, alpha, H / 2) for start in starts)
    found = []
    for gamma in gammas:
        tents = [pos((T - a - H / 2) * (a + H - T), gamma) / (H / 2) ** gamma for a in starts]
        gap = sympy.Add(pos(INSET - T, gamma), pos(T - 1 + INSET, gamma), *tents)
        gaps = (gap, *[INSET**gamma] * (polygon.n_sides - 1))
        found.append(Case(f"gamma {gamma}, H {H}", {}, polygon, atoms, gaps))
    return found


def measure(
    mesh: Mesh, sizes: Sequence[sympy.Expr], alpha: sympy.Expr, gammas: Sequence[sympy.Expr], stop: Stop
) -> xr.Dataset:
    """Errors over (partition, gamma), on one mesh."""
    condensed, found = condense(mesh), []
    for H in sizes:
        cases = alternating(mesh.polygon, H, alpha, gammas)
        ritz = ritz_projection(cases[0], condensed)
        found.append(on_partition(condensed, cases, ritz, uniform(mesh.polygon, float(H)), stop))
    values = np.array(found)
    table = {name: (("partition", "gamma"), values[..., k]) for k, name in enumerate(MEASURED)}
    coords = {"gamma": [float(each) for each in gammas], "h": mesh.h, "alpha": float(alpha)}
    return xr.Dataset(table, coords=coords | {"H": ("partition", [float(H) for H in sizes])})
