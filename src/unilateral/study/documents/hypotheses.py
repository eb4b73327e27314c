"""The hypotheses of 1980 as a table: where the proof uses each, whether it is needed, and what shows it.

The words stand in `hypotheses.yaml`, the numbers come from results.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib import resources

import pandas as pd

from unilateral.formulas.formula import real
from unilateral.study.documents.sources import Sources
from unilateral.study.experiments.cells.checks import exponent, rates
from unilateral.study.experiments.stability.numbers import uniform_beta
from unilateral.study.formats import shown
from unilateral.study.rates_table import smallest_rate
from unilateral.system.declarations import own

HEADS = {"hypothesis": "hypothesis", "used": "used in 1980", "needed": "needed?", "shown": "shown by"}


def numbers(told: Sources) -> dict[str, float]:
    """Exponents of u in H1 and of D over H where one or two hypotheses fail; and beta where h/H is not small.

    `proved` is the exponent of D by Theorem 1 where (jj) and (jjj) fail. In `alternating` each cell has
    contact and a gap.
    """
    ratio = real(told.study["judged_ratio"], "judged_ratio")
    of_u = {
        case: smallest_rate(told.rates[scene].sel(case=case, norm="h1", h_over_H=ratio))
        for scene, case in (("corners", "violates_j"), ("irregular", "violates_jj"))
    }
    cells = told.tables["cells"]
    over_H, rough = exponent(cells, "discrete_error"), cells.sel(case="violates_jj_jjj")
    local = next(each["observed"] for each in told.claims if each["id"] == "S.local")
    return {
        **of_u,
        "cantor": min(over_H["cantor_2"], over_H["cantor_1.5"]),
        "alternating": float(rates(told.tables["alternating"].sel(gamma=0.5)).min()),
        "violates_jj_jjj": over_H["violates_jj_jjj"],
        "proved": float(rough["flux_order"] + rough["gap_order"]) / 2,
        "uniform": uniform_beta(told.pairs)["uniform"],
        "local": local,
    }


def table(values: Mapping[str, float]) -> pd.DataFrame:
    """A row for each hypothesis. Raises KeyError for an unknown number."""

    def filled(words: str) -> str:
        return re.sub(r"<(\w+):([\w.]+)>", lambda mark: shown(values[mark[1]], mark[2]), words)

    rows = own(resources.files("unilateral.study.documents") / "hypotheses.yaml")
    return pd.DataFrame([{head: filled(row[name]) for name, head in HEADS.items()} for row in rows])
