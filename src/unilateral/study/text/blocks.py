"""The tables of all documents, in Markdown, by the names of their blocks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import pandas as pd

from unilateral.formulas.formula import real
from unilateral.norms.resolution import RULE
from unilateral.study.text import (
    adaptive_tables,
    benchmark_tables,
    command_tables,
    cost_tables,
    error_tables,
    extremes_tables,
    hypotheses,
    score_tables,
    verdicts,
)
from unilateral.study.text.sources import Sources

LINE = 150
"""Letters in a line: in a wider table columns are not aligned."""


def markdown(table: pd.DataFrame) -> str:
    """All cells are texts."""
    rows = [list(table.columns), *table.to_numpy().tolist()]
    widths = [max(map(len, [f"{head}  ", *cells])) for head, *cells in zip(*rows, strict=True)]
    if sum(widths) + 3 * len(widths) + 1 > LINE:
        widths = [0] * len(widths)
    lines = ["| " + " | ".join(map(str.ljust, row, widths)) + " |" for row in rows]
    lines.insert(1, "|" + "|".join("-" * max(3, width + 2) for width in widths) + "|")
    return "\n".join(lines)


def figures(listed: Iterable[tuple[Sequence[str], str]]) -> pd.DataFrame:
    """Names of figures and what they show, for a page in a folder beside theirs."""
    rows = []
    for names, what in listed:
        links = ", ".join(f"[{name}](../figures/{name}.svg)" for name in names)
        rows.append([links, what, f"`snakemake -j2 figures/{names[0]}.svg`"])
    return pd.DataFrame(rows, columns=["figure", "shows", "command"])


def collect(told: Sources) -> dict[str, str]:
    """All blocks."""
    of, study, infsup = told.tables, told.study, told.study["infsup"]
    ratios = [real(each, "uniform_ratios") for each in infsup["uniform_ratios"]]
    tolerances = {name: study["norms"][name]["tolerance"] for name in ("hm12", "l2")}
    base = {"H_over_h": told.H_over_h, "coarsest": told.coarsest}
    frames = verdicts.claims_tables(told.claims) | {
        "rates": error_tables.rates(told.rates, real(study["judged_ratio"], "judged_ratio")),
        "rates-by-case": error_tables.rates_by_case(told.rates, real(study["judged_ratio"], "judged_ratio")),
        "beta": error_tables.beta(told.pairs, ratios),
        "correlations": error_tables.correlations(told.pairs, RULE.smallest_angle),
        "floors": error_tables.floors(of["floors"]),
        "totals": error_tables.totals(told.totals),
        "adapted": adaptive_tables.finest(of["adapted"], of["adapted_rates"]),
        "adapted-savings": adaptive_tables.savings(of["adapted"]),
        "hypotheses": hypotheses.table(hypotheses.numbers(told)),
        "exceptions": error_tables.exceptions(of["sharpness"], tolerances),
        "ratios": cost_tables.ratios(of["case"], told.coarsest),
        "prices": cost_tables.price_table(of["case"], of["scene"], **base),
        "expected": cost_tables.expected(of["case"], **base),
        "algorithms": cost_tables.algorithms(of["algorithm"], told.H_over_h),
        "targets": cost_tables.targets(of["algorithm"], study["cost"]["targets"]),
        "extremes-limits": extremes_tables.limits(of["extremes"]),
        "extremes-unlimited": extremes_tables.unlimited(of["extremes"]),
        "benchmarks": benchmark_tables.solvers(of["benchmarks"]),
        "benchmark-phases": benchmark_tables.phases(of["benchmarks"]),
        "benchmark-problems": benchmark_tables.problems(of["benchmarks"]),
        "commands": command_tables.table(told.commands),
        "scores": score_tables.solvers(told.scores),
        "figures": figures(study["figures"]),
    }
    return {name: markdown(frame) for name, frame in frames.items()}
