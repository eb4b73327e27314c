"""Tables of rates, floors and bounds, as documents show them."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from study.experiments.scenes.checks import asymptotic_l2_rates, index_rate
from study.formats import DASH, ERROR_TITLES, SPACES, format_row, format_value
from study.rates import ERROR_NORMS, smallest_rate
from study.scenes import has_clamped_sides
from study.tables import ZERO_ERROR_SHARE
from unilateral.formulas.formula import parse_real
from unilateral.system.declarations import read_stored_yaml

STAR = r"\*"
"""The mark of an expected rate that no theorem proves, in Markdown."""
SCENE_CLAIMS = Path(__file__).with_name("claims.yaml")


def numbers(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, Any]:
    """The rate of u without (j) and without (jj); bounds on totals."""
    labels = {"norm": "h1", "h_over_H": parse_real(study["rates"]["judged_ratio"], "judged_ratio")}
    smallest_rates = {
        case: smallest_rate(results[f"{scene}/rates"].sel(case=case, **labels))
        for scene, case in (("corners", "violates_j"), ("irregular", "violates_jj"))
    }
    return {"rates": smallest_rates, "totals": summarise_corner_totals(results["corners/totals"])}


def blocks(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    """The tables of rates, floors and totals of the scenes."""
    ratio = parse_real(study["rates"]["judged_ratio"], "judged_ratio")
    claimed = {claim["id"]: claim for claim in read_stored_yaml(SCENE_CLAIMS)["claims"]}
    l2_claims = [claimed[name]["parameters"] for name in ("T.L2", "T.L2c")]
    l2_errors = {name: results[f"{name}/u_in_l2"] for name in study["u_in_l2"]}
    scenes = [name for name, scene in study["scenes"].items() if scene["judged"]]
    judged, clamped = split_clamped_scenes({name: results[f"{name}/rates"] for name in scenes})
    bounded, clamped_totals = split_clamped_scenes(
        {name: results[f"{name}/totals"] for name in study["totals"]["scenes"]}
    )
    return {
        "rates": tabulate_rates(judged, ratio),
        "rates-by-case": tabulate_rates_by_case(judged, ratio, study["rates"]["cases"]),
        "rates-clamped": tabulate_rates_by_case(clamped, ratio, study["rates"]["cases"]),
        "u-in-l2": tabulate_u_in_l2(l2_errors, judged, ratio, l2_claims),
        "floors": tabulate_floors(results["square/floors"]),
        "fixed-cells": tabulate_fixed_cells(results["square/errors"]),
        "totals": tabulate_totals(bounded),
        "totals-clamped": tabulate_totals(clamped_totals),
        "exactness": tabulate_exactness(bounded, claimed["F.exact"]["parameters"]),
    }


def split_clamped_scenes(
    scenes: Mapping[str, xr.Dataset],
) -> tuple[dict[str, xr.Dataset], dict[str, xr.Dataset]]:
    """The scenes without clamped sides, and those with some."""
    clamped = {name: table for name, table in scenes.items() if has_clamped_sides(table["case"].values[0])}
    return {name: table for name, table in scenes.items() if name not in clamped}, clamped


def tabulate_rates(scenes: Mapping[str, xr.Dataset], ratio: float) -> pd.DataFrame:
    """Per scene and case, the smallest asymptotic rate in each norm."""
    first = next(iter(scenes.values()))
    proved = {norm: float(first["proved"].sel(norm=norm, h_over_H=ratio).max()) for norm in ERROR_NORMS}
    rows = [
        {"scene": name, "case": f"`{case}`"}
        | {
            f"{ERROR_TITLES[norm]} (proved {proved[norm]:g})": describe_rate(
                rates.sel(case=case, norm=norm, h_over_H=ratio)
            )
            for norm in ERROR_NORMS
        }
        for name, rates in scenes.items()
        for case in rates["case"].values
    ]
    return pd.DataFrame(rows)


def describe_rate(rates_row: xr.Dataset) -> str:
    """The smallest observed rate in words, with the expected one, or why there is none."""
    verdict = rates_row["verdict"].item()
    if verdict == "exact":
        return "error 0, as exact"
    if verdict == "not judged":
        return str(verdict)
    pairs = int(np.count_nonzero(rates_row["asymptotic"].values == 1))
    suffix = "" if verdict == "holds" else f", **{verdict}**"
    counted = "1 pair" if pairs == 1 else f"{pairs} pairs"
    return f"{smallest_rate(rates_row):.2f} of {float(rates_row['expected']):.3g} ({counted}){suffix}"


def tabulate_rates_by_case(
    scenes: Mapping[str, xr.Dataset], ratio: float, expectations: Mapping[str, Any]
) -> pd.DataFrame:
    """Per case, the smallest rates of all scenes; a case that is nowhere judged has no row.

    An expected rate has a star if no theorem proves it on some of the scenes, by the `expectations` of cases.
    """
    rows = []
    for case in dict.fromkeys(case for rates in scenes.values() for case in rates["case"].values):
        case_rates = {
            name: rates.sel(case=case, h_over_H=ratio)
            for name, rates in scenes.items()
            if case in rates["case"]
        }
        rate_texts = {
            ERROR_TITLES[norm]: _describe_smallest_rate(
                [rates.sel(norm=norm) for rates in case_rates.values()],
                is_proved=set(expectations[case][norm].get("unproved", ())).isdisjoint(case_rates),
            )
            for norm in ERROR_NORMS
        }
        if set(rate_texts.values()) != {DASH}:
            rows.append({"case": f"`{case}`", "scenes": ", ".join(case_rates)} | rate_texts)
    return pd.DataFrame(rows)


def _describe_smallest_rate(rates_rows: Sequence[xr.Dataset], is_proved: bool) -> str:
    judged = [row for row in rates_rows if row["verdict"].item() in ("holds", "fails")]
    if not judged:
        return "exact" if rates_rows[0]["verdict"].item() == "exact" else DASH
    failed = any(row["verdict"].item() == "fails" for row in judged)
    expected = max(float(row["expected"]) for row in judged)
    star = "" if is_proved else STAR
    return f"{min(map(smallest_rate, judged)):.2f} of {expected:.3g}{star}" + (
        ", **fails**" if failed else ""
    )


def tabulate_u_in_l2(
    errors: Mapping[str, xr.Dataset],
    rates: Mapping[str, xr.Dataset],
    ratio: float,
    claim_parameters: Sequence[Mapping[str, Any]],
) -> pd.DataFrame:
    """The rates of ||u - u_h||_0 per scene and case beside the largest order that a claim has there.

    The last column is D over ||u - u_h||_0 on the finest level, 0 if D is not above the algebraic bound.
    A case without asymptotic levels has no row.
    """
    rows = []
    for name, table in errors.items():
        for case in table["case"].values:
            run = table.sel(case=case)
            observed = asymptotic_l2_rates(run, rates[name].sel(case=case), 1 / ratio)
            if not len(observed):
                continue
            orders = [
                claim["orders"][case]
                for claim in claim_parameters
                if name in claim["scenes"] and case in claim["orders"]
            ]
            finest = run.isel(mesh=-1)
            is_zero = bool(finest["discrete_error"] <= finest["algebraic_bound"])
            share = 0.0 if is_zero else float(finest["discrete_error"] / finest["u_l2_error"])
            rows.append(
                {
                    "scene": name,
                    "case": f"`{case}`",
                    "proved order": f"{max(orders):.3g}" if orders else DASH,
                    "observed rates": f"{observed.min():.2f} to {observed.max():.2f} ({len(observed)} pairs)",
                    r"$D$ over $\Vert u-u_h\Vert_0$": f"{share:.3g}",
                }
            )
    return pd.DataFrame(rows)


FIXED_H = 1 / 8
"""The length of the cells in the table of D over h alone."""


def tabulate_fixed_cells(errors: xr.Dataset) -> pd.DataFrame:
    """D by case on cells of one length and ever finer meshes, and the distance of lambda from P0 there."""
    partition = int(np.argmin(np.abs(errors["H"].values - FIXED_H)))
    levels = errors.isel(partition=partition, mesh=errors["h"].values < FIXED_H * (1 - 1e-9))
    rows = []
    for case in errors["case"].values:
        run = levels.sel(case=case)
        distance = float(run["hm12_best"].max())
        if distance > ZERO_ERROR_SHARE * float(run["u_norm"].max()):
            columns = {
                f"h = {format_value(h, '1/n')}": f"{D:.3g}"
                for h, D in zip(run["h"].values, run["discrete_error"].values, strict=True)
            }
            rows.append({"case": f"`{case}`"} | columns | {r"distance of $\lambda$": f"{distance:.3g}"})
    return pd.DataFrame(rows)


FLOOR_COLUMNS = {"C₁": ("C1", ".3g"), "C₂": ("C2", ".3g"), "s": ("s", ".2f")} | {
    "errors fitted": ("pairs", ".0f"),
    "largest misfit": ("residual", ".2g%"),
}


def tabulate_floors(fits: xr.Dataset) -> pd.DataFrame:
    """The fit of the errors over the whole (h, H) grid, by case."""
    fit_rows = fits.to_dataframe()
    table = pd.DataFrame(
        [{"case": f"`{case}`"} | format_row(fit, FLOOR_COLUMNS) for case, fit in fit_rows.iterrows()]
    )
    table["s"] += [f" ± {uncertainty:.2f}" for uncertainty in fit_rows["s_uncertainty"]]
    return table


INDEX_TITLES = {
    "local_index_u": f"cheap, {SPACES['h1']}",
    "total_index_u": f"sharp, {SPACES['h1']}",
    "total_index_lambda": f"sharp, {SPACES['hm12']}",
}


def tabulate_totals(scenes: Mapping[str, xr.Dataset]) -> pd.DataFrame:
    """The guaranteed bounds on total errors, over the true errors, on the coarsest and the finest level."""
    rows = []
    for name, table in scenes.items():
        for case, (variable, title) in itertools.product(table["case"].values, INDEX_TITLES.items()):
            for k in (0, -1):
                value = float(table[variable].sel(case=case)[k])
                head = f"{title}, h = {format_value(float(table['h'][k]), '1/n')}"
                rows.append((name, f"`{case}`", head, "λ_H exact" if np.isnan(value) else f"{value:.2f}"))
    long = pd.DataFrame(rows, columns=["scene", "case", "at", "index"])
    heads = long["at"].unique()
    cases = pd.MultiIndex.from_frame(long[["scene", "case"]]).unique()
    return long.pivot(index=["scene", "case"], columns="at", values="index").loc[cases, heads].reset_index()


def tabulate_exactness(scenes: Mapping[str, xr.Dataset], claim_parameters: Mapping[str, Any]) -> pd.DataFrame:
    """How fast the sharp bound's index falls to 1, and eta over the error of u on the finest level."""
    rows = []
    for name, table in scenes.items():
        rates = index_rate(table)
        orders = claim_parameters["orders"] if name in claim_parameters["scenes"] else {}
        h = format_value(float(table["h"][-1]), "1/n")
        for case in table["case"].values:
            finest = table.sel(case=case).isel(mesh=-1)
            # Proposition S20: the rate 2 (p - 1); for p = 1 it is only proved that the index falls to 1
            proved = DASH
            order = orders.get(case)
            if order is not None:
                proved = f"{2 * (order - 1):.2f}" if order > 1 else "falls to 0"
            rows.append(
                {
                    "scene": name,
                    "case": f"`{case}`",
                    "proved rate": proved,
                    "observed rate": f"{float(rates.sel(case=case)):.2f}".replace("-", "−"),
                    f"index − 1, h = {h}": f"{float(finest['total_index_u']) - 1:.4f}",
                    f"η over the error, h = {h}": f"{float(finest['total_index_v']):.3f}",
                }
            )
    return pd.DataFrame(rows)


def summarise_corner_totals(corners: xr.Dataset) -> dict[str, Any]:
    """The number of meshes with bounds on totals; lambda's bound over its error at the re-entrant vertex."""
    index = corners["total_index_lambda"].sel(case="reentrant").values
    return {"meshes": len(index), "reentrant": {"coarsest": float(index[0]), "finest": float(index[-1])}}
