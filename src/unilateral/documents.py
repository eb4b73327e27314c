"""Documents whose numbers come from the results: text between marks is replaced, all else is kept.

A block stands between the lines `<!-- NAME: begin -->` and `<!-- NAME: end -->`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from unilateral.errors import InputError
from unilateral.rates import NORMS
from unilateral.rates_table import smallest_rate
from unilateral.tables import replacing

TITLES = {"h1": "u in H¹", "hm12": "λ in H^(−1/2)", "l2": "λ in L²"}


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


def _cell(of: xr.Dataset) -> str:
    verdict = of["verdict"].item()
    if verdict == "exact":
        return "error 0, as exact"
    pairs = int(np.count_nonzero(of["asymptotic"].values == 1))
    suffix = "" if verdict == "holds" else f", **{verdict}**"
    return f"{smallest_rate(of):.2f} of {float(of['expected']):g} ({pairs} pairs){suffix}"
