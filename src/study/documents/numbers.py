"""What documents are filled with: named numbers, and tables in Markdown.

Those of an experiment stand in its module `numbers`, in the functions `numbers` and `blocks`. These are given
what files hold, by the files' places, such as square/rates, and the configuration.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks import numbers as benchmarks
from study import tables
from study.documents import verdicts
from study.experiments.adaptive import numbers as adaptive
from study.experiments.cells import numbers as cells
from study.experiments.certain import numbers as certain
from study.experiments.certify import numbers as certify
from study.experiments.cost import numbers as cost
from study.experiments.extremes import numbers as extremes
from study.experiments.graded import numbers as graded
from study.experiments.multipliers import numbers as multipliers
from study.experiments.scenes import numbers as scenes
from study.experiments.sharpness import numbers as sharpness
from study.experiments.stability import numbers as stability
from study.formats import DASH, Value
from study.ledger import records, texts
from study.ledger.records import ORIGINS, source_origin
from study.table_origin import table_place
from unilateral.norms.resolution import RULE
from unilateral.system.files import replacing

NUMBER_MODULES = (
    *(adaptive, benchmarks, cells, certain, certify, cost, extremes, graded, multipliers),
    *(scenes, sharpness, stability),
)
LOADERS: dict[str, Callable[[str], Any]] = {
    ".nc": tables.load_table,
    ".csv": pd.read_csv,
    ".json": records.read_records,
}
"""How files are read, by their endings."""
MAX_ALIGNED_LETTERS = 150
"""The columns of a table are aligned only if its lines have at most so many letters."""


def write_numbers(files: Sequence[str], study: Mapping[str, Any], numbers: str, blocks: str) -> None:
    """Write all numbers and all blocks as JSON, one on each line, from these files of results."""
    collected = collect_numbers(files, study)
    for values, path in zip(collected, (numbers, blocks), strict=True):
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(values, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def collect_numbers(
    files: Sequence[str], study: Mapping[str, Any]
) -> tuple[dict[str, Value], dict[str, str]]:
    """All numbers by name, and all blocks by name."""
    results = {table_place(file): LOADERS[Path(file).suffix](file) for file in files}
    numbers, frames = _study_numbers(results, study)
    for experiment in NUMBER_MODULES:
        numbers |= experiment.numbers(results, study)
        if hasattr(experiment, "blocks"):
            frames |= experiment.blocks(results, study)
    return flatten_groups(numbers), {name: format_markdown(frame) for name, frame in frames.items()}


def _study_numbers(
    results: Mapping[str, Any], study: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, pd.DataFrame]]:
    """Parameters, claims and the costs of the whole study; the tables of claims and of figures."""
    claims = results["results/claims"]
    observed = {record["id"]: {"observed": record["observed"]} for record in claims}
    make = results["benchmarks/whole"]
    measured = make | results["benchmarks/installations"]
    uses = {name: resource_use(record) for name, record in measured.items() if isinstance(record, Mapping)}
    numbers = {
        "study": _documented_parameters(study) | {"infsup": {"rule": RULE._asdict()}},
        "claims": observed | count_claims(claims),
        "whole": uses | {name: make[name] for name in ("cores", "date")},
    }
    return numbers, verdicts.tabulate_claims(claims) | {"figures": tabulate_figures(study["figures"])}


def _documented_parameters(study: Mapping[str, Any]) -> dict[str, Any]:
    """The parameters that documents name."""
    cost = study["cost"]
    extremes = study["extremes"]
    rates = study["rates"]
    axes = {axis: {"h": extremes["axes"][axis]["h"]} for axis in ("ratio", "shift")}
    axes["single"] = {"accuracy": extremes["axes"]["single"]["accuracy"]}
    return {
        "adaptive": {name: study["adaptive"][name] for name in ("factor", "h", "most")},
        "cost": {"base": {"H_over_h": cost["base"]["H_over_h"]}, "fitted_from": cost["fitted_from"]},
        "extremes": {name: extremes[name] for name in ("h", "H", "accuracy", "max_steps")} | {"axes": axes},
        "judged_ratio": rates["judged_ratio"],
        "norms": {norm: {"tolerance": rates["norms"][norm]["tolerance"]} for norm in ("h1", "hm12")},
    }


def count_claims(claims: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """How many claims have a check, a margin or neither, and where the required numbers come from."""
    origins = Counter(source_origin(record["source"]) for record in claims if record["source"] is not None)
    counts = {"all": origins.total(), "unmeasured": len(claims) - origins.total()}
    counts["margins"] = sum(texts.describe_margin(record) != DASH for record in claims)
    return counts | {"thresholds": {name: origins[name] for name in ORIGINS}}


def resource_use(measured: Mapping[str, float]) -> dict[str, Any]:
    """Minutes, GB of memory and of the disk, and packages, from seconds, MB and packages."""
    sizes = {name: measured[name] / 1024 for name in ("memory", "disk") if name in measured}
    packages = {"packages": measured["packages"]} if "packages" in measured else {}
    return {"minutes": measured["seconds"] / 60, **sizes, **packages}


def flatten_groups(groups: Mapping[str, Any], prefix: str = "") -> dict[str, Value]:
    """{"a": {"b": 1, "c": [2]}} as {"a.b": 1}: names lead through the groups, and lists are left out."""
    values: dict[str, Value] = {}
    for name, value in groups.items():
        if isinstance(value, Mapping):
            values |= flatten_groups(value, f"{prefix}{name}.")
        elif isinstance(value, Value):
            values[f"{prefix}{name}"] = value
    return values


def tabulate_figures(figures: Mapping[str, Mapping[str, Any]]) -> pd.DataFrame:
    """The table of the figures and what they show, for a page in a folder beside that of the figures."""
    rows = []
    for entry, figure in figures.items():
        names = [f"{entry}_{scene}" for scene in figure["scenes"]] if "scenes" in figure else [entry]
        links = ", ".join(f"[{name}](../figures/{name}.svg)" for name in names)
        rows.append([links, figure["shows"], f"`snakemake -j2 figures/{names[0]}.svg`"])
    return pd.DataFrame(rows, columns=["figure", "shows", "command"])


def format_markdown(table: pd.DataFrame) -> str:
    """A table of texts in Markdown."""
    rows = [list(table.columns), *table.to_numpy().tolist()]
    widths = [max(map(len, [f"{head}  ", *cells])) for head, *cells in zip(*rows, strict=True)]
    if sum(widths) + 3 * len(widths) + 1 > MAX_ALIGNED_LETTERS:
        widths = [0] * len(widths)
    lines = ["| " + " | ".join(map(str.ljust, row, widths)) + " |" for row in rows]
    lines.insert(1, "|" + "|".join("-" * max(3, width + 2) for width in widths) + "|")
    return "\n".join(lines)
