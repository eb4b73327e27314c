"""Accuracy against cost: a base configuration, one factor varied at a time, some pairs crossed.

Each configuration is iterated once, by `uzawa`'s own loop, and recorded. A stopping level s is met at the
first step whose guaranteed algebraic bound is at most s ||u - u_h||_1; all levels are read off that record.
What is measured is the error of (u(lambda^n), lambda^n) at that step, and what it took.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from study import scenes, tables
from study.experiments.cost.history import Reached
from study.experiments.cost.run import Measured, Shared, method_of
from study.experiments.cost.variants import Variant, along_runs, plan
from unilateral.formulas.formula import real
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.structured import structured
from unilateral.norms.dual import Gram
from unilateral.problems.case import ExactSolution
from unilateral.system.memory import forget_peak, peak_mb

LONGER = 2
"""A run in another precision may take so many times the steps in double precision."""
PER_STOP = (
    "h1_error",
    "hm12_error_lower",
    "hm12_error_upper",
    "l2_error",
    "steps",
    "operator_applications",
    "factorisations",
    "operations",
    "algebraic_bound",
)
DISCRETE = ("h1_discrete", "hm12_discrete_lower", "hm12_discrete_upper", "l2_discrete")
"""The errors of (u_h, lambda_H), to which the iteration tends."""
NORMS_OF = ("u_norm", "hm12_norm_lower", "hm12_norm_upper", "l2_norm")


class StepLimits(NamedTuple):
    """The stopping levels, falling; the most steps of a run, and of one with a solve in every step."""

    stops: Sequence[float]
    max_steps: int
    costly_steps: int


def measure_cost(
    norm: str,
    scene: Mapping[str, Any],
    number: str,
    of_job: Mapping[str, Any],
    study: Mapping[str, Any],
    runs: str,
    timings: str,
) -> None:
    """Write counts and seconds of every run on the meshes of one job, which has that number in the study."""
    name, gram = of_job["scene"], Gram.of_table(tables.load(norm))
    planned = [variant for variant in plan(study) if variant.scene == name]
    limits = StepLimits(study["stops"], study["max_steps"], study["costly_steps"])
    cases, sizes = scenes.cases(scene), [real(H, "cost.H") for H in study["H"]]
    meshes = [structured(scenes.domain(scene), real(h, "cost.jobs.h")) for h in of_job["h"]]
    measured = [measure(mesh, cases, gram, planned, sizes, limits) for mesh in meshes]
    given = {f"scenes.{name}": scene, f"cost.jobs.{number}": of_job}
    given |= {f"cost.{field}": value for field, value in study.items()}
    for parts, path in zip(zip(*measured, strict=True), (runs, timings), strict=True):
        tables.save(along_runs(parts, planned), path, "cost", given)


def measure(
    mesh: Mesh,
    cases: Sequence[ExactSolution],
    gram: Gram,
    variants: Sequence[Variant],
    sizes: Sequence[float],
    limits: StepLimits,
) -> tuple[xr.Dataset, xr.Dataset]:
    """The variants of these cases on one mesh, where H is one of `sizes`: a table of counts, one of seconds.

    `gram` holds the dual norm's forms for the cases, in their order. What is not reached is NaN.
    """
    variants = [each for each in variants if np.isclose(sizes, each.H_over_h * mesh.h, rtol=1e-9).any()]
    shared = Shared(mesh, cases, gram, variants)
    table, timed = [], []
    longest: dict[Variant, float] = {}
    for variant in variants:
        forget_peak()
        measured = shared.measured[variant.case, variant.H_over_h]
        most = limits.max_steps if variant.algebra == "S" else limits.costly_steps
        steps = longest.get(variant._replace(precision="float64"), math.inf)
        reached, per_step = measured.run(variant, limits.stops, int(min(most, LONGER * steps)))
        longest[variant] = reached[-1].steps if reached else math.inf
        table.append(_row(variant, measured, reached, limits.stops))
        timed.append(_times(shared, variant, reached, per_step, limits.stops))
    return _dataset(table, limits.stops), _dataset(timed, limits.stops)


def _times(
    shared: Shared, variant: Variant, reached: Sequence[Reached], per_step: float, stops: Sequence[float]
) -> dict[str, Any]:
    """A row of the table of seconds; they depend on the machine."""
    spaces, coupling = shared.coupled[variant.H_over_h]
    setup = shared.dissecting if variant.algebra == "A" else shared.condensing
    setup += coupling if variant.algebra == "S" else 0.0
    return variant._asdict() | {
        "h": spaces.mesh.h,
        "H": spaces.partition.H,
        "setup_seconds": setup,
        "seconds_per_step": per_step,
        **_at_stops(("seconds",), [(setup + each.seconds,) for each in reached], stops),
        "peak_mb": peak_mb(),
    }


def _row(
    variant: Variant, measured: Measured, reached: Sequence[Reached], stops: Sequence[float]
) -> dict[str, Any]:
    """A row of the table of counts and errors."""
    costs, spaces, operator = measured.costs(variant), measured.spaces, measured.spaces.operator
    dense = method_of(variant) == "newton"
    values = [
        (
            *measured.errors(each.lambda_H),
            each.steps,
            each.applications,
            1 + dense * each.steps,
            costs.total(each),
            each.bound,
        )
        for each in reached
    ]
    of_run = {
        "h": spaces.mesh.h,
        "H": spaces.partition.H,
        "unknowns": spaces.mesh.n_nodes,
        "boundary_unknowns": len(spaces.mesh.boundary),
        "multipliers": spaces.partition.n_cells,
        "lambda_min": operator.lambda_min,
        "lambda_max": operator.lambda_max,
        "sigma_1": spaces.condensed.sigma_1,
        "rho": measured.rho(variant.algorithm),
        "factor_nonzeros": measured.of_A[variant.algebra].nonzeros,
        "setup_operations": costs.setup,
        "step_operations": costs.residual + costs.advance,
    }
    known = zip((*DISCRETE, *NORMS_OF), (*measured.discrete_errors, *measured.norms), strict=True)
    return variant._asdict() | _at_stops(PER_STOP, values, stops) | of_run | dict(known)


def _at_stops(
    names: Sequence[str], values: Sequence[tuple[float, ...]], stops: Sequence[float]
) -> dict[str, pd.Series]:
    """The values at all levels by name, NaN at levels that were not reached."""
    return dict(pd.DataFrame(values, columns=names, dtype=float).reindex(range(len(stops))).items())


def _dataset(rows: Sequence[Mapping[str, Any]], stops: Sequence[float]) -> xr.Dataset:
    """The rows as a table over `run` and, for what depends on the level, `stop`."""
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    typed = {name: each.astype(object if each.dtype.kind == "U" else float) for name, each in columns.items()}
    table = {name: (("run", "stop")[: column.ndim], column) for name, column in typed.items()}
    return xr.Dataset(table, coords={"stop": list(stops)})
