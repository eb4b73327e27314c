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
from study.experiments.sharpness.surfaces import join_sharpness_levels, tabulate_surfaces
from unilateral.discrete.condensed import discretise_case, solve_condensed_problem
from unilateral.errors import InputError
from unilateral.fem.condense import CondensedMatrix, condense
from unilateral.fem.spaces import mixed_spaces
from unilateral.formulas.exact_numbers import pos
from unilateral.formulas.expression import rational_expression
from unilateral.formulas.formula import parse_fraction
from unilateral.geometry.partition import Partition, make_uniform_partition
from unilateral.geometry.polygon import Polygon, find_polygon
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.dual import Gram, build_dual_norm
from unilateral.norms.exact_errors import CaseProjections, CellMeans, cell_means_of_gaps
from unilateral.norms.infsup import infsup_constants
from unilateral.norms.ritz import ritz_projections
from unilateral.problems.atoms import T
from unilateral.problems.case import ExactSolution
from unilateral.problems.polar_atoms import make_harmonic_atom
from unilateral.solvers.stop import Stop

TRANSITION_CELL_START = Fraction(1, 4)
CONTACT_LENGTH = Fraction(1, 4)
CUTOFF_GAP_EXPONENT = Fraction(3, 2)
"""The exponent of the gap beyond the cutoff. Since lambda ends there like s^4, that transition adds nothing
of lower order."""
SHARPNESS_VARIABLES = (
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


def family_cases(
    polygon: Polygon, contact_start: Fraction, alpha: Fraction, gammas: Sequence[Fraction]
) -> list[ExactSolution]:
    """Members of the family with one u on side 0, contact on CONTACT_LENGTH from `contact_start` on."""
    beyond_contact = (T - contact_start - CONTACT_LENGTH) / (1 - contact_start - CONTACT_LENGTH)
    atoms = (
        make_harmonic_atom(polygon, 0, float(contact_start), alpha, rational_expression(CONTACT_LENGTH)),
    )
    members = []
    for gamma in gammas:
        height = rational_expression(contact_start) ** gamma
        # (x_0 - t)_+^gamma before the contact, and beyond it a power that the cutoff of lambda hides
        gap = pos(contact_start - T, gamma) + height * pos(beyond_contact, CUTOFF_GAP_EXPONENT)
        gaps = (gap, *[height] * (polygon.n_sides - 1))
        members.append(
            ExactSolution(f"alpha {alpha}, gamma {gamma}, at {contact_start}", {}, polygon, atoms, gaps)
        )
    return members


def transition_positions(H: Fraction, n_positions: int) -> list[Fraction]:
    """The transitions, inside the cell of size H that begins at 1/4, in side lengths.

    Raises InputError where no cell of a uniform partition begins there.
    """
    if (TRANSITION_CELL_START / H).denominator > 1:
        raise InputError(
            f"sharpness, H: {H} does not divide {TRANSITION_CELL_START}, "
            "where the cell of the transitions begins"
        )
    return [TRANSITION_CELL_START + H * Fraction(2 * k + 1, 2 * n_positions) for k in range(n_positions)]


@dataclass(frozen=True, eq=False)
class FamilyOnPartition:
    """The family seen from a partition, whatever the mesh: by exponent alpha and place, over the gammas.

    `gram` has the columns of these u, one for each alpha and place.
    """

    partition: Partition
    positions: Sequence[Fraction]
    exponents: tuple[Sequence[Fraction], Sequence[Fraction]]
    members: list[list[list[ExactSolution]]]
    means: list[list[list[CellMeans]]]
    gram: Gram


def family_on_partition(
    partition: Partition,
    positions: Sequence[Fraction],
    exponents: tuple[Sequence[Fraction], Sequence[Fraction]],
) -> FamilyOnPartition:
    """The family with its transitions at these places, as seen from a partition."""
    alphas, gammas = exponents
    members = [[family_cases(partition.polygon, x, alpha, gammas) for x in positions] for alpha in alphas]
    means = [[cell_means_of_gaps(cases, partition) for cases in row] for row in members]
    every_u = [cases[0] for row in members for cases in row]
    return FamilyOnPartition(
        partition, positions, exponents, members, means, build_dual_norm(partition, every_u).gram(every_u)
    )


def measure(condensed: CondensedMatrix, family: FamilyOnPartition, stop: Stop) -> xr.Dataset:
    """Errors over (alpha, gamma, position) on one mesh and one partition, and what they depend on."""
    (alphas, gammas) = family.exponents
    positions = family.positions
    partition = family.partition
    gram = family.gram
    mesh = condensed.mesh
    polygon = condensed.mesh.polygon
    spaces = mixed_spaces(condensed, partition)
    beta = infsup_constants(spaces.operator, gram.p0).beta_lower
    shape = (len(alphas), len(gammas), len(positions))
    measured = {name: np.full(shape, np.nan) for name in SHARPNESS_VARIABLES}
    for a, row in enumerate(family.members):
        # Members with one alpha and one place have one u: its projection serves all gammas
        problems = ritz_projections([members[0] for members in row], condensed)
        for k, (problem, members) in enumerate(zip(problems, row, strict=True)):
            transition = polygon.arc_length(0, float(positions[k]))
            transition_cell = np.searchsorted(partition.points, transition) - 1
            for c, cells in enumerate(family.means[a][k]):
                exact = CaseProjections(replace(problem, case=members[c]), cells)
                solution = solve_condensed_problem(discretise_case(spaces, exact), stop, beta)
                errors = exact.errors(spaces, solution.result.lambda_H)
                # Both bounds on ||lambda - lambda_H||_{-1/2}, which is at least D = ||z_h - u_h||_1
                difference = cells.lambda_means - solution.lambda_H
                lower, upper = gram.error_bounds(a * len(positions) + k, difference[None])
                values = (
                    errors.h1,
                    max(float(lower[0]), errors.hm12_discrete),
                    float(upper[0]),
                    errors.l2,
                    errors.hm12_discrete,
                    exact.ritz_means_norm(spaces),
                    float(solution.lambda_H[transition_cell] > 0),
                    cells.consistency,
                    solution.result.bound,
                    float(solution.result.converged),
                )
                for name, value in zip(SHARPNESS_VARIABLES, values, strict=True):
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
    domain = find_polygon(study["polygon"])
    fixed = study["fixed"]
    alphas = [parse_fraction(exponent, "sharpness.alphas") for exponent in study["alphas"]]
    gammas = [parse_fraction(exponent, "sharpness.gammas") for exponent in study["gammas"]]
    chosen = Stop(**stop, algorithm=study["algorithm"])
    parameters = {"sharpness": study, "stop": stop}

    @cache
    def condensed_mesh(h: Fraction) -> CondensedMatrix:
        """The structured mesh of the size h, condensed."""
        return condense(make_structured_mesh(domain, float(h)))

    @cache
    def family(H: Fraction) -> FamilyOnPartition:
        """The family on the uniform partition of the size H."""
        return family_on_partition(
            make_uniform_partition(domain, float(H)),
            transition_positions(H, study["positions"]),
            (alphas, gammas),
        )

    @cache
    def solve_level(h: Fraction, H: Fraction) -> xr.Dataset:
        """Errors of all members on one pair."""
        solved = measure(condensed_mesh(h), family(H), chosen)
        print(f"h = {h}, H = {H} solved")
        return solved

    def save_levels(levels: Sequence[xr.Dataset], to_errors: str, to_rates: str) -> None:
        """Write the errors of all levels, and their rates."""
        table = join_sharpness_levels(levels)
        tables.save_table(table, to_errors, "sharpness", parameters)
        tables.save_table(tabulate_surfaces(table), to_rates, "sharpness", parameters)

    ratio = parse_fraction(study["h_over_H"], "sharpness.h_over_H")
    sizes = [parse_fraction(H, "sharpness.H") for H in study["H"]]
    save_levels([solve_level(ratio * H, H) for H in sizes], errors, rates)
    h = parse_fraction(fixed["h"], "sharpness.fixed.h")
    sizes = [parse_fraction(H, "sharpness.fixed.H") for H in fixed["H"]]
    save_levels([solve_level(h, H) for H in sizes], fixed_errors, fixed_rates)
