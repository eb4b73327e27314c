"""Controls: results that are spoilt, on which a claim has to fail."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import xarray as xr

from unilateral.study.judge.claims import Results


def spoilt(results: Results, control: Mapping[str, Any]) -> Results:
    """The results with some tables changed, as a control says.

    `tables` names them. They are replaced `by` another table; or their `variable` is multiplied by a
    `factor`, put to a `value` everywhere or `at` the positions given by dimension, replaced `from` another
    variable, or `to` some labels from other `labels`.
    """
    changed = Results(results.folder, results)
    for name in control["tables"]:
        table = (results[control["by"]] if "by" in control else results[name]).copy(deep=True)
        if "variable" in control:
            _spoil(table, control)
        changed[name] = table
    return changed


def _spoil(table: xr.Dataset, control: Mapping[str, Any]) -> None:
    here = table[control["variable"]]
    place = {d: i for d, i in control.get("at", {}).items() if d in here.dims}
    if "labels" in control:
        here.loc[control["to"]] = here.sel(control["labels"]).values
    elif "from" in control:
        here[:] = table[control["from"]].values
    else:
        here[place] = control["value"] if "value" in control else here[place] * control["factor"]
