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
from unilateral.rates import NORMS, smallest_rate
from unilateral.tables import replacing

TITLES = {"h1": "u in H¹", "hm12": "λ in H^(−1/2)", "l2": "λ in L²"}


def fill(path: str | Path, blocks: Mapping[str, str]) -> None:
    """Put each block's text between its marks in the file.

    Raises InputError where the file lacks a block's marks, or has marks of a block that is not given.
    """
    text = Path(path).read_text(encoding="utf-8")
    found = re.findall(r"^<!-- ([\w-]+): begin -->$", text, re.MULTILINE)
    if sorted(found) != sorted(blocks):
        raise InputError(f"{path}: it has the marked blocks {sorted(found)}, and needs {sorted(blocks)}")
    for name, content in blocks.items():
        pattern = rf"(<!-- {name}: begin -->\n).*?(<!-- {name}: end -->)"
        text, count = re.subn(pattern, lambda m, c=content: f"{m[1]}{c}\n{m[2]}", text, flags=re.DOTALL)  # type: ignore[misc]
        if count != 1:
            raise InputError(f"{path}: the block '{name}' needs one begin and one end mark")
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def rates_table(scenes: Mapping[str, xr.Dataset], ratio: float) -> str:
    """A Markdown table: per scene and case, the smallest asymptotic rate in each norm against the proved one."""
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
