"""The peak resident memory of this process, what is free for it, and what it keeps."""

from __future__ import annotations

import contextlib
import ctypes
import math
import os
import re
import sys
from pathlib import Path

try:
    import resource
except ModuleNotFoundError:  # as on Windows
    import psutil
else:
    psutil = None

BYTES_PER_MB = 2**20
MAXRSS_UNITS_PER_MB = BYTES_PER_MB if sys.platform == "darwin" else 2**10
"""How many units of ru_maxrss a MB has, see getrusage(2)."""
TRIM_THRESHOLD = -1
MMAP_THRESHOLD = -3
"""The numbers of these parameters for mallopt(3)."""
CGROUP = Path("/sys/fs/cgroup")
"""The folder of this process's cgroup, as a container sees it."""


def forget_peak() -> None:
    """The peak starts anew from what is held now if the system can do that (Linux, see proc(5)), else not."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")


def keep_freed_memory() -> None:
    """Large arrays that are freed from now on stay with this process, if the C library is glibc.

    The next arrays then need no new pages, which may take longer to get than to compute what is put there.
    """
    with contextlib.suppress(OSError, AttributeError, TypeError):  # Windows has no library of that name
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(MMAP_THRESHOLD, 2**25)  # glibc's largest: up to here memory comes from the heap
        mallopt(TRIM_THRESHOLD, 2**31 - 1)  # the largest int: up to 2 GB stay on the heap


def peak_mb() -> float:
    """The peak in MB, since it was last forgotten."""
    if psutil:
        return float(psutil.Process().memory_info().peak_wset) / BYTES_PER_MB
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / MAXRSS_UNITS_PER_MB


def available_mb() -> float:
    """Memory in MB that this process can take without swapping, within its container's limit."""
    return min(_machine_mb(), _container_mb())


def _container_mb() -> float:
    """Memory in MB that cgroup v2 still lets this process take, infinite without a limit.

    Cached files count as free.
    """
    try:
        limit = int((CGROUP / "memory.max").read_text("ascii"))
        used = int((CGROUP / "memory.current").read_text("ascii"))
        cached = re.search(
            r"^inactive_file (\d+)$", (CGROUP / "memory.stat").read_text("ascii"), re.MULTILINE
        )
    except (OSError, ValueError):  # without cgroup v2, or without a limit: then it is the text "max"
        return math.inf
    return (limit - used + (int(cached[1]) if cached else 0)) / BYTES_PER_MB


def _machine_mb() -> float:
    """The free memory as Linux tells it (proc(5)), or Windows; elsewhere all the memory of the machine."""
    if psutil:
        return float(psutil.virtual_memory().available) / BYTES_PER_MB
    with contextlib.suppress(OSError):
        for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) / 2**10
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / BYTES_PER_MB
