"""What is certain of contact, as documents show it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from study.formats import DASH, format_value


def numbers(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, Any]:
    """None: documents name no single number of this experiment."""
    return {}


def blocks(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    """The table of undecided shares and of distances from ends of contact."""
    return {"certain": tabulate_levels(results["certain/contact"])}


def tabulate_levels(table: xr.Dataset) -> pd.DataFrame:
    """The undecided share of the sides with contact, and distances beside each end, a row each."""
    sizes = [f"h = {format_value(float(h), '1/n')}" for h in table["h"].values]
    rows = []
    for case in table["case"].values:
        levels = table.sel(case=case)
        name = f"`{case}`"
        shares = [f"{100 * share:.0f} %" for share in levels["undecided_share"].values]
        rows.append([name, "undecided share", *shares, DASH, DASH])
        known = levels.isel(beside=levels["proved_distance"].notnull().all("mesh").values)
        for place in known["beside"].values:
            distance = known["proved_distance"].sel(beside=place).values
            order = np.log(distance[0] / distance[-1]) / np.log(table["h"].values[0] / table["h"].values[-1])
            expected = float(known["proved_order"].sel(beside=place)[0])
            lengths = [f"{length:.3f}" for length in distance]
            rows.append([name, f"side {place}", *lengths, f"{order:.2f}", f"{expected:.2f}"])
    return pd.DataFrame(rows, columns=["case", "what", *sizes, "order", "expected"])
