"""The report's page on which a case, a norm and h/H are chosen, and errors, bounds and rates are seen."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
import xarray as xr

from study import tables
from study.experiments.scenes.numbers import describe_rate
from study.style import format_fraction
from study.tables import ERROR_NORMS, error_in_norm, select_ratio
from unilateral.formulas.decimals import format_down, format_up
from unilateral.problems.case import read_case_declaration
from unilateral.system.files import replacing

BOUNDED_QUANTITY = {"h1": "u", "hm12": "lambda"}
"""In the names of totals, what is bounded in each norm."""
CURVE_FORMAT = ".4g"
BOUND_ROUNDING: dict[str, Callable[[float, str], str]] = {
    "lower": format_down,
    "upper": format_up,
    "sharp": format_up,
    "cheap": format_up,
}
"""Bounds are rounded so that they stay bounds; other numbers to the nearest."""


def write_curves(
    errors: Sequence[str], rates: Sequence[str], totals: Sequence[str], template: str, page: str
) -> None:
    """Write the page from the tables of all scenes.

    `totals` are of some of the scenes. The page holds plotly.js, and needs no network.
    """
    from plotly.offline import get_plotlyjs

    scene_errors = _tables_by_scene(errors)
    scene_rates = _tables_by_scene(rates)
    scene_totals = _tables_by_scene(totals)
    scene_curves = [
        curve
        for scene, fitted in scene_rates.items()
        for curve in collect_curves(scene, scene_errors[scene], fitted, scene_totals.get(scene))
    ]
    titles = {curve["case"]: read_case_declaration(curve["case"])[0]["title"] for curve in scene_curves}
    text = Template(Path(template).read_text(encoding="utf-8")).substitute(
        plotly=get_plotlyjs(), curves=_embed_json(scene_curves), titles=_embed_json(titles)
    )
    with replacing(page) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _tables_by_scene(paths: Sequence[str]) -> dict[str, xr.Dataset]:
    return {table.attrs["scene"]: table for table in map(tables.load_table, paths)}


def _embed_json(value: object) -> str:
    """JSON that ends no script of a page."""
    return json.dumps(value, ensure_ascii=False, allow_nan=False).replace("</", "<\\/")


def collect_curves(
    scene: str, errors: xr.Dataset, rates: xr.Dataset, totals: xr.Dataset | None
) -> list[dict[str, Any]]:
    """Curves by case, norm and h/H: levels, rates of pairs of levels, and the proved and expected rate."""
    return [
        {
            "scene": scene,
            "case": case,
            "norm": norm,
            "ratio": format_fraction(ratio),
            "levels": _curve_levels(select_ratio(errors, ratio).sel(case=case), norm, totals),
            "pairs": _curve_pairs(rates.sel(case=case, norm=norm, h_over_H=ratio)),
            **_describe_rates(rates.sel(case=case, norm=norm, h_over_H=ratio)),
        }
        for case in rates["case"].values.tolist()
        for norm in ERROR_NORMS
        for ratio in rates["h_over_H"].values.tolist()
    ]


def _curve_levels(runs: xr.Dataset, norm: str, totals: xr.Dataset | None) -> list[dict[str, Any]]:
    """h, H and the error of each level; in H^{-1/2} the bounds between which it lies.

    Where the total error was bounded, the sharp and the cheap guaranteed bound are among them.
    """
    columns: dict[str, Any] = {"h": runs["h"], "H": runs["H"], "error": error_in_norm(runs, norm)}
    if norm == "hm12":
        columns |= {bound: error_in_norm(runs, norm, bound) for bound in ("lower", "upper")}
    rows = [{name: float(values[k]) for name, values in columns.items()} for k in range(runs.sizes["run"])]
    for row in rows:
        row |= _guaranteed_bounds(row, str(runs["case"].item()), norm, totals)
    return [
        {name: _round_number(value, BOUND_ROUNDING.get(name, format)) for name, value in row.items()}
        for row in rows
    ]


def _guaranteed_bounds(
    row: Mapping[str, float], case: str, norm: str, totals: xr.Dataset | None
) -> dict[str, float]:
    """The guaranteed bounds on a level, which the table of totals has as multiples of the true error."""
    if totals is None or norm not in BOUNDED_QUANTITY or case not in totals["case"]:
        return {}
    is_same_mesh = np.all([np.isclose(totals[size], row[size], rtol=1e-9) for size in "hH"], axis=0)
    if not is_same_mesh.any():
        return {}
    error = row.get("upper", row["error"])
    level = totals.sel(case=case).isel(mesh=int(is_same_mesh.argmax()))
    return {
        "sharp": error * float(level[f"total_index_{BOUNDED_QUANTITY[norm]}"]),
        "cheap": error * float(level[f"local_index_{BOUNDED_QUANTITY[norm]}"]),
    }


def _curve_pairs(rates: xr.Dataset) -> list[dict[str, Any]]:
    """The rates of neighbouring levels, and whether each counts."""
    pairs = zip(*(rates[name].values for name in ("h_coarse", "h_fine", "rate", "asymptotic")), strict=True)
    return [
        {
            "coarse": _round_number(coarse),
            "fine": _round_number(fine),
            "rate": _round_number(rate),
            "counts": bool(counts == 1),
        }
        for coarse, fine, rate, counts in pairs
        if np.isfinite(coarse)
    ]


def _describe_rates(rates: xr.Dataset) -> dict[str, Any]:
    """The proved, the expected and the observed rate, with the verdict's reasons, for the page."""
    numbers = {name: _round_number(float(rates[name])) for name in ("proved", "expected")}
    exact = rates["verdict"].item() == "exact"
    return numbers | {
        "exact": exact,
        "observed": describe_rate(rates).replace("**", ""),
        "why": rates["why"].item(),
    }


def _round_number(value: float, rounded: Callable[[float, str], str] = format) -> float | None:
    """A number with few digits, None where there is none."""
    return float(rounded(float(value), CURVE_FORMAT)) if math.isfinite(value) else None
