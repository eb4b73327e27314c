"""Tables of rates, floors and bounds, as documents show them."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from study.experiments.scenes.checks import index_rate
from study.formats import DASH, ERROR_TITLES, SPACES, format_row, format_value
from study.rates import ERROR_NORMS, smallest_rate
from study.scenes import has_clamped_sides
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
    (exact,) = [claim for claim in read_stored_yaml(SCENE_CLAIMS)["claims"] if claim["id"] == "F.exact"]
    scenes = [name for name, scene in study["scenes"].items() if scene["judged"]]
    judged, clamped = split_clamped_scenes({name: results[f"{name}/rates"] for name in scenes})
    bounded, clamped_totals = split_clamped_scenes(
        {name: results[f"{name}/totals"] for name in study["totals"]["scenes"]}
    )
    return {
        "rates": tabulate_rates(judged, ratio),
        "rates-by-case": tabulate_rates_by_case(judged, ratio, study["rates"]["cases"]),
        "rates-clamped": tabulate_rates_by_case(clamped, ratio, study["rates"]["cases"]),
        "floors": tabulate_floors(results["square/floors"]),
        "totals": tabulate_totals(bounded),
        "totals-clamped": tabulate_totals(clamped_totals),
        "exactness": tabulate_exactness(bounded, exact["parameters"]),
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
            # Proposition S9: the rate 2 (p - 1); for p = 1 it is only proved that the index falls to 1
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
