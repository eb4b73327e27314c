"""Documents whose numbers come from the results: text between marks is replaced, all else is kept.

A block stands between the lines `<!-- NAME: begin -->` and `<!-- NAME: end -->`.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from unilateral.errors import InputError
from unilateral.files import replacing
from unilateral.study.judge.rates import NORMS
from unilateral.study.judge.rates_table import smallest_rate

SPACES = {"h1": "H¹", "hm12": "H^(−1/2)", "l2": "L²"}
TITLES = {norm: f"{'u' if norm == 'h1' else 'λ'} in {space}" for norm, space in SPACES.items()}


def fill(path: str | Path, blocks: Mapping[str, str]) -> None:
    """Put each block's text between its marks in the file.

    Raises InputError where marks are no pairs of a begin and an end, or their blocks are not those given.
    """
    text = Path(path).read_text(encoding="utf-8")
    marks = re.findall(r"^<!-- ([\w-]+): (begin|end) -->$", text, re.MULTILINE)
    found = [name for name, _ in marks[::2]]
    if marks != [(name, part) for name in found for part in ("begin", "end")]:
        listed = ", ".join(f"{name}: {part}" for name, part in marks)
        raise InputError(f"{path}: each block needs one begin mark and then one end mark, not {listed}")
    if sorted(found) != sorted(blocks):
        raise InputError(f"{path}: it has the marked blocks {sorted(found)}, and needs {sorted(blocks)}")
    block = re.compile(r"^(<!-- ([\w-]+): begin -->\n).*?^(<!-- \2: end -->)$", re.DOTALL | re.MULTILINE)
    text = block.sub(lambda m: f"{m[1]}{blocks[m[2]]}\n{m[3]}", text)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def rates_table(scenes: Mapping[str, xr.Dataset], ratio: float) -> str:
    """A Markdown table: per scene and case, the smallest asymptotic rate in each norm."""
    first = next(iter(scenes.values()))
    proved = {norm: float(first["proved"].sel(norm=norm, h_over_H=ratio).max()) for norm in NORMS}
    head = [f"{TITLES[norm]} (proved {proved[norm]:g})" for norm in NORMS]
    lines = ["| scene | case | " + " | ".join(head) + " |", "|---|---|" + "---|" * len(NORMS)]
    for name, rates in scenes.items():
        for case in rates["case"].values:
            cells = [_cell(rates.sel(case=case, norm=norm, h_over_H=ratio)) for norm in NORMS]
            lines.append(f"| {name} | `{case}` | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def floors_table(floors: xr.Dataset) -> str:
    """A Markdown table: the fit of the errors over the whole (h, H) grid, by case."""
    lines = ["| case | C₁ | C₂ | s | errors fitted | largest misfit |", "|---|---|---|---|---|---|"]
    for case in floors["case"].values:
        of = floors.sel(case=case)
        C1, C2 = (f"{float(of[name]):.3g}" for name in ("C1", "C2"))
        s = f"{float(of['s']):.2f} ± {float(of['s_uncertainty']):.2f}"
        misfit = f"{100 * float(of['residual']):.2g} %"
        lines.append(f"| `{case}` | {C1} | {C2} | {s} | {int(of['pairs'])} | {misfit} |")
    return "\n".join(lines)


def totals_table(scenes: Mapping[str, xr.Dataset]) -> str:
    """A Markdown table: guaranteed total errors over the true ones on the coarsest and finest level."""
    first = next(iter(scenes.values()))
    sizes = [f"1/{round(1 / h)}" for h in first["h"].values]
    head = [f"{SPACES[norm]}, h = {size}" for norm in ("h1", "hm12") for size in (sizes[0], sizes[-1])]
    lines = ["| scene | case | " + " | ".join(head) + " |", "|---|---|" + "---|" * len(head)]
    for name, table in scenes.items():
        for case in table["case"].values:
            of = table.sel(case=case).isel(mesh=[0, -1])
            found = [*of["total_index_u"].values, *of["total_index_lambda"].values]
            cells = ["λ_H exact" if np.isnan(index) else f"{index:.2f}" for index in found]
            lines.append(f"| {name} | `{case}` | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def exceptions(rates: xr.Dataset, tolerances: Mapping[str, float]) -> str:
    """A sentence: where, for alpha > 0, rates of the multiplier on the finest levels miss those predicted."""
    missing = (rates["predicted"] - rates["rate"].isel(pair=-1)).where(rates["alpha"] > 0, drop=True)
    found = []
    for alpha in missing["alpha"].values:
        for gamma in missing["gamma"].values:
            here = {norm: float(missing.sel(norm=norm, alpha=alpha, gamma=gamma)) for norm in tolerances}
            low = [f"{here[n]:.2f} in {SPACES[n]}" for n in tolerances if here[n] > tolerances[n]]
            if low:
                found.append(f"$(\\alpha,\\gamma)=({alpha:g},{gamma:g})$, by {' and '.join(low)}")
    start = (
        "On the finest pair of levels averages over positions miss these rates by more than the tolerance "
    )
    return textwrap.fill(start + ("at " + "; at ".join(found) if found else "nowhere") + ".", LINE)


MEASURES = {
    "h_over_H": "h/H",
    "edges_per_cell": "fewest boundary edges in a cell",
    "cell_over_edge": "smallest $H_i$ over the longest edge at it",
}


LINE = 118
ROUNDED = 1e-4
"""Relative, of the numbers in a committed table."""


def infsup_table(pairs: pd.DataFrame, ratios: Sequence[float]) -> str:
    """A Markdown table: lower bounds of beta on uniform meshes, per family of meshes and H/h."""
    uniform = pairs[pairs["kind"] == "uniform"]
    lines = [
        "| β ≥ ... at H/h = | " + " | ".join(f"{ratio:g}" for ratio in ratios) + " |",
        "|---|" + "---|" * len(ratios),
    ]
    for label, of in uniform.groupby("label", sort=False):
        at = [of.loc[np.isclose(of["h_over_H"] * ratio, 1, rtol=ROUNDED), "beta_lower"] for ratio in ratios]
        lines.append(f"| {label} | " + " | ".join(_floor(each.min()) for each in at) + " |")
    return "\n".join(lines)


def infsup_rule(pairs: pd.DataFrame, cell_over_edge: float, smallest_angle: float) -> str:
    """Sentences: what the pairs say of a rule for beta, and which measure of h/H predicts beta best."""
    few = cell_over_edge * (1 - ROUNDED)
    flat, fine = pairs["smallest_angle"] < smallest_angle, pairs["cell_over_edge"] >= few
    kept, broken = pairs[fine & ~flat], _worst(pairs[fine & flat])
    counted = _worst(pairs[pairs["edges_per_cell"] >= few])
    other = pairs[(pairs["kind"] != "uniform") & (pairs["edges_per_cell"] > 0)]
    round_ones = other[other["smallest_angle"] >= smallest_angle]
    text = (
        f"If every boundary edge that meets a cell is at most 1/{cell_over_edge:g} of it, and the triangles "
        f"at the boundary have no angle below {smallest_angle:g}°, then "
        f"β ≥ {_floor(kept['beta_lower'].min())} in all {len(kept)} such pairs of a mesh and a partition. "
        f"With smaller angles it is down to {broken['beta_upper']:.2f} ({broken['label']}). Merely "
        f"{cell_over_edge:g} edges in every cell, whatever their lengths, leave "
        f"{counted['beta_upper']:.2f} ({counted['label']}, angles down to {counted['smallest_angle']:.1f}°)."
    )
    lines = [
        textwrap.fill(text, LINE),
        "",
        "| rank correlation of β with | " + " | ".join(MEASURES.values()) + " |",
        "|---|" + "---|" * len(MEASURES),
        _correlations(other, "pairs that are not uniform"),
        _correlations(round_ones, f"of them without angles below {smallest_angle:g}°"),
    ]
    return "\n".join(lines)


def _worst(pairs: pd.DataFrame) -> pd.Series:
    return pairs.nsmallest(1, "beta_upper").iloc[0]


def _correlations(pairs: pd.DataFrame, what: str) -> str:
    found = [pairs[name].corr(pairs["beta_lower"], method="spearman") for name in MEASURES]
    return f"| {len(pairs)} {what} | " + " | ".join(f"{value:.2f}" for value in found) + " |"


def _floor(value: float) -> str:
    return f"{math.floor(100 * value) / 100:.2f}"


def _cell(of: xr.Dataset) -> str:
    verdict = of["verdict"].item()
    if verdict == "exact":
        return "error 0, as exact"
    if verdict == "not judged":
        return verdict
    pairs = int(np.count_nonzero(of["asymptotic"].values == 1))
    suffix = "" if verdict == "holds" else f", **{verdict}**"
    return f"{smallest_rate(of):.2f} of {float(of['expected']):.3g} ({pairs} pairs){suffix}"
