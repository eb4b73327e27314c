"""How sharp estimates are within a family: lambda ~ s_+^alpha and a gap ~ s_-^gamma at a transition.

The transition is put at n places (k + 1/2)/n of a cell, the same on every level, and errors are averaged over
them: a rate between levels is then not one of the position. u is a harmonic atom whose cutoff ends contact.
Whether the hypotheses (j) and (jj) hold depends on the exponents. Levels are of h and H together, or of H
alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import xarray as xr

from study import tables
from study.experiments.sharpness.surfaces import along_levels, rates_over
from unilateral.discrete.condensed import solve, with_solution
from unilateral.errors import InputError
from unilateral.fem.condense import Condensed, condense
from unilateral.fem.spaces import mixed_spaces
from unilateral.formulas.exact_numbers import pos
from unilateral.formulas.expression import number
from unilateral.formulas.formula import fraction
from unilateral.geometry.partition import Partition, uniform
from unilateral.geometry.polygon import Polygon, named
from unilateral.geometry.structured import structured
from unilateral.norms.dual import Gram, dual_norm
from unilateral.norms.exact_errors import CellMeans, Exact, cell_means_of_gaps
from unilateral.norms.infsup import infsup
from unilateral.norms.ritz import ritz_projections
from unilateral.problems.atoms import T
from unilateral.problems.case import ExactSolution
from unilateral.problems.polar_atoms import harmonic
from unilateral.solvers.stop import Stop

START = Fraction(1, 4)
CUTOFF = Fraction(1, 4)
END = Fraction(3, 2)
"""The exponent of the gap beyond the cutoff. Since lambda ends there like s^4, that transition adds nothing
of lower order."""
MEASURED = (
    "h1_error",
    "hm12_error_lower",
    "hm12_error_upper",
    "l2_error",
    "discrete_error",
    "ritz_means",
    "held",
    "consistency",
    "algebraic_bound",
    "converged",
)


def transitions(
    polygon: Polygon, at: Fraction, alpha: Fraction, gammas: Sequence[Fraction]
) -> list[ExactSolution]:
    """Members of the family with one u on side 0, contact from `at` to `at` + CUTOFF, in side lengths."""
    rest = (T - at - CUTOFF) / (1 - at - CUTOFF)
    atoms = (harmonic(polygon, 0, float(at), alpha, number(CUTOFF)),)
    members = []
    for gamma in gammas:
        height = number(at) ** gamma
        gap = pos(at - T, gamma) + height * pos(rest, END)
        gaps = (gap, *[height] * (polygon.n_sides - 1))
        members.append(ExactSolution(f"alpha {alpha}, gamma {gamma}, at {at}", {}, polygon, atoms, gaps))
    return members


def places(H: Fraction, positions: int) -> list[Fraction]:
    """The transitions, inside the cell of size H that begins at START, in side lengths.

    Raises InputError where no cell of a uniform partition begins there.
    """
    if (START / H).denominator > 1:
        raise InputError(
            f"sharpness, H: {H} does not divide {START}, where the cell of the transitions begins"
        )
    return [START + H * Fraction(2 * k + 1, 2 * positions) for k in range(positions)]


@dataclass(frozen=True, eq=False)
class SeenFamily:
    """The family seen from a partition, whatever the mesh: by exponent alpha and place, over the gammas.

    `gram` has the columns of these u, one for each alpha and place.
    """

    partition: Partition
    at: Sequence[Fraction]
    exponents: tuple[Sequence[Fraction], Sequence[Fraction]]
    members: list[list[list[ExactSolution]]]
    means: list[list[list[CellMeans]]]
    gram: Gram


def seen(
    partition: Partition,
    at: Sequence[Fraction],
    exponents: tuple[Sequence[Fraction], Sequence[Fraction]],
) -> SeenFamily:
    """The family with its transitions at these places, as seen from a partition."""
    alphas, gammas = exponents
    members = [[transitions(partition.polygon, x, alpha, gammas) for x in at] for alpha in alphas]
    means = [[cell_means_of_gaps(cases, partition) for cases in row] for row in members]
    every_u = [cases[0] for row in members for cases in row]
    return SeenFamily(partition, at, exponents, members, means, dual_norm(partition, every_u).gram(every_u))


def measure(condensed: Condensed, of: SeenFamily, stop: Stop) -> xr.Dataset:
    """Errors over (alpha, gamma, position) on one mesh and one partition, and what they depend on."""
    (alphas, gammas) = of.exponents
    at = of.at
    partition = of.partition
    gram = of.gram
    mesh = condensed.mesh
    polygon = condensed.mesh.polygon
    spaces = mixed_spaces(condensed, partition)
    beta = infsup(spaces.operator, gram.p0).beta_lower
    measured = {name: np.full((len(alphas), len(gammas), len(at)), np.nan) for name in MEASURED}
    for a, row in enumerate(of.members):
        problems = ritz_projections([members[0] for members in row], condensed)
        for k, (problem, members) in enumerate(zip(problems, row, strict=True)):
            crossed = np.searchsorted(partition.points, polygon.arc_length(0, float(at[k]))) - 1
            for c, cells in enumerate(of.means[a][k]):
                exact = Exact(replace(problem, case=members[c]), cells)
                solution = solve(with_solution(spaces, exact), stop, beta)
                errors = exact.errors(spaces, solution.result.lambda_H)
                difference = cells.lambda_means - solution.lambda_H
                lower, upper = gram.error(a * len(at) + k, difference[None])
                values = (
                    errors.h1,
                    max(float(lower[0]), errors.hm12_discrete),
                    float(upper[0]),
                    errors.l2,
                    errors.hm12_discrete,
                    exact.ritz_means(spaces),
                    float(solution.lambda_H[crossed] > 0),
                    cells.consistency,
                    solution.result.bound,
                    float(solution.result.converged),
                )
                for name, value in zip(MEASURED, values, strict=True):
                    measured[name][a, c, k] = value
    table = {name: (("alpha", "gamma", "position"), values) for name, values in measured.items()}
    coords = {"alpha": [float(x) for x in alphas], "gamma": [float(x) for x in gammas]}
    sizes = {"h": mesh.h, "H": partition.H, "beta_lower": beta, "lambda_min": spaces.operator.lambda_min}
    return xr.Dataset(table, coords=coords).assign({name: ((), value) for name, value in sizes.items()})


def measure_sharpness(
    study: Mapping[str, Any],
    stop: Mapping[str, Any],
    errors: str,
    rates: str,
    fixed_errors: str,
    fixed_rates: str,
) -> None:
    """Write errors and rates along h/H, and along H at one h. A pair that both have is solved once."""
    domain = named(study["polygon"])
    fixed = study["fixed"]
    alphas = [fraction(each, "sharpness.alphas") for each in study["alphas"]]
    gammas = [fraction(each, "sharpness.gammas") for each in study["gammas"]]
    chosen = Stop(**stop, algorithm=study["algorithm"])
    given = {"sharpness": study, "stop": stop}

    @cache
    def on_mesh(h: Fraction) -> Condensed:
        return condense(structured(domain, float(h)))

    @cache
    def on_partition(H: Fraction) -> SeenFamily:
        return seen(uniform(domain, float(H)), places(H, study["positions"]), (alphas, gammas))

    @cache
    def level(h: Fraction, H: Fraction) -> xr.Dataset:
        solved = measure(on_mesh(h), on_partition(H), chosen)
        print(f"h = {h}, H = {H} solved")
        return solved

    def save(levels: Sequence[xr.Dataset], to_errors: str, to_rates: str) -> None:
        table = along_levels(levels)
        tables.save(table, to_errors, "sharpness", given)
        tables.save(rates_over(table), to_rates, "sharpness", given)

    ratio = fraction(study["h_over_H"], "sharpness.h_over_H")
    sizes = [fraction(H, "sharpness.H") for H in study["H"]]
    save([level(ratio * H, H) for H in sizes], errors, rates)
    h = fraction(fixed["h"], "sharpness.fixed.h")
    sizes = [fraction(H, "sharpness.fixed.H") for H in fixed["H"]]
    save([level(h, H) for H in sizes], fixed_errors, fixed_rates)
