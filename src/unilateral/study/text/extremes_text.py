"""The extremes in words: a Markdown table of limits, and sentences whose numbers are the results'."""

from __future__ import annotations

import math
import textwrap
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from unilateral.study.judge.extremes import RESCUED, kinds
from unilateral.study.text.documents import LINE

ALWAYS, NEVER, NO_TOOL = "–", "none", "no tool"
SPARE = 3
"""A factor: digits of what is rounding are not reproducible."""
LAWS = ("odd", "shift", "short", "short_loaded", "scale_down", "scale_up", "angle", "slit", "side", "aspect")
"""The axes whose numbers are cond(S)."""
OWN = {"h": "h = {}", "H": "H = {}", "accuracy": "tolerance {}"}
"""What an axis may have of its own."""


def limits_table(table: xr.Dataset) -> str:
    """Markdown: per axis its range, the limits of plain Uzawa and of the tool, and the outcomes.

    Axes without limits on which all is right are left out; `sentences` has them.
    """
    dull = _dull(table)
    lines = [
        "| axis | from mild to extreme | limit of plain Uzawa: predicted, met at "
        "| limit of the tool: predicted, met at | points |",
        "|---|---|---|---|---|",
    ]
    kinds_of = kinds(table)
    for name in [each for each in table["axis"].values if each not in dull]:
        of, points = table.sel(axis=name), table["axis_of"].values == name
        values, tooled = table["value"].values[points], np.all(table["tool"].values[points] != "")
        cells = [
            str(of["label"].item()),
            f"{_number(values[0])} … {_number(values[-1])}",
            f"{_limit(of['predicted_limit'])}, {_limit(of['measured_limit'])}",
            f"{_limit(of['predicted_tool_limit'])}, {_limit(of['measured_tool_limit'])}"
            if tooled
            else NO_TOOL,
            ", ".join(f"{count} {kind}" for kind, count in Counter(kinds_of[points].tolist()).items()),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines).replace(RESCUED, "by the tool only")


def _dull(table: xr.Dataset) -> list[str]:
    """The axes for which no limit is predicted, and on which plain Uzawa is right everywhere."""
    limits = ("predicted_limit", "predicted_tool_limit", "measured_limit")
    none = np.all([np.isnan(table[name].values) for name in limits], axis=0)
    return [str(name) for name in table["axis"].values[none]]


def setting(study: Mapping[str, Any]) -> str:
    """h, H, the tolerance and the steps of the study, and which axes have others."""
    others: dict[str, list[str]] = {}
    for axis in study["axes"].values():
        own = ", ".join(text.format(_given(axis[key])) for key, text in OWN.items() if key in axis)
        if own:
            others.setdefault(own, []).append(f"*{axis['label']}*")
    steps = f"{study['max_steps']:_}".replace("_", " ")
    listed = "; ".join(f"{own} for {' and '.join(labels)}" for own, labels in others.items())
    text = (
        f"Unless an axis says otherwise h = {study['h']} and H = {study['H']} of the longest side, the "
        f"tolerance is {_given(study['accuracy'])} $\\|\\lambda_H\\|_{{-1/2,h}}$, and a run has "
        f"{steps} steps. Where H varies h varies with it. Otherwise are: {listed}."
    )
    return textwrap.fill(text, LINE, break_long_words=False)


def memory(bytes_: float, finest_h: float, run_h: str) -> str:
    """The finest h for so many bytes, and which one is run on request."""
    text = (
        f"For {bytes_ / 1e9:g} GB the count allows h = 1/{math.floor(1 / finest_h)}; h = {run_h} is run on "
        "request, and its table then holds the count and what the process took."
    )
    return textwrap.fill(text, LINE)


def sentences(table: xr.Dataset) -> str:
    """How many points there are, what became of them, what rounding explains, how far rho may go."""
    count = Counter(kinds(table).tolist())
    text = (
        f"Of {table.sizes['point']} points on {table.sizes['axis']} axes {count['right']} are right by plain "
        f"Uzawa and {count[RESCUED]} more by what the tool takes in its place, Nesterov's acceleration or an "
        f"active set; {count['not converged']} end without convergence and with a valid bound, "
        f"{count['refused']} are refused with a message, and {count['wrong']} are wrong."
    )
    parts = (text, _right_everywhere(table), _rounding(table), _conditions(table), _partial_contact(table))
    return textwrap.fill(" ".join(parts), LINE)


def _right_everywhere(table: xr.Dataset) -> str:
    listed = []
    for name in _dull(table):
        values = table["value"].values[table["axis_of"].values == name]
        label = table["label"].sel(axis=name).item()
        listed.append(f"*{label}* ({_number(values[0])} … {_number(values[-1])})")
    return (
        f"On {len(listed)} axes all is right by plain Uzawa, and no limit was predicted: {'; '.join(listed)}."
    )


def _rounding(table: xr.Dataset) -> str:
    """What is allowed for it, as a power of ten, with SPARE to spare."""
    allowance, u_norm = (table[name].values for name in ("allowance", "u_norm"))
    solved = u_norm > 0
    share = 10.0 ** math.ceil(math.log10(SPARE * np.max(allowance[solved] / u_norm[solved])))
    return (
        "Where rounding puts an error above its guaranteed bound, the allowance covers it, which is below "
        f"{_given(share)} $\\|u\\|_1$ everywhere."
    )


def _conditions(table: xr.Dataset) -> str:
    """How far cond(S) is above its law, rounded up to a digit."""
    share = (table["measured"] / table["predicted"]).values[np.isin(table["axis_of"].values, LAWS)]
    most = math.ceil(np.max(share[np.isfinite(share)]))
    return (
        "Where its growth is predicted, by a law from the mildest point on, cond(S) was nowhere more than "
        f"{most} times the prediction."
    )


def _partial_contact(table: xr.Dataset) -> str:
    last, first, local = _last_and_first(table, "step_partial")
    printed, none, half = _last_and_first(table, "printed_partial")
    unit = r"$2/\lambda_\max(S)$"
    return (
        f"In partial contact steps up to {last} of {unit} converged and {first} did not; only near the "
        f"solution, where the held cells alone decide, is {local} the limit. With the printed index steps up "
        f"to {printed} of {unit} converged and {none} did not; near the solution {half} is the limit."
    )


def _last_and_first(table: xr.Dataset, axis: str) -> tuple[str, str, str]:
    """The last value before the first that is not right, that one, and the local limit."""
    of = table.sel(axis=axis)
    values = table["value"].values[table["axis_of"].values == axis]
    first = float(of["measured_limit"])
    last = float(values[values < first].max())
    return _number(last), _number(first), _number(float(of["local_limit"]))


def _limit(value: xr.DataArray) -> str:
    if np.isinf(value):
        return NEVER
    return ALWAYS if np.isnan(value) else _number(float(value))


def _given(value: str | float) -> str:
    """As the study's configuration has it, a text, or a number to one digit."""
    return value if isinstance(value, str) else f"{value:.0e}".replace("e-0", "e-")


def _number(value: float) -> str:
    return f"{value:.3g}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")
