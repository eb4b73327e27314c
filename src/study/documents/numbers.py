"""What documents are filled with: named numbers, and tables in Markdown.

Those of an experiment stand in its module `numbers`: `READS` names files, and the functions `numbers` and
`blocks` are given what these files hold, by name, and the configuration. A path with {judged} or {bounded}
stands for the files of all judged scenes, or of those with bounds on total errors, by scene.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import Any

import pandas as pd

from study import figure_entries, registry, tables
from study.documents import verdicts
from study.formats import Value
from study.ledger import records, texts
from study.ledger.records import ORIGINS, origin
from unilateral.norms.resolution import RULE
from unilateral.system.files import replacing

READS = {
    "claims": "results/claims.json",
    "installations": "benchmarks/installations.json",
    "whole": "benchmarks/whole.json",
}
"""The files that belong to no experiment, by name."""
LINE = 150
"""The columns of a table are aligned only if its lines have at most so many letters."""


def write_numbers(study: Mapping[str, Any], numbers: str, blocks: str) -> None:
    """Write all numbers and all blocks as JSON, one on each line."""
    found = collect(study)
    for values, path in zip(found, (numbers, blocks), strict=True):
        with replacing(path) as temporary:
            temporary.write_text(json.dumps(values, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def collect(study: Mapping[str, Any]) -> tuple[dict[str, Value], dict[str, str]]:
    """All numbers by name, and all blocks by name."""
    numbers, frames = _of_the_study(_read(READS, study), study)
    for package in registry.having("numbers"):
        module = import_module(f"study.{package}.numbers")
        of = _read(module.READS, study)
        numbers |= module.numbers(of, study)
        frames |= module.blocks(of, study) if hasattr(module, "blocks") else {}
    return flat(numbers), {name: markdown(frame) for name, frame in frames.items()}


def files(study: Mapping[str, Any]) -> list[str]:
    """All files that are read."""
    reads = [READS, *(registry.constant(f"{each}.numbers", "READS") for each in registry.having("numbers"))]
    found = [_paths(path, study).values() for of in reads for path in of.values()]
    return list(dict.fromkeys(chain.from_iterable(found)))


def _paths(path: str, study: Mapping[str, Any]) -> dict[str, str]:
    """The files that a path stands for, by scene."""
    scenes = study["scenes"]
    known = {
        "{judged}": [name for name, scene in scenes.items() if scene["judged"]],
        "{bounded}": study["totals"]["scenes"],
    }
    for mark, names in known.items():
        if mark in path:
            return {name: path.replace(mark, name) for name in names}
    return {"": path}


def _read(files: Mapping[str, str], study: Mapping[str, Any]) -> dict[str, Any]:
    """What the files hold, by name; by scene, too, where a path stands for several."""
    found: dict[str, Any] = {}
    for name, path in files.items():
        of = {scene: _load(each) for scene, each in _paths(path, study).items()}
        found[name] = of.get("", of)
    return found


def _load(path: str) -> Any:
    loaders: dict[str, Any] = {".nc": tables.load, ".csv": pd.read_csv, ".json": records.read}
    return loaders[Path(path).suffix](path)


def _of_the_study(
    of: Mapping[str, Any], study: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[str, pd.DataFrame]]:
    """Parameters, claims and the costs of the whole study; the tables of claims and of figures."""
    told = {name: study[name] for name in ("adaptive", "cost", "extremes")}
    told |= {name: study["rates"][name] for name in ("judged_ratio", "norms")}
    observed = {each["id"]: {"observed": each["observed"]} for each in of["claims"]}
    measured = of["whole"] | of["installations"]
    whole = {name: taken(each) for name, each in measured.items() if isinstance(each, Mapping)}
    numbers = {
        "study": told | {"infsup": {"rule": RULE._asdict()}},
        "claims": observed | ledger(of["claims"]),
        "whole": whole | {name: of["whole"][name] for name in ("cores", "date")},
    }
    return numbers, verdicts.claims_tables(of["claims"]) | {"figures": figures(figure_entries.shown(study))}


def ledger(claims: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """How many claims have a check, a margin or neither, and where the required numbers come from."""
    origins = Counter(origin(each["source"]) for each in claims if each["source"] is not None)
    known = {"all": origins.total(), "unmeasured": len(claims) - origins.total()}
    known["margins"] = sum(texts.margin(each) != texts.NONE for each in claims)
    return known | {"thresholds": {name: origins[name] for name in ORIGINS}}


def taken(measured: Mapping[str, float]) -> dict[str, Any]:
    """Minutes, GB of memory and of the disk, and packages, from seconds, MB and packages."""
    sizes = {name: measured[name] / 1024 for name in ("memory", "disk") if name in measured}
    packages = {"packages": measured["packages"]} if "packages" in measured else {}
    return {"minutes": measured["seconds"] / 60, **sizes, **packages}


def flat(groups: Mapping[str, Any], above: str = "") -> dict[str, Value]:
    """{"a": {"b": 1, "c": [2]}} as {"a.b": 1}: names lead through the groups, and lists are left out."""
    found: dict[str, Value] = {}
    for name, of in groups.items():
        if isinstance(of, Mapping):
            found |= flat(of, f"{above}{name}.")
        elif isinstance(of, Value):
            found[f"{above}{name}"] = of
    return found


def figures(listed: Iterable[tuple[Sequence[str], str]]) -> pd.DataFrame:
    """The table of the figures and what they show, for a page in a folder beside that of the figures."""
    rows = []
    for names, what in listed:
        links = ", ".join(f"[{name}](../figures/{name}.svg)" for name in names)
        rows.append([links, what, f"`snakemake -j2 figures/{names[0]}.svg`"])
    return pd.DataFrame(rows, columns=["figure", "shows", "command"])


def markdown(table: pd.DataFrame) -> str:
    """A table of texts in Markdown."""
    rows = [list(table.columns), *table.to_numpy().tolist()]
    widths = [max(map(len, [f"{head}  ", *cells])) for head, *cells in zip(*rows, strict=True)]
    if sum(widths) + 3 * len(widths) + 1 > LINE:
        widths = [0] * len(widths)
    lines = ["| " + " | ".join(map(str.ljust, row, widths)) + " |" for row in rows]
    lines.insert(1, "|" + "|".join("-" * max(3, width + 2) for width in widths) + "|")
    return "\n".join(lines)
