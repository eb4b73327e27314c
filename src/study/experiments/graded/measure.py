"""Meshes graded to a vertex of angle omega at which u is like r^(pi/omega), in full contact.

The nodes of a mesh of equal triangles are moved; or meshes are refined by the guaranteed bound on u's error.
Two boundary edges make a cell. In full contact u_h and lambda_H depend linearly on u as long as lambda_H > 0.
So the part of z_h - u_h that belongs to the singular function alone is measured, too: with multipliers of
both signs, and a gap that is 0.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from scipy.linalg import solve as solve_linear

from study import scenes, tables
from study.experiments.graded.levels import GradedRow
from study.stability_constants import bound_multiplier_error
from unilateral.arrays import Array
from unilateral.discrete.condensed import CondensedProblem, discretise_case, solve_condensed_problem
from unilateral.discrete.multilevel import mark_by_bound, solve_refinements
from unilateral.discrete.solution import DiscreteSolution
from unilateral.fem.condense import condense
from unilateral.fem.spaces import MixedSpaces, mixed_spaces
from unilateral.formulas.formula import parse_real
from unilateral.geometry.mesh import Mesh, build_conforming_mesh
from unilateral.geometry.partition import Partition, from_points
from unilateral.geometry.plane import cross
from unilateral.geometry.triangulation_checks import check_areas
from unilateral.norms.dual import Gram, build_dual_norm
from unilateral.norms.exact_errors import CaseProjections, project_case
from unilateral.norms.infsup import infsup_constants
from unilateral.norms.resolution import resolution
from unilateral.problems.case import ExactSolution
from unilateral.problems.polar_atoms import PolarAtom
from unilateral.solvers.stop import Stop

GRADED_MESH = "graded mesh"


def measure_grading(study: Mapping[str, Any], stop: Mapping[str, Any], errors: str, adapted: str) -> None:
    """Write the table of all scenes, cases and gradings, and that of the meshes that the bound refines."""
    chosen = Stop(**stop, algorithm=study["algorithm"])
    normed = study["normed"]
    measured = [run for scene in study["scenes"] for run in measure(scene, normed, chosen)]
    parameters = {"graded": study, "stop": stop}
    tables.save_table(xr.concat(measured, "run"), errors, "graded", parameters)
    tables.save_table(measure_refinement(study, stop), adapted, "graded", parameters)


def measure(scene: Mapping[str, Any], normed: int, stop: Stop) -> Iterator[xr.Dataset]:
    """Errors over (level) of each case and each kappa of a scene."""
    radius = parse_real(scene["radius"], "graded.radius")
    levels = list(scenes.refine_to_levels(scenes.coarsest_mesh(scene), scene["mesh"]["levels"]))
    for case in scenes.load_cases(scene):
        vertex = singular_atom(case).side
        for declared_kappa in scene["kappas"]:
            kappa = parse_real(declared_kappa, "graded.kappas")
            meshes = [grade_to_vertex(mesh, vertex, radius, kappa) for mesh in levels]
            errors = measure_levels(meshes, case, normed, stop).assign_coords(kappa=kappa)
            yield errors.assign(equal_h=("level", [mesh.h for mesh in levels]))
            print(f"{case.name}, kappa = {kappa:g} measured")


def grade_to_vertex(mesh: Mesh, vertex: int, radius: float, kappa: float) -> Mesh:
    """The mesh with nodes within the radius R of a vertex moved from the distance r to R (r/R)^(1/kappa).

    Triangles of the size h at the distance r then have a size like h r^(1 - kappa), and angles are bounded
    below. No other sides than those of the vertex may be so near. Raises InputError if a triangle turns over.
    """
    centre = mesh.polygon.vertices[vertex]
    offset = mesh.points - centre
    # r/R, and 1 beyond R: x -> centre + (x - centre) (r/R)^(1/kappa - 1)
    share = np.minimum(np.hypot(*offset.T) / radius, 1.0)
    points = centre + offset * share[:, None] ** (1 / kappa - 1)
    check_areas(points, mesh.triangles, GRADED_MESH)
    return build_conforming_mesh(mesh.polygon, points, mesh.triangles, GRADED_MESH)


def singular_atom(case: ExactSolution) -> PolarAtom:
    """The case's only atom at a vertex."""
    (atom,) = [atom for atom in case.atoms if isinstance(atom, PolarAtom)]
    return atom


def two_edge_cells(mesh: Mesh) -> Partition:
    """The partition with two boundary edges in each cell. Raises InputError if a side has an odd number."""
    return from_points(mesh.polygon, mesh.s[::2])


def measure_levels(levels: Sequence[Mesh], case: ExactSolution, normed: int, stop: Stop) -> xr.Dataset:
    """Errors over (level) on nested meshes, and what they depend on.

    Where there are more than `normed` cells the dual norm and beta are NaN. One reference mesh serves all
    other levels.
    """
    spaces = [mixed_spaces(condense(mesh), two_edge_cells(mesh)) for mesh in levels]
    finest = [pair.partition for pair in spaces if pair.partition.n_cells <= normed][-1]
    gram = build_dual_norm(finest, [case]).gram([case])
    atom = singular_atom(case)
    rows = [_measure_level(pair, case, gram, stop) | mesh_resolution(pair) for pair in spaces]
    for row, pair in zip(rows, spaces, strict=True):
        row["singular_error"] = singular_part_error(replace(case, atoms=(atom,)), pair)
    return tables.tabulate_levels(rows).assign_coords(case=case.name, exponent=float(atom.beta))


