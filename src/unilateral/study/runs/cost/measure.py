"""Accuracy against cost: a base configuration, one factor varied at a time, some pairs crossed.

Each configuration is iterated once, by `uzawa`'s own loop, and recorded. A stopping level s is met at the
first step whose guaranteed algebraic bound is at most s ||u - u_h||_1; all levels are read off that record.
What is measured is the error of (u(lambda^n), lambda^n) at that step, and what it took.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from unilateral.geometry.mesh import Mesh
from unilateral.memory import forget_peak, peak_mb
from unilateral.norms.dual import Gram
from unilateral.problems.case import Case
from unilateral.study.runs.cost.history import Reached
from unilateral.study.runs.cost.run import Measured, Shared, method_of
from unilateral.study.runs.cost.variants import Variant

Array = NDArray[np.float64]
LONGER = 2
"""So many times the steps in double precision may be taken in another one."""
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
SIZES = ("h", "H", "unknowns", "boundary_unknowns", "multipliers")
PER_RUN = (
    "lambda_min",
    "lambda_max",
    "sigma_1",
    "rho",
    "factor_nonzeros",
    "setup_operations",
    "step_operations",
)
NORMS_OF = ("u_norm", "hm12_norm_lower", "hm12_norm_upper", "l2_norm")
DISCRETE = ("h1_discrete", "hm12_discrete_lower", "hm12_discrete_upper", "l2_discrete")
"""Errors of (u_h, lambda_H), to which the iteration tends."""


class Limits(NamedTuple):
    """The stopping levels, falling; the most steps of a run, and of one with a solve in every step."""

    stops: Sequence[float]
    max_steps: int
    costly_steps: int


def measure(
    mesh: Mesh,
    cases: Sequence[Case],
    gram: Gram,
    variants: Sequence[Variant],
    sizes: Sequence[float],
    limits: Limits,
) -> tuple[xr.Dataset, xr.Dataset]:
    """The variants of these cases on one mesh, where H is one of `sizes`: a table of counts, one of seconds.

    `gram` holds the dual norm's forms for the cases, in their order. What is not reached is NaN.
    """
    shared = Shared(mesh, cases, gram)
    table, timed = [], []
    longest: dict[Variant, float] = {}
    for variant in variants:
        if not np.any(np.isclose(sizes, variant.H_over_h * mesh.h, rtol=1e-9)):
            continue
        forget_peak()
        measured = shared.measured(variant)
        most = limits.max_steps if variant.algebra == "S" else limits.costly_steps
        steps = longest.get(variant._replace(precision="float64"), math.inf)
        reached, per_step = measured.run(variant, limits.stops, int(min(most, LONGER * steps)))
        longest[variant] = reached[-1].steps if reached else math.inf
        table.append(_row(variant, measured, reached, len(limits.stops)))
        timed.append(_times(shared, variant, reached, per_step, len(limits.stops)))
    return _dataset(table, limits.stops), _dataset(timed, limits.stops)


def _times(
    shared: Shared, variant: Variant, reached: Sequence[Reached], per_step: float, stops: int
) -> dict[str, Any]:
    """A row of the table of seconds; they depend on the machine."""
    setup = shared.dissecting if variant.algebra == "A" else shared.condensing
    setup += shared.coupled[variant.H_over_h][1] if variant.algebra == "S" else 0.0
    seconds = _filled([setup + each.seconds for each in reached], stops)
    values = {"setup_seconds": setup, "seconds_per_step": per_step, "seconds": seconds, "peak_mb": peak_mb()}
    sizes = {"h": shared.condensed.mesh.h, "H": shared.coupled[variant.H_over_h][0].partition.H}
    return variant._asdict() | sizes | values


def _row(variant: Variant, measured: Measured, reached: Sequence[Reached], stops: int) -> dict[str, Any]:
    """A row of the table of counts and errors."""
    costs, spaces = measured.costs(variant), measured.spaces
    mesh, m = spaces.mesh, spaces.partition.n_cells
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
    columns = zip(*values, strict=True) if values else [[]] * len(PER_STOP)
    row: dict[str, Any] = {
        name: _filled(column, stops) for name, column in zip(PER_STOP, columns, strict=True)
    }
    sizes = (mesh.h, spaces.partition.H, mesh.n_nodes, len(mesh.boundary), m)
    operator = spaces.operator
    per_run = (
        operator.lambda_min,
        operator.lambda_max,
        spaces.condensed.sigma_1,
        measured.rho(variant.algorithm),
        measured.of_A[variant.algebra].nonzeros,
        costs.setup,
        costs.residual + costs.advance,
    )
    row |= dict(zip(SIZES, sizes, strict=True)) | dict(zip(PER_RUN, per_run, strict=True))
    row |= dict(zip(DISCRETE, measured.discrete_errors, strict=True))
    row |= dict(zip(NORMS_OF, measured.norms, strict=True))
    return variant._asdict() | row


def _filled(values: Iterable[float], length: int) -> Array:
    """(length,) the values, and NaN for what was not reached."""
    found = np.full(length, np.nan)
    known = list(values)
    found[: len(known)] = known
    return found


def _dataset(rows: Sequence[Mapping[str, Any]], stops: Sequence[float]) -> xr.Dataset:
    """Rows as a table over `run` and, what depends on the level, `stop`."""
    table: dict[str, Any] = {}
    for name in rows[0]:
        column = [row[name] for row in rows]
        if isinstance(column[0], np.ndarray):
            table[name] = (("run", "stop"), np.array(column))
        else:
            table[name] = ("run", np.array(column, dtype=object if isinstance(column[0], str) else float))
    return xr.Dataset(table, coords={"stop": list(stops)})


def along_runs(parts: Sequence[xr.Dataset], variants: Sequence[Variant]) -> xr.Dataset:
    """One table from those of several meshes: by variant, in that order, and from coarse to fine."""
    table = xr.concat(parts, "run", combine_attrs="drop")
    places = {variant: k for k, variant in enumerate(variants)}
    fields = zip(*(table[name].values for name in Variant._fields), strict=True)
    place = np.array([places[Variant(*each)] for each in fields])
    return table.isel(run=np.lexsort((-table["h"].values, place)))
