"""The axis h in small steps: how the work of a solve changes from one size to the next."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import xarray as xr

from unilateral.bounds.source_pieces import SOURCE_DEGREE
from unilateral.formulas.formula import parse_real
from unilateral.formulas.taylor import monomial_basis
from unilateral.geometry.polygon import square
from unilateral.problems.build import make_problem
from unilateral.solution.solver import Solver

SOURCES = {"constant f": "-1", "smooth f": "-3*exp(x)*cos(2*y)"}
"""f of each case; g = -x y / 9 on the unit square, and H = 2h."""


def survey_neighbours(study: Mapping[str, Any]) -> xr.Dataset:
    """The work of all cases at all sizes, times h^2."""
    sizes = [parse_real(h, "extremes.neighbours") for h in study["neighbours"]]
    work = [[h**2 * count_work(f, h) for h in sizes] for f in SOURCES.values()]
    return xr.Dataset(
        {"work": (("case", "mesh"), work)}, coords={"case": list(SOURCES), "h": ("mesh", sizes)}
    )


def count_work(f: str, h: float) -> float:
    """The numbers that are computed by the operator's applications, and as coefficients near f.

    An application makes a number for each unknown, and f has a polynomial on each triangle where it was
    looked at.
    """
    solution = Solver(make_problem(square(), f=f, g="-x*y/9"), h=h, H=2 * h)().solved
    assert solution.data is not None
    assert solution.data.source.ancestors is not None
    enclosed_triangles = len(solution.data.source.ancestors.polynomials.remainder)
    coefficients = len(monomial_basis(2, SOURCE_DEGREE).degrees)
    applications = solution.result.operator_applications
    return float(applications * solution.mesh.n_nodes + coefficients * enclosed_triangles)
