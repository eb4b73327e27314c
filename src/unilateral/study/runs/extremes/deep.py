"""How fine h may be: one structured mesh of the square, what it takes, and what was predicted of it."""

from __future__ import annotations

import numpy as np
import xarray as xr
from scipy.optimize import brentq

from unilateral.memory import BYTES_PER_MB, forget_peak, peak_mb
from unilateral.study.runs.extremes.outcome import Budget
from unilateral.study.runs.extremes.problem import Problem, full, on_square
from unilateral.study.runs.extremes.trial import attempt

FILL = 31 / 8
"""Numbers in a factor of n unknowns on a regular grid: FILL n log2 n, by nested dissection (George 1973)."""
WORD = 8
"""Bytes of a float64 and of an index; indices in factors have half of it."""
TRIANGLES, ENTRIES = 2, 7
"""Of a node: triangles, and entries in its row of A."""
MATRIX = 2 * ENTRIES + 1
HELD = 2 + 3 * TRIANGLES + MATRIX + 3
"""Words per node: its coordinates, its triangles' vertices; A; the order, a load and u."""
ASSEMBLED = TRIANGLES * (6 + 1 + 2 * 9) + MATRIX + TRIANGLES * 4 * 9 + MATRIX
"""Words per node while M is assembled, after A_3: slopes, area and blocks of K and of M by triangle; K; rows,
columns, and sorted columns and values of M's entries before they are added; M."""
OF_FACTOR = WORD + 0.25 * WORD + 1.5 * WORD
"""Bytes of a number in a factor: in the factorisation, where those of L share their indices within supernodes
and those of U have one each; and in the copies from which A_3 is read, with an index each."""
OF_BOUNDARY = 2 * WORD
"""A_3 and its Cholesky factor."""


def predicted_bytes(h: float) -> float:
    """At the peak, beyond the process itself; what has H in it is left out."""
    n = (1 / h + 1) ** 2
    factors = OF_FACTOR * 2 * FILL * n * np.log2(n)
    return float(factors + (HELD + ASSEMBLED) * WORD * n + OF_BOUNDARY * (4 / h) ** 2)


def finest(memory: float) -> float:
    """The h whose predicted bytes are that many."""
    return 1 / float(brentq(lambda n: predicted_bytes(1 / n) - memory, 2.0, 1e6))


def deep(h: float, H: float, memory: float, budget: Budget) -> xr.Dataset:
    """Full contact on the square at that h and H; the finest h is for `memory` bytes; see variables.yaml."""
    held: list[Problem] = []
    forget_peak()
    before = peak_mb()

    def problem(_: float) -> Problem:
        held.append(on_square(h, H, full))
        return held[0]

    row = attempt(
        h, problem, budget, lambda of, _: float(of.spaces.condensed.lu.L.nnz + of.spaces.condensed.lu.U.nnz)
    )
    n = held[0].spaces.mesh.n_nodes
    table = {
        "h": held[0].spaces.mesh.h,
        "unknowns": n,
        "outcome": row.tool,
        "factor_numbers": row.measured,
        "factor_numbers_predicted": 2 * FILL * n * np.log2(n),
        "predicted_mb": predicted_bytes(h) / BYTES_PER_MB,
        "taken_mb": peak_mb() - before,
        "finest_h": finest(memory),
    }
    return xr.Dataset({name: ((), value) for name, value in table.items()})
