"""How fine h may be: one structured mesh of the square, what it takes, and what was predicted of it."""

from __future__ import annotations

import numpy as np
import xarray as xr
from scipy.optimize import brentq

from unilateral import mesh as meshes
from unilateral.extremes.outcome import Budget, attempt
from unilateral.extremes.problem import Problem, full, made
from unilateral.memory import peak_mb
from unilateral.partition import uniform
from unilateral.polygon import square

FILL = 31 / 8
"""Numbers in a factor of n unknowns on a regular grid: FILL n log2 n, by nested dissection (George 1973)."""
OF_FACTOR, OF_BOUNDARY = 24, 40
"""Bytes: a number with its index, held twice while A_3 is read off; five dense matrices on the boundary."""


def predicted_bytes(h: float) -> float:
    """Of the factors and the dense matrices on the boundary."""
    n = (1 / h + 1) ** 2
    return OF_FACTOR * 2 * FILL * n * np.log2(n) + OF_BOUNDARY * (4 / h) ** 2


def finest(memory: float) -> float:
    """The h whose predicted bytes are that many."""
    return 1 / float(brentq(lambda n: predicted_bytes(1 / n) - memory, 2.0, 1e6))


def deep(h: float, H: float, memory: float, budget: Budget) -> xr.Dataset:
    """Full contact on the square at that h and H; the finest h is for `memory` bytes; see variables.yaml."""
    held: list[Problem] = []

    def problem(_: float) -> Problem:
        partition = uniform(square(), H)
        held.append(made(meshes.structured(square(), h), partition, *full(partition)))
        return held[0]

    row = attempt(h, problem, budget, lambda of, _: float(of.condensed.lu.L.nnz + of.condensed.lu.U.nnz))
    n = held[0].condensed.mesh.n_nodes
    table = {
        "h": held[0].condensed.mesh.h,
        "unknowns": n,
        "outcome": row.tool,
        "factor_numbers": row.measured,
        "factor_numbers_predicted": 2 * FILL * n * np.log2(n),
        "predicted_mb": predicted_bytes(h) / 1e6,
        "peak_mb": peak_mb(),
        "finest_h": finest(memory),
    }
    return xr.Dataset({name: ((), value) for name, value in table.items()})
