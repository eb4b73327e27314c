"""What every driver shares: its order, its phases in seconds, the order of nodes, and how it reports."""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

Seconds = tuple[float, float]
SAME_PLACE = 2.0**-30
"""A power of 2: nodes of structured meshes are whole multiples of it, and rounding decides no tie."""


def order() -> tuple[Mapping[str, Any], Mapping[str, Any], str]:
    """The arrays of the problem, the parameters of the run, and the file for what is found."""
    data, solution_file, parameters = sys.argv[1:]
    return np.load(data), json.loads(parameters), solution_file


class Clock:
    """Seconds (processor, wall) of phases; `start` is all processor time before the first one."""

    def __init__(self) -> None:
        self.start = time.process_time()
        self.phases: dict[str, Seconds] = {}
        self.skip()

    def skip(self) -> None:
        """Leave out of all phases what was done since the last one."""
        self._last = (time.process_time(), time.perf_counter())

    def lap(self, phase: str) -> None:
        """Count what was done since the last phase as this one."""
        now = (time.process_time(), time.perf_counter())
        self.phases[phase] = (now[0] - self._last[0], now[1] - self._last[1])
        self.skip()

    def only(self, phases: Iterable[str]) -> dict[str, Seconds]:
        """The seconds of these phases alone."""
        return {name: self.phases[name] for name in phases}


def report(
    clock: Clock, path: str, points: np.ndarray, results: list[dict[str, Any]], us: list[np.ndarray]
) -> None:
    """Writes each u (n,) with its nodes (n, 2), and prints what was measured; memory in MB of 2^20 bytes."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10
    solutions: dict[str, Any] = {f"u_{k}": u for k, u in enumerate(us)}
    np.savez(path, points=points, **solutions)
    print(json.dumps({"start": clock.start, "peak_mb": peak, "results": results}))


def match_nodes(points: np.ndarray, reference_points: np.ndarray) -> np.ndarray:
    """Numbers (n,) of the points (n, 2) among `reference_points` (n, 2), the same nodes in another order."""
    points_order = np.lexsort(np.round(points / SAME_PLACE).T)
    reference_order = np.lexsort(np.round(reference_points / SAME_PLACE).T)
    numbers = np.empty_like(reference_order)
    numbers[points_order] = reference_order
    if np.abs(points - reference_points[numbers]).max() > SAME_PLACE:
        raise ValueError("these are not the nodes of one mesh")
    return numbers
