"""Accuracy against cost: runs along axes that leave a base, each measured at all stopping levels.

Each run is iterated once, by `uzawa`'s own loop, and recorded. A stopping level s is met at the first step
whose guaranteed algebraic bound is at most s ||u - u_h||_1; all levels are read off that record. What is
measured is the error of (u(lambda^n), lambda^n) at that step, and the operations up to there.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from study import operations, scenes, tables
from study.experiments.cost.run import PosedCase, Variant, count_operations, method_and_step, run_to_levels
from unilateral.discrete.condensed import discretise_case
from unilateral.fem.condense import CondensedMatrix, condense_factors, form_matrix
from unilateral.fem.linear_systems import SparseFactors, factorise_by_dissection
from unilateral.fem.spaces import MixedSpaces, mixed_spaces
from unilateral.formulas.formula import parse_real
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import make_uniform_partition
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.dual import Gram
from unilateral.norms.exact_errors import CaseProjections, cell_means
from unilateral.norms.ritz import RitzProjection, ritz_projection
from unilateral.problems.case import ExactSolution

MAX_STEPS_OVER_DOUBLE = 2
"""A run in another precision may take so many times the steps in double precision."""
DISCRETE_ERRORS = ("h1_discrete", "hm12_discrete_lower", "hm12_discrete_upper", "l2_discrete")
"""The errors of (u_h, lambda_H), to which the iteration tends."""
EXACT_NORMS = ("u_norm", "hm12_norm_lower", "hm12_norm_upper", "l2_norm")
RUN_ERRORS = ("h1_error", "hm12_error_lower", "hm12_error_upper", "l2_error")


class Variation(NamedTuple):
    """Fields of the base with the values that they take, and the variants with all combinations of these."""

    values: dict[str, list[Any]]
    variants: list[Variant]


CostRow = dict[str, Any]
"""What is known of a run, by the names of the tables' variables; lists are over the stopping levels."""
CostRows = dict[tuple[Variant, float], CostRow]
"""Runs by their variant and H."""


def measure_cost(
    study: Mapping[str, Any], scene: Mapping[str, Any], norms: Sequence[str], axes: Sequence[str]
) -> None:
    """Write the table along each of the study's axes.

    `scene` has the scenes in which runs are made, by name, and `norms` are the files of their dual norms.
    """
    sizes = [parse_real(H, "cost.H") for H in study["H"]]
    planned = plan_axes(study)
    variants = dict.fromkeys(variant for axis in planned for variant in axis.variants)
    rows: CostRows = {}
    for (name, declared), norm in zip(scene.items(), norms, strict=True):
        scene_variants = [variant for variant in variants if variant.scene == name]
        rows |= _measure_scene(declared, norm, study["h"][name], scene_variants, sizes, study)
    parameters = {f"scenes.{name}": declared for name, declared in scene.items()}
    parameters |= {f"cost.{field}": value for field, value in study.items()}
    for axis, path in zip(planned, axes, strict=True):
        tables.save_table(tabulate_axis(axis, rows, sizes, study["stops"]), path, "cost", parameters)


def _measure_scene(
    scene: Mapping[str, Any],
    norm: str,
    mesh_sizes: Sequence[object],
    variants: Sequence[Variant],
    sizes: Sequence[float],
    study: Mapping[str, Any],
) -> CostRows:
    """The rows of a scene's variants on meshes of all `mesh_sizes`; the file `norm` has its dual norm."""
    gram = Gram.from_table(tables.load_table(norm))
    cases = scenes.load_cases(scene)
    rows: CostRows = {}
    for h in mesh_sizes:
        mesh = make_structured_mesh(scenes.scene_polygon(scene), parse_real(h, "cost.h"))
        rows |= measure(mesh, cases, gram, variants, sizes, study)
    return rows


def plan_axes(study: Mapping[str, Any]) -> list[Variation]:
    """The study's axes. Each field that one changes has the base's value first, then the others."""
    base = study["base"] | {"H_over_h": parse_real(study["base"]["H_over_h"], "cost.base.H_over_h")}
    axes = []
    for declared in study["axes"].values():
        values = {field: [study["base"][field], *varied] for field, varied in declared.items()}
        if "H_over_h" in values:
            values["H_over_h"] = [parse_real(ratio, "cost.axes.H_over_h") for ratio in values["H_over_h"]]
        changes = [dict(zip(values, chosen, strict=True)) for chosen in itertools.product(*values.values())]
        axes.append(Variation(values, [Variant(**base | changed) for changed in changes]))
    return axes


def measure(
    mesh: Mesh,
    cases: Sequence[ExactSolution],
    gram: Gram,
    variants: Sequence[Variant],
    sizes: Sequence[float],
    study: Mapping[str, Any],
) -> CostRows:
    """The rows of the variants of these cases on one mesh, where H is one of `sizes`.

    `gram` holds the dual norm's forms for the cases, in their order. Of the study the limits of runs are
    read. A variant in another precision has to follow its twin in double precision.
    """
    factored = _factorise(mesh)
    case_names = {variant.case for variant in variants}
    ritz = {case.name: ritz_projection(case, factored.condensed) for case in cases if case.name in case_names}
    rows: CostRows = {}
    for ratio in dict.fromkeys(variant.H_over_h for variant in variants):
        # A ratio that gives no H of the study on this mesh is measured on others
        H = next((H for H in sizes if math.isclose(H, ratio * mesh.h, rel_tol=1e-9)), None)
        if H is None:
            continue
        spaces = mixed_spaces(factored.condensed, make_uniform_partition(mesh.polygon, ratio * mesh.h))
        form = gram.coarsen(spaces.partition)
        for case_index, case in enumerate(cases):
            case_variants = [
                variant for variant in variants if (variant.case, variant.H_over_h) == (case.name, ratio)
            ]
            if not case_variants:
                continue
            posed = factored.pose_case(spaces, ritz[case.name], form, case_index)
            for variant in case_variants:
                twin = rows.get((variant._replace(precision="float64"), H))
                max_steps = _limit_steps(study, variant, twin)
                rows[variant, H] = _measure_run(posed, variant, study["stops"], max_steps)
    return rows


