"""The tables of all documents, in Markdown, by the names of their blocks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import pandas as pd

from unilateral.formulas.formula import real
from unilateral.norms.resolution import RULE
from unilateral.study.documents import hypotheses, verdicts
from unilateral.study.documents.sources import Sources
from unilateral.study.experiments.adaptive import numbers as adaptive
from unilateral.study.experiments.benchmarks import commands, scores
from unilateral.study.experiments.benchmarks import numbers as benchmarks
from unilateral.study.experiments.cost import tables as cost
from unilateral.study.experiments.extremes import numbers as extremes
from unilateral.study.experiments.scenes import numbers as scenes
from unilateral.study.experiments.sharpness import numbers as sharpness
from unilateral.study.experiments.stability import numbers as stability

LINE = 150
"""The columns of a table are aligned only if its lines have at most so many letters."""


def markdown(table: pd.DataFrame) -> str:
    """A table of texts in Markdown."""
    rows = [list(table.columns), *table.to_numpy().tolist()]
    widths = [max(map(len, [f"{head}  ", *cells])) for head, *cells in zip(*rows, strict=True)]
    if sum(widths) + 3 * len(widths) + 1 > LINE:
        widths = [0] * len(widths)
    lines = ["| " + " | ".join(map(str.ljust, row, widths)) + " |" for row in rows]
    lines.insert(1, "|" + "|".join("-" * max(3, width + 2) for width in widths) + "|")
    return "\n".join(lines)


def figures(listed: Iterable[tuple[Sequence[str], str]]) -> pd.DataFrame:
    """The table of the figures and what they show, for a page in a folder beside that of the figures."""
    rows = []
    for names, what in listed:
        links = ", ".join(f"[{name}](../figures/{name}.svg)" for name in names)
        rows.append([links, what, f"`snakemake -j2 figures/{names[0]}.svg`"])
    return pd.DataFrame(rows, columns=["figure", "shows", "command"])


def collect(told: Sources) -> dict[str, str]:
    """All blocks, by their names."""
    of, study, infsup = told.tables, told.study, told.study["infsup"]
    ratios = [real(each, "uniform_ratios") for each in infsup["uniform_ratios"]]
    tolerances = {name: study["norms"][name]["tolerance"] for name in ("hm12", "l2")}
    base = {"H_over_h": told.H_over_h, "coarsest": told.coarsest}
    frames = verdicts.claims_tables(told.claims) | {
        "rates": scenes.rates(told.rates, real(study["judged_ratio"], "judged_ratio")),
        "rates-by-case": scenes.rates_by_case(told.rates, real(study["judged_ratio"], "judged_ratio")),
        "beta": stability.least(told.pairs, ratios),
        "correlations": stability.correlations(told.pairs, RULE.smallest_angle),
        "floors": scenes.floors(of["floors"]),
        "totals": scenes.totals(told.totals),
        "adapted": adaptive.finest(of["adapted"], of["adapted_rates"]),
        "adapted-savings": adaptive.savings(of["adapted"]),
        "hypotheses": hypotheses.table(hypotheses.numbers(told)),
        "exceptions": sharpness.exceptions(of["sharpness"], tolerances),
        "ratios": cost.ratios(of["case"], told.coarsest),
        "prices": cost.price_table(of["case"], of["scene"], **base),
        "expected": cost.expected(of["case"], **base),
        "algorithms": cost.algorithms(of["algorithm"], told.H_over_h),
        "targets": cost.targets(of["algorithm"], study["cost"]["targets"]),
        "extremes-limits": extremes.limits(of["extremes"]),
        "extremes-unlimited": extremes.unlimited(of["extremes"]),
        "benchmarks": benchmarks.solvers(of["benchmarks"]),
        "benchmark-phases": benchmarks.phases(of["benchmarks"]),
        "benchmark-problems": benchmarks.problems(of["benchmarks"]),
        "commands": commands.table(told.commands),
        "scores": scores.solvers(told.scores),
        "figures": figures(study["figures"]),
    }
    return {name: markdown(frame) for name, frame in frames.items()}
