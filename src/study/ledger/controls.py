"""Controls: results that are spoilt, on which a claim has to fail."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import xarray as xr

from study.ledger.results import Results

MIN_CONTROL_SHARE = 1e-6
SHARE_TOLERANCE = 0.01
"""The smallest share of a control that is tried, and the relative precision to which a share is found."""


def spoil_results(results: Results, control: Mapping[str, Any], share: float = 1.0) -> Results:
    """The results with some tables changed as a control says, or to (1 - share) true + share spoilt.

    `tables` names them. They are replaced `by` another table; or their `variable` is multiplied by a
    `factor`, put to a `value` everywhere or `at` the positions given by dimension, replaced `from` another
    variable, or `to` some labels from other `labels`.
    """
    changed = Results(results.folder, results, results.listed_digests)
    for name in control["tables"]:
        # Both tables share their arrays; those that are changed are replaced
        table = results[control.get("by", name)].copy()
        if "variable" in control:
            _spoil_table(table, control)
        if share < 1:
            for variable in [control["variable"]] if "variable" in control else [*table]:
                true = results[name][variable].values
                spoilt_values = table[variable].values
                # Numbers that were not changed stay exactly what they are
                mixed = (1 - share) * true + share * spoilt_values
                table[variable].values = np.where(spoilt_values == true, true, mixed)
        changed[name] = table
    return changed


def _spoil_table(table: xr.Dataset, control: Mapping[str, Any]) -> None:
    values = table[control["variable"]]
    values.values = values.values.copy()
    place = {d: i for d, i in control.get("at", {}).items() if d in values.dims}
    if "labels" in control:
        values.loc[control["to"]] = values.sel(control["labels"]).values
    elif "from" in control:
        values[...] = table[control["from"]].values
    else:
        values[place] = control["value"] if "value" in control else values[place] * control["factor"]


def find_smallest_share(fails: Callable[[float], bool]) -> float:
    """The smallest share of a control at which a check fails, to 1 %, by bisection of its logarithm.

    In [1e-6, 1]; the check has to fail at 1, and to go on failing from where it first does.
    """
    if fails(MIN_CONTROL_SHARE):
        return MIN_CONTROL_SHARE
    low = MIN_CONTROL_SHARE
    high = 1.0
    while high > (1 + SHARE_TOLERANCE) * low:
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if fails(middle) else (middle, high)
    return float(f"{high:.3g}")


def describe_share(control: Mapping[str, Any], share: float) -> str:
    """A share of a control in words: a factor where the control is one, else a part of it.

    Where the table holds `rounding`, which differs between processors, only the power of ten above the share
    is told.
    """
    if control.get("rounding") and share < 0.99:
        return f"below {100 * 10.0 ** math.ceil(math.log10(share)):g} % of the control"
    below = "below " if share <= MIN_CONTROL_SHARE else ""
    if "factor" not in control:
        return f"{below}{100 * share:.2g} % of the control" if share < 0.99 else "all of the control"
    change = share * (control["factor"] - 1)
    return f"{below}× {1 + change:.{max(1 - math.floor(math.log10(abs(change))), 1)}f}"
