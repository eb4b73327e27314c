"""What the size of the cells alone does, on one mesh, where there are many transitions.

At a Cantor set there are infinitely many. It looks the same on scales a factor of `period` apart, and so
rates are formed over one period, from each of several sizes of the cells. Theorem 1 is sharp where each cell
has a transition: contact on one half and a gap on the other. Cases with one u differ in g, so that what
depends on u alone is found once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import xarray as xr

from study import scenes, tables
from unilateral.arrays import Array
from unilateral.discrete.condensed import discretise_case, solve_condensed_problem
from unilateral.errors import InputError
from unilateral.fem.condense import CondensedMatrix, condense
from unilateral.fem.spaces import mixed_spaces
from unilateral.formulas.exact_numbers import pos
from unilateral.formulas.expression import rational_expression, sum_terms
from unilateral.formulas.formula import parse_fraction, parse_real
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, make_uniform_partition
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.exact_errors import CaseProjections, cell_means_of_gaps
from unilateral.norms.ritz import RitzProjection, ritz_projection
from unilateral.problems.atoms import T
from unilateral.problems.cantor_atom import CantorAtom
from unilateral.problems.case import ExactSolution
from unilateral.problems.polar_atoms import make_harmonic_atom
from unilateral.solvers.stop import Stop

CELL_VARIABLES = ("discrete_error", "consistency", "algebraic_bound", "quadrature_share", "converged")
ALTERNATING_START = Fraction(1, 4)
"""Alternating contact lies on side 0 between this share of it and one minus this share."""


def measure_cells(study: Mapping[str, Any], stop: Mapping[str, Any], errors: str, alternating: str) -> None:
    """Write the errors at a Cantor set, and those with a transition in each cell."""
    domain = scenes.scene_polygon(study)
    chosen = Stop(**stop, algorithm=study["algorithm"])
    parameters = {"cells": study, "stop": stop}
    alternating_study = study["alternating"]
    mesh = make_structured_mesh(domain, parse_real(study["h"], "cells.h"))
    sizes = [parse_real(H, "cells.H") for H in study["H"]]
    table = measure(mesh, scenes.load_cases(study), sizes, study["period"], chosen)
    tables.save_table(table, errors, "cells", parameters)
    mesh = make_structured_mesh(domain, parse_real(alternating_study["h"], "cells.alternating.h"))
    where = "cells.alternating"
    alternating_sizes = [parse_fraction(x, where) for x in alternating_study["H"]]
    gammas = [parse_fraction(x, where) for x in alternating_study["gammas"]]
    table = measure_alternating(
        mesh, alternating_sizes, parse_fraction(alternating_study["alpha"], where), gammas, chosen
    )
    tables.save_table(table, alternating, "cells", parameters)


def measure(
    mesh: Mesh, cases: Sequence[ExactSolution], sizes: Sequence[float], period: int, stop: Stop
) -> xr.Dataset:
    """Errors over (case, start, level): on cells of each of the sizes, and of that size over the period.

    Raises InputError where the cases do not have one u, which is a Cantor atom.
    """
    flux_orders = []  # sigma of Theorem 1
    for case in cases:
        (atom,) = case.atoms
        if not isinstance(atom, CantorAtom) or case.declaration["u"] != cases[0].declaration["u"]:
            raise InputError(f"cells, cases: '{case.name}' needs the u of '{cases[0].name}', one cantor atom")
        flux_orders.append(atom.flux_order)
    condensed = condense(mesh)
    ritz = ritz_projection(cases[0], condensed)
    H = np.array(sizes)[:, None] / [1.0, period]  # by start and level
    measured = np.array(
        [
            [
                measure_partition(condensed, cases, ritz, make_uniform_partition(mesh.polygon, size), stop)
                for size in row
            ]
            for row in H
        ]
    )
    by_name = measured.transpose(3, 2, 0, 1)
    dims = ("case", "start", "level")
    table = {name: (dims, values) for name, values in zip(CELL_VARIABLES, by_name, strict=True)}
    return xr.Dataset(
        table
        | {
            "flux_order": ("case", np.array(flux_orders, dtype=float)),
            "gap_order": ("case", np.array([case.gap_order for case in cases], dtype=float)),
            "ritz_error": ((), ritz.ritz_error),
        },
        coords={"case": [case.name for case in cases], "h": mesh.h, "H": (("start", "level"), H)},
    )


def measure_partition(
    condensed: CondensedMatrix,
    cases: Sequence[ExactSolution],
    ritz: RitzProjection,
    partition: Partition,
    stop: Stop,
) -> Array:
    """Errors (case, variable) on one partition, in the order of `CELL_VARIABLES`."""
    spaces = mixed_spaces(condensed, partition)
    rows = []
    for case, cells in zip(cases, cell_means_of_gaps(cases, partition), strict=True):
        exact = CaseProjections(replace(ritz, case=case), cells)
        result = solve_condensed_problem(discretise_case(spaces, exact), stop).result
        errors = exact.errors(spaces, result.lambda_H)
        solved = (result.bound, errors.quadrature_share, float(result.converged))
        rows.append((errors.hm12_discrete, cells.consistency, *solved))
    return np.array(rows)


def alternating_cases(
    polygon: Polygon, H: Fraction, alpha: Fraction, gammas: Sequence[Fraction]
) -> list[ExactSolution]:
    """Cases with one u on side 0, and a gap for each exponent; H divides 1/4, in side lengths.

    Between t = 1/4 and 3/4 lambda = s^alpha (1 - (s/l)^2)_+^4 on one half of each cell, l = H/2. The gap is
    like s^gamma on the other half, so that u and g change with H. Their norms in H^alpha and in H^gamma stay
    bounded, and the consistency term is like H^{alpha + gamma}.
    """
    starts = [ALTERNATING_START + k * H for k in range(int((1 - 2 * ALTERNATING_START) / H))]
    atoms = tuple(
        make_harmonic_atom(polygon, 0, float(start), alpha, rational_expression(H / 2)) for start in starts
    )
    cases = []
    for gamma in gammas:
        # The gap is 0 between t = 1/4 and 3/4 but on the second half of each cell: there it is
        # ((t - a - H/2) (a + H - t) / (H/2))^gamma, like s^gamma at both of its ends
        gap_terms = [pos(ALTERNATING_START - T, gamma), pos(T - 1 + ALTERNATING_START, gamma)]
        gap_terms += [
            pos((T - a - H / 2) * (a + H - T), gamma) / rational_expression(H / 2) ** gamma for a in starts
        ]
        gap = sum_terms(term for expression in gap_terms for term in expression.terms)
        gaps = (gap, *[rational_expression(ALTERNATING_START) ** gamma] * (polygon.n_sides - 1))
        cases.append(ExactSolution(f"gamma {gamma}, H {H}", {}, polygon, atoms, gaps))
    return cases


def measure_alternating(
    mesh: Mesh, sizes: Sequence[Fraction], alpha: Fraction, gammas: Sequence[Fraction], stop: Stop
) -> xr.Dataset:
    """Errors over (partition, gamma), on one mesh."""
    condensed = condense(mesh)
    rows = []
    for H in sizes:
        cases = alternating_cases(mesh.polygon, H, alpha, gammas)
        ritz = ritz_projection(cases[0], condensed)
        rows.append(
            measure_partition(condensed, cases, ritz, make_uniform_partition(mesh.polygon, float(H)), stop)
        )
    values = np.array(rows)
    table = {name: (("partition", "gamma"), values[..., k]) for k, name in enumerate(CELL_VARIABLES)}
    coords = {"gamma": [float(gamma) for gamma in gammas], "h": mesh.h, "alpha": float(alpha)}
    return xr.Dataset(table, coords=coords | {"H": ("partition", [float(H) for H in sizes])})
