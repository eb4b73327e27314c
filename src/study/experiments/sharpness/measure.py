"""How sharp estimates are within a family: lambda ~ s_+^alpha and a gap ~ s_-^gamma at a transition.

The transition is put at n places (k + 1/2)/n of a cell, the same on every level, and errors are averaged over
them: a rate between levels is then not one of the position. u is a harmonic atom whose cutoff ends contact.
Whether the hypotheses (j) and (jj) hold depends on the exponents. Levels are of h and H together, or of H
alone.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import xarray as xr

from study import tables
from study.experiments.sharpness.surfaces import join_sharpness_levels, tabulate_surfaces
from study.stability_constants import bound_multiplier_error
from unilateral.arrays import Array
from unilateral.discrete.condensed import discretise_case, solve_condensed_problem
from unilateral.errors import InputError
from unilateral.fem.condense import CondensedMatrix, condense
from unilateral.fem.spaces import MixedSpaces, mixed_spaces
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
    spaces = mixed_spaces(condensed, family.partition)
    beta = infsup_constants(spaces.operator, family.gram.p0).beta_lower
    alphas, gammas = family.exponents
    by_alpha = [_measure_alpha(spaces, family, a, beta, stop) for a in range(len(alphas))]
    table: dict[str, Any] = {
        name: (("alpha", "gamma", "position"), np.array([errors[name] for errors in by_alpha]))
        for name in by_alpha[0]
    }
    coords = {"alpha": [float(x) for x in alphas], "gamma": [float(x) for x in gammas]}
    sizes = {"h": condensed.mesh.h, "H": family.partition.H}
    sizes |= {"beta_lower": beta, "lambda_min": spaces.operator.lambda_min}
    return xr.Dataset(table, coords=coords).assign({name: ((), value) for name, value in sizes.items()})


def _measure_alpha(
    spaces: MixedSpaces, family: FamilyOnPartition, a: int, beta: float, stop: Stop
) -> dict[str, Array]:
    """The numbers over (gamma, position), by variable, of all members with the alpha of number `a`."""
    # Members with one alpha and one place have one u: its projection and its forms serve all gammas
    projections = ritz_projections([members[0] for members in family.members[a]], spaces.condensed)
    by_position = []
    for k, position in enumerate(family.positions):
        transition = spaces.mesh.polygon.arc_length(0, float(position))
        by_position.append(
            [
                _measure_member(
                    CaseProjections(replace(projections[k], case=member), means),
                    spaces,
                    stop,
                    beta=beta,
                    gram=family.gram,
                    u_index=a * len(family.positions) + k,
                    transition_cell=int(np.searchsorted(family.partition.points, transition)) - 1,
                )
                for member, means in zip(family.members[a][k], family.means[a][k], strict=True)
            ]
        )
    return {
        name: np.array([[numbers[name] for numbers in row] for row in by_position]).T
        for name in by_position[0][0]
    }


def _measure_member(
    exact: CaseProjections,
    spaces: MixedSpaces,
    stop: Stop,
    *,
    beta: float,
    gram: Gram,
    u_index: int,
    transition_cell: int,
) -> dict[str, float]:
    """Errors of one member, and what they depend on; its u has the number `u_index` in the forms of `gram`.

    `held` is 1 where lambda_H > 0 in the `transition_cell`, so that its mean of u_h - g is held at 0.
    """
    solution = solve_condensed_problem(discretise_case(spaces, exact), stop, beta)
    errors = exact.errors(spaces, solution.result.lambda_H)
    mean_errors = exact.cell_means.lambda_means - solution.lambda_H
    lower, upper = bound_multiplier_error(gram, u_index, mean_errors, errors.hm12_discrete)
    return {
        "h1_error": errors.h1,
        "hm12_error_lower": lower,
        "hm12_error_upper": upper,
        "l2_error": errors.l2,
        "discrete_error": errors.hm12_discrete,
        "ritz_means": exact.ritz_means_norm(spaces),
        "held": float(solution.lambda_H[transition_cell] > 0),
        "consistency": exact.cell_means.consistency,
        "algebraic_bound": solution.result.bound,
        "converged": float(solution.result.converged),
    }


def measure_sharpness(
    study: Mapping[str, Any],
    stop: Mapping[str, Any],
    errors: str,
    rates: str,
    fixed_errors: str,
    fixed_rates: str,
) -> None:
    """Write errors and rates along h/H, and along H at one h."""
    solve_level = _make_level_solver(study, Stop(**stop, algorithm=study["algorithm"]))
    ratio = parse_fraction(study["h_over_H"], "sharpness.h_over_H")
    sizes = [parse_fraction(H, "sharpness.H") for H in study["H"]]
    h = parse_fraction(study["fixed"]["h"], "sharpness.fixed.h")
    fixed_sizes = [parse_fraction(H, "sharpness.fixed.H") for H in study["fixed"]["H"]]
    for pairs, errors_file, rates_file in (
        ([(ratio * H, H) for H in sizes], errors, rates),
        ([(h, H) for H in fixed_sizes], fixed_errors, fixed_rates),
    ):
        table = join_sharpness_levels([solve_level(*pair) for pair in pairs])
        for file, values in ((errors_file, table), (rates_file, tabulate_surfaces(table))):
            tables.save_table(values, file, "sharpness", {"sharpness": study, "stop": stop})


def _make_level_solver(study: Mapping[str, Any], stop: Stop) -> Callable[[Fraction, Fraction], xr.Dataset]:
    """A function of h and H that gives the errors of all members, and solves no pair twice."""
    domain = find_polygon(study["polygon"])
    alphas = [parse_fraction(exponent, "sharpness.alphas") for exponent in study["alphas"]]
    gammas = [parse_fraction(exponent, "sharpness.gammas") for exponent in study["gammas"]]
    condensed_mesh = cache(lambda h: condense(make_structured_mesh(domain, float(h))))

    @cache
    def family(H: Fraction) -> FamilyOnPartition:
        """The family on the uniform partition of the size H."""
        cells = make_uniform_partition(domain, float(H))
        return family_on_partition(cells, transition_positions(H, study["positions"]), (alphas, gammas))

    @cache
    def solve_level(h: Fraction, H: Fraction) -> xr.Dataset:
        """Errors of all members on one pair."""
        solved = measure(condensed_mesh(h), family(H), stop)
        print(f"h = {h}, H = {H} solved")
        return solved

    return solve_level
