"""paper.md: its tables."""

import pandas as pd
from sentences import speak_plainly

from unilateral.formulas.formula import real
from unilateral.study import tables
from unilateral.study.judge import records
from unilateral.study.runs import extremes
from unilateral.study.text import cost_text, documents, extremes_text, verdicts


def main(given, study, paper):
    blocks = verdicts.claims_tables(records.read(given["claims"]))
    blocks |= of_errors(given, study) | of_cost(given, study["cost"])
    documents.fill(paper, blocks | of_extremes(tables.load(given["extremes"]), study))


def of_errors(given, study):
    rates, totals = (
        {name: tables.load(path) for name, path in zip(study[scenes], given[what], strict=True)}
        for scenes, what in (("scenes", "rates"), ("bounded", "totals"))
    )
    pairs, infsup = pd.read_csv(given["pairs"]), study["infsup"]
    tolerances = {name: study["norms"][name]["tolerance"] for name in ("hm12", "l2")}
    return {
        "rates": documents.rates_table(rates, real(study["judged_ratio"], "judged_ratio")),
        "beta": documents.infsup_table(
            pairs, [real(each, "uniform_ratios") for each in infsup["uniform_ratios"]]
        ),
        "rule": documents.infsup_rule(pairs, **infsup["rule"]),
        "floors": documents.floors_table(tables.load(given["floors"])),
        "totals": documents.totals_table(totals),
        "exceptions": documents.exceptions(tables.load(given["sharpness"]), tolerances),
    }


def of_cost(given, study):
    crossed, cases, scene, algebra, precision = (
        tables.load(given[name]) for name in ("algorithm", "case", "scene", "algebra", "precision")
    )
    H_over_h = real(study["base"]["H_over_h"], "H_over_h")
    coarsest = real(study["fitted_from"], "fitted_from")
    return {
        "ratios": cost_text.ratios(cases, coarsest),
        "prices": cost_text.price_table(cases, scene, H_over_h, coarsest),
        "algorithms": cost_text.algorithms(crossed, H_over_h),
        "targets": cost_text.targets(crossed, study["targets"]),
        "growth": cost_text.growth(crossed, coarsest),
        "elimination": cost_text.elimination(crossed, algebra, H_over_h),
        "precision": cost_text.in_precision(precision),
    }


def of_extremes(broken, study):
    deep = study["deep"]
    return {
        "extremes-setting": extremes_text.setting(study["extremes"]),
        "extremes-memory": extremes_text.memory(deep["memory"], extremes.finest(deep["memory"]), deep["h"]),
        "extremes-outcomes": extremes_text.sentences(broken),
        "extremes-limits": extremes_text.limits_table(broken),
    }


if __name__ == "__main__":
    speak_plainly()
    main(dict(snakemake.input.items()), dict(snakemake.params.items()), snakemake.output[0])
