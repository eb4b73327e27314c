"""Exponents of H where there are many transitions, as documents name them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from study.experiments.cells.checks import partition_rates, period_exponent


def numbers(results: Mapping[str, Any], study: Mapping[str, Any]) -> dict[str, Any]:
    """The least exponent of D where g is in H^(3/2); that where (jj) and (jjj) fail, and the proved one.

    `alternating` is the least rate where each cell has contact and a gap.
    """
    over_H = period_exponent(results["cells/errors"], "discrete_error")
    rough = results["cells/errors"].sel(case="violates_jj_jjj")
    return {
        "cells": {
            "cantor": float(over_H.sel(case=["cantor_2", "cantor_1.5"]).min()),
            "alternating": float(partition_rates(results["cells/alternating"].sel(gamma=0.5)).min()),
            "violates_jj_jjj": float(over_H.sel(case="violates_jj_jjj")),
            "proved": float(rough["flux_order"] + rough["gap_order"]) / 2,
        }
    }
