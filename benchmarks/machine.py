"""What this machine can do on one core: the bandwidth of its memory, and its dense arithmetic."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from datetime import UTC, datetime
from os import cpu_count
from pathlib import Path

import numpy as np
from scipy.linalg.blas import daxpy

LONG = 1 << 25
SIDE = 2048
TIMES = 5
WORDS = 3
"""Moved by y + a x for each entry, as by STREAM's triad: two are read, one is written."""


def bandwidth() -> float:
    """Bytes a second of y + a x, far beyond the caches."""
    x = np.ones(LONG)
    y = np.ones(LONG)
    return WORDS * x.nbytes / fastest(lambda: daxpy(x, y, a=1e-3))


def flop_rate() -> float:
    """Operations a second of a product of square matrices."""
    A = np.random.default_rng(0).random((SIDE, SIDE))
    return 2 * SIDE**3 / fastest(lambda: A @ A)


def fastest(act: Callable[[], object]) -> float:
    """Processor seconds of the fastest of some calls."""
    seconds = []
    for _ in range(TIMES):
        start = time.process_time()
        act()
        seconds.append(time.process_time() - start)
    return min(seconds)


def processor() -> str:
    """The name of its class."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else "unknown"


if __name__ == "__main__":
    speeds = {"bandwidth": bandwidth(), "flop_rate": flop_rate(), "cores": cpu_count()}
    today = datetime.now(UTC).date().isoformat()
    print(json.dumps({**speeds, "processor": processor(), "date": today}))
