"""What the figures are drawn from: tables in long form, made from the study's tables or from one solution."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from unilateral.discrete import discretise, solve
from unilateral.errors import InputError
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.problems.case import Case
from unilateral.problems.certificate import certify
from unilateral.study.judge.rates import NORMS
from unilateral.study.tables import error_in

Array = NDArray[np.float64]
SAMPLES_PER_SIDE = 200


def rates_frame(errors: xr.Dataset, rates: xr.Dataset) -> pd.DataFrame:
    """One row per case, norm, h/H and level: the error, whether it is asymptotic, and the fitted rate.

    Raises InputError if no level has one of the ratios h/H.
    """
    rows = []
    for case in rates["case"].values:
        for norm in NORMS:
            for ratio in rates["h_over_H"].values:
                of = rates.sel(case=case, norm=norm, h_over_H=ratio)
                rows += _levels(errors.sel(case=case), norm, of)
    if not rows:
        ratios = ", ".join(f"{ratio:g}" for ratio in rates["h_over_H"].values)
        raise InputError(
            f"scene '{errors.attrs['scene']}' has no level with h/H = {ratios} to draw rates along"
        )
    return pd.DataFrame(rows)


def _levels(errors: xr.Dataset, norm: str, of: xr.Dataset) -> list[dict]:
    error = error_in(errors, norm).values
    pairs = of["asymptotic"].values == 1
    asymptotic = {*of["h_coarse"].values[pairs], *of["h_fine"].values[pairs]}
    same = np.argwhere(np.isclose(errors["h_over_H"].values, float(of["h_over_H"]), rtol=1e-9))
    return [
        {
            "scene": errors.attrs["scene"],
            "case": str(of["case"].values),
            "norm": norm,
            "h_over_H": float(of["h_over_H"]),
            "h": float(errors["h"][i]),
            "H": float(errors["H"][j]),
            "error": float(error[i, j]),
            "asymptotic": int(float(errors["h"][i]) in asymptotic),
            "rate": float(of["fitted"]),
            "proved": float(of["proved"]),
            "expected": float(of["expected"]),
        }
        for i, j in same
    ]


def grid_frame(errors: xr.Dataset, cases: Sequence[str]) -> pd.DataFrame:
    """One row per case, norm, h and H: the error, NaN where it was not computed, and whether beta = 0."""
    rows = []
    for case in cases:
        of = errors.sel(case=case)
        for norm in NORMS:
            error = error_in(of, norm).values
            for i, j in np.ndindex(of.sizes["mesh"], of.sizes["partition"]):
                solved_without_beta = of["algorithm"].values[i, j] == "active_set"
                rows.append(
                    {
                        "case": case,
                        "norm": norm,
                        "h": float(of["h"][i]),
                        "H": float(of["H"][j]),
                        "h_over_H": float(of["h_over_H"][i, j]),
                        "error": float(error[i, j]),
                        "beta_zero": int(solved_without_beta),
                    }
                )
    return pd.DataFrame(rows)


def portrait_frames(case: Case, mesh: Mesh, partition: Partition) -> tuple[pd.DataFrame, pd.DataFrame]:
    """u_h on the triangles; and along the boundary u_h - g, lambda_H, and what they approximate."""
    solution = solve(discretise(case, mesh, partition))
    corners = mesh.triangles.ravel()
    field = pd.DataFrame(
        {
            "triangle": np.repeat(np.arange(len(mesh.triangles)), 3),
            "x": mesh.points[corners, 0],
            "y": mesh.points[corners, 1],
            "u_h": solution.u_h[corners],
            "h": mesh.h,
            "H": partition.H,
        }
    )
    side, s, position = _along_boundary(case)
    u, flux, gap = case.boundary(side, s)
    trace = np.interp(
        position, mesh.s, np.append(solution.u_h[mesh.boundary], solution.u_h[mesh.boundary[0]])
    )
    x, y = case.polygon.at(side, s).T
    along = {"s": position, "side": side, "contact": _in_contact(case, side, s), "x": x, "y": y}
    boundary = [
        pd.DataFrame({"kind": "trace", **along, "computed": trace - (u - gap), "exact": gap}),
        pd.DataFrame({"kind": "flux", **along, "exact": flux}),
        pd.DataFrame(
            {
                "kind": "multiplier",
                "s": partition.points[:-1],
                "end": partition.points[1:],
                "side": partition.side,
                "computed": solution.lambda_H,
            }
        ),
    ]
    columns = ["kind", "side", "s", "end", "computed", "exact", "contact", "x", "y"]
    return field, pd.concat(boundary)[columns]


def _along_boundary(case: Case) -> tuple[NDArray[np.intp], Array, Array]:
    """Sides (k,), arc lengths from their starts (k,) and along the whole boundary (k,), ends included."""
    polygon = case.polygon
    side = np.repeat(np.arange(polygon.n_sides), SAMPLES_PER_SIDE + 1)
    s = np.tile(np.linspace(0, 1, SAMPLES_PER_SIDE + 1), polygon.n_sides) * polygon.lengths[side]
    return side, s, polygon.starts[side] + s


def _in_contact(case: Case, side: NDArray[np.intp], s: Array) -> NDArray[np.intp]:
    t = s / case.polygon.lengths[side]
    held = [(side == i) & (t >= a) & (t <= b) for i, a, b in certify(case).contact]
    return np.any(held, axis=0).astype(int) if held else np.zeros(len(s), dtype=int)