def _measure_level(spaces: MixedSpaces, case: ExactSolution, gram: Gram, stop: Stop) -> GradedRow:
    """Errors of the discrete solution; in the dual norm if the forms are of a finer partition."""
    projections = project_case(case, spaces)
    result = solve_condensed_problem(discretise_case(spaces, projections), stop).result
    errors = projections.errors(spaces, result.lambda_H)
    row = {
        "h1_error": errors.h1,
        "discrete_error": errors.hm12_discrete,
        "weighted_ritz_means": weighted_ritz_means(projections, spaces),
        "least_multiplier": float(result.lambda_H.min()),
        "algebraic_bound": result.bound,
        "converged": float(result.converged),
        "quadrature_share": errors.quadrature_share,
    }
    return row | _dual_norm_errors(spaces, projections, gram, result.lambda_H)


def _dual_norm_errors(
    spaces: MixedSpaces, exact_data: CaseProjections, gram: Gram, lambda_H: Array
) -> GradedRow:
    if spaces.partition.n_cells > gram.n_cells:
        return dict.fromkeys(("hm12_error_lower", "hm12_error_upper", "beta_lower"), np.nan)
    form = gram.coarsen(spaces.partition)
    D = exact_data.errors(spaces, lambda_H).hm12_discrete
    mean_errors = exact_data.cell_means.lambda_means - lambda_H
    lower, upper = bound_multiplier_error(form, 0, mean_errors, D)
    return {
        "hm12_error_lower": lower,
        "hm12_error_upper": upper,
        "beta_lower": infsup_constants(spaces.operator, form.p0).beta_lower,
    }


def singular_part_error(singular: ExactSolution, spaces: MixedSpaces) -> float:
    """||z_h - u_h||_1 of a case, were multipliers of both signs allowed."""
    projections = project_case(singular, spaces)
    return projections.errors(spaces, equality_multiplier(discretise_case(spaces, projections))).hm12_discrete


def equality_multiplier(discrete: CondensedProblem) -> Array:
    """The multiplier (m,), of either sign, at which all cell means of u_h - g are 0."""
    root = np.sqrt(discrete.spaces.operator.H_i)
    S = discrete.spaces.operator.S
    # S y + b = 0 for y = H_i^{1/2} mu and b = H_i^{1/2} offset
    return np.asarray(solve_linear(S, -discrete.offset * root, assume_a="pos") / root)


def weighted_ritz_means(exact_data: CaseProjections, spaces: MixedSpaces) -> float:
    """t of Lemma 1: (sum_i H_i^{-1} ||Pi_H(u - z_h)||_{0,i}^2)^{1/2}."""
    # H_i^{-1/2} ||Pi_H(u - z_h)||_{0,i} is the mean of u - z_h on the cell i
    u_means = exact_data.cell_means.gap_means + exact_data.cell_means.g_means
    return float(np.linalg.norm(u_means - spaces.B @ exact_data.ritz.boundary_values / spaces.operator.H_i))


def mesh_resolution(spaces: MixedSpaces) -> GradedRow:
    """How large the mesh is, its smallest angle, and how finely it resolves the cells."""
    scales = resolution(spaces.mesh, spaces.partition)
    sizes = {"unknowns": float(spaces.mesh.n_nodes), "least_angle": smallest_angle(spaces.mesh)}
    return sizes | {"delta": scales.delta, "alpha_1": scales.alpha_1}


def smallest_angle(mesh: Mesh) -> float:
    """The smallest angle of all triangles, in degrees."""
    corners = mesh.points[mesh.triangles]
    incoming = (np.roll(corners, 1, axis=1) - corners).reshape(-1, 2)
    outgoing = (np.roll(corners, -1, axis=1) - corners).reshape(-1, 2)
    return float(np.degrees(np.arctan2(cross(outgoing, incoming), np.sum(outgoing * incoming, axis=1)).min()))


def measure_refinement(study: Mapping[str, Any], stop: Mapping[str, Any]) -> xr.Dataset:
    """Errors over (case, level), NaN beyond a case's last level.

    The algebraic error is a fraction of D, too, not only of ||u - u_h||_1, and so its fraction is squared.
    """
    fine = Stop(**{**stop, "fraction": stop["fraction"] ** 2})
    measured = {
        case.name: tables.tabulate_levels(list(measure_refined_levels(scene, case, study["adapted"], fine)))
        for scene in study["scenes"]
        for case in scenes.load_cases(scene)
    }
    return xr.concat(measured.values(), "case", join="outer").assign_coords(case=list(measured))


def measure_refined_levels(
    scene: Mapping[str, Any], case: ExactSolution, unknowns: int, stop: Stop
) -> Iterator[GradedRow]:
    """Errors of each level that the bound refines, from the scene's coarsest mesh on."""
    first = scenes.coarsest_mesh(scene)
    for solution in solve_refinements(case.problem, first, stop, mark_by_bound, unknowns):
        solution.bound()
        yield refined_level_errors(case, solution)


def refined_level_errors(case: ExactSolution, solution: DiscreteSolution) -> GradedRow:
    """||u - u_h||_1 and D of a solution, by the case's exact one."""
    mesh = solution.mesh
    spaces = mixed_spaces(condense(mesh), solution.partition)
    errors = project_case(case, spaces).errors(spaces, solution.lambda_H)
    return {
        "unknowns": float(mesh.n_nodes),
        "h1_error": errors.h1,
        "discrete_error": errors.hm12_discrete,
        "shortest_edge": float(np.diff(mesh.s).min()),
        "algebraic_bound": solution.result.bound,
    }
