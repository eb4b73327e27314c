"""The peak resident memory of this process."""

from __future__ import annotations

import contextlib
import resource
import sys
from pathlib import Path

BYTES_PER_MB = 2**20
UNITS_PER_MB = BYTES_PER_MB if sys.platform == "darwin" else 2**10
"""Of ru_maxrss, see getrusage(2)."""


def forget_peak() -> None:
    """Start anew from what is held now, where the system can (Linux, see proc(5)); else do nothing."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def peak_mb() -> float:
    """The peak in MB, since it was last forgotten."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / UNITS_PER_MB
