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
from study.experiments.scenes.numbers import observed
from study.style import as_fraction
from study.tables import NORMS, along_ratio, error_in
from unilateral.formulas.decimals import down, up
from unilateral.problems.case import declared
from unilateral.system.files import replacing

OF = {"h1": "u", "hm12": "lambda"}
"""In the names of totals, what is bounded in each norm."""
DIGITS = ".4g"
ROUNDED: dict[str, Callable[[float, str], str]] = {"lower": down, "upper": up, "sharp": up, "cheap": up}
"""Bounds are rounded so that they stay bounds; other numbers to the nearest."""


def write(
    errors: Sequence[str], rates: Sequence[str], totals: Sequence[str], template: str, page: str
) -> None:
    """Write the page from the tables of all scenes.

    `totals` are of some of the scenes. The page holds plotly.js, and needs no network.
    """
    from plotly.offline import get_plotlyjs

    of_errors = {table.attrs["scene"]: table for table in map(tables.load, errors)}
    of_rates = {table.attrs["scene"]: table for table in map(tables.load, rates)}
    of_totals = {table.attrs["scene"]: table for table in map(tables.load, totals)}
    found = [
        curve
        for scene, fitted in of_rates.items()
        for curve in curves(scene, of_errors[scene], fitted, of_totals.get(scene))
    ]
    titles = {each["case"]: declared(each["case"])[0]["title"] for each in found}
    text = Template(Path(template).read_text(encoding="utf-8")).substitute(
        plotly=get_plotlyjs(), curves=_script(found), titles=_script(titles)
    )
    with replacing(page) as temporary:
        temporary.write_text(text, encoding="utf-8")


def _by_scene(paths: Sequence[str]) -> dict[str, xr.Dataset]:
    return {table.attrs["scene"]: table for table in map(tables.load, paths)}


def _script(of: object) -> str:
    """JSON that ends no script of a page."""
    return json.dumps(of, ensure_ascii=False, allow_nan=False).replace("</", "<\\/")


def curves(
    scene: str, errors: xr.Dataset, rates: xr.Dataset, totals: xr.Dataset | None
) -> list[dict[str, Any]]:
    """Of each case, norm and h/H: the levels, the rates of pairs of them, and what is proved and expected."""
    return [
        {
            "scene": scene,
            "case": case,
            "norm": norm,
            "ratio": as_fraction(ratio),
            "levels": _levels(along_ratio(errors, ratio).sel(case=case), norm, totals),
            "pairs": _pairs(rates.sel(case=case, norm=norm, h_over_H=ratio)),
            **_rates(rates.sel(case=case, norm=norm, h_over_H=ratio)),
        }
        for case in rates["case"].values.tolist()
        for norm in NORMS
        for ratio in rates["h_over_H"].values.tolist()
    ]


def _levels(runs: xr.Dataset, norm: str, totals: xr.Dataset | None) -> list[dict[str, Any]]:
    """h, H and the error of each level; in H^{-1/2} the bounds between which it lies.

    Where the total error was bounded, the sharp and the cheap guaranteed bound are among them.
    """
    columns: dict[str, Any] = {"h": runs["h"], "H": runs["H"], "error": error_in(runs, norm)}
    if norm == "hm12":
        columns |= {bound: error_in(runs, norm, bound) for bound in ("lower", "upper")}
    rows = [{name: float(values[k]) for name, values in columns.items()} for k in range(runs.sizes["run"])]
    for row in rows:
        row |= _bounds(row, str(runs["case"].item()), norm, totals)
    return [{name: _number(value, ROUNDED.get(name, format)) for name, value in row.items()} for row in rows]


def _bounds(row: Mapping[str, float], case: str, norm: str, totals: xr.Dataset | None) -> dict[str, float]:
    """The guaranteed bounds on a level, which the table of totals has as multiples of the true error."""
    if totals is None or norm not in OF or case not in totals["case"]:
        return {}
    at = np.all([np.isclose(totals[size], row[size], rtol=1e-9) for size in "hH"], axis=0)
    if not at.any():
        return {}
    error = row.get("upper", row["error"])
    level = totals.sel(case=case).isel(mesh=int(at.argmax()))
    return {
        "sharp": error * float(level[f"total_index_{OF[norm]}"]),
        "cheap": error * float(level[f"local_index_{OF[norm]}"]),
    }


def _pairs(of: xr.Dataset) -> list[dict[str, Any]]:
    """The rates of neighbouring levels, and whether each counts."""
    found = zip(*(of[name].values for name in ("h_coarse", "h_fine", "rate", "asymptotic")), strict=True)
    return [
        {"coarse": _number(coarse), "fine": _number(fine), "rate": _number(rate), "counts": bool(counts == 1)}
        for coarse, fine, rate, counts in found
        if np.isfinite(coarse)
    ]


def _rates(of: xr.Dataset) -> dict[str, Any]:
    """What is proved and expected, and what was observed, in words."""
    numbers = {name: _number(float(of[name])) for name in ("proved", "expected")}
    exact = of["verdict"].item() == "exact"
    return numbers | {"exact": exact, "observed": observed(of).replace("**", ""), "why": of["why"].item()}


def _number(value: float, rounded: Callable[[float, str], str] = format) -> float | None:
    """A number with few digits, None where there is none."""
    return float(rounded(float(value), DIGITS)) if math.isfinite(value) else None