class _FactoredMesh(NamedTuple):
    """A mesh condensed to the boundary, and the factors of A for steps that solve with it.

    `counts` has the counts of the factors that a step needs, by the matrix of the step.
    """

    condensed: CondensedMatrix
    factors: SparseFactors
    counts: dict[str, operations.FactorCounts]

    def pose_case(self, spaces: MixedSpaces, ritz: RitzProjection, form: Gram, case_index: int) -> PosedCase:
        """The case of a Ritz projection, with its number in the dual norm's `form`, on a partition."""
        exact = CaseProjections(ritz, cell_means(ritz.case, spaces.partition))
        return PosedCase(
            exact=exact,
            discrete=discretise_case(spaces, exact),
            form=form,
            case_index=case_index,
            factors=self.factors,
            counts=self.counts,
        )


def _factorise(mesh: Mesh) -> _FactoredMesh:
    """A factorised twice: with the boundary nodes last, and with the fewest operations."""
    A = form_matrix(mesh)
    # The last block of these factors gives A_3, from which S is formed
    boundary_last = factorise_by_dissection(A, mesh.boundary)
    factors = factorise_by_dissection(A)
    counts = {"A": operations.count_factors(factors.lu), "A_3": operations.count_factors(boundary_last.lu)}
    counts["S"] = counts["A_3"]
    return _FactoredMesh(condense_factors(mesh, boundary_last), factors, counts)


def _limit_steps(study: Mapping[str, Any], variant: Variant, twin: CostRow | None) -> int:
    """The most steps of a run; `twin` has the numbers of the same run in double precision, if known."""
    max_steps: int = study["max_steps"] if variant.algebra == "S" else study["costly_steps"]
    if twin and np.isfinite(twin["steps"]).any():
        return min(max_steps, MAX_STEPS_OVER_DOUBLE * int(np.nanmax(twin["steps"])))
    return max_steps


def _measure_run(posed: PosedCase, variant: Variant, stops: Sequence[float], max_steps: int) -> CostRow:
    """Numbers of one run by the names of variables; NaN at levels that are not reached."""
    reached = run_to_levels(posed, variant, stops, max_steps)
    setup, step, totals = count_operations(posed, variant, reached)
    method, rho = method_and_step(variant.algorithm, posed.spaces)
    errors = np.reshape(
        [posed.errors(level.lambda_H) for level in reached], (len(reached), len(RUN_ERRORS))
    ).T
    at_levels: dict[str, Sequence[float]] = dict(zip(RUN_ERRORS, errors.tolist(), strict=True))
    at_levels |= {
        "steps": [level.steps for level in reached],
        "operator_applications": [level.applications for level in reached],
        # Newton factorises S on the cells in contact in every step
        "factorisations": [1 + (method == "newton") * level.steps for level in reached],
        "operations": totals,
        "algebraic_bound": [level.bound for level in reached],
    }
    missing = [math.nan] * (len(stops) - len(reached))
    spaces = posed.spaces
    operator = posed.spaces.operator
    row: CostRow = {name: [*values, *missing] for name, values in at_levels.items()}
    row |= {
        "h": spaces.mesh.h,
        "unknowns": spaces.mesh.n_nodes,
        "boundary_unknowns": len(spaces.mesh.boundary),
        "multipliers": spaces.partition.n_cells,
        "lambda_min": operator.lambda_min,
        "lambda_max": operator.lambda_max,
        "sigma_1": spaces.condensed.sigma_1,
        "rho": rho,
        "factor_nonzeros": posed.counts[variant.algebra].nonzeros,
        "setup_operations": setup,
        "step_operations": step,
    }
    row |= dict(zip(DISCRETE_ERRORS, posed.discrete_errors, strict=True))
    return row | dict(zip(EXACT_NORMS, posed.exact_norms, strict=True))


def tabulate_axis(
    axis: Variation,
    rows: CostRows,
    sizes: Sequence[float],
    stops: Sequence[float],
) -> xr.Dataset:
    """The table over the fields that an axis changes, H and the stopping level, NaN where there is no run."""
    runs = [rows.get((variant, H), {}) for variant in axis.variants for H in sizes]
    coords = {**axis.values, "H": list(sizes), "stop": list(stops)}
    shape = [len(coords[name]) for name in (*axis.values, "H")]
    table = {}
    for name, example in next(iter(rows.values())).items():
        missing = np.full(np.shape(example), math.nan)
        column = np.array([run.get(name, missing) for run in runs], dtype=float)
        column = column.reshape(*shape, *column.shape[1:])
        table[name] = [*coords][: column.ndim], column
    return xr.Dataset(table, coords=coords)
