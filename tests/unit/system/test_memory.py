"""What is said of the memory of a run."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from unilateral.system import memory
from unilateral.system.memory import available_mb, forget_peak, peak_mb

MB = 200
CLEARED = Path("/proc/self/clear_refs")
"""A file by which Linux lets a process forget its peak."""


@pytest.mark.parametrize(("limit", "remaining"), [(100 * 2**20, 70), (2**60, 1000), ("max", 1000)])
def test_a_container_s_limit_is_kept(tmp_path, monkeypatch, limit, remaining):
    """100 MB, of which 50 are used, 20 of these by cached files; without a limit its file says max.

    On the machine 1000 MB are free.
    """
    values = {"max": limit, "current": 50 * 2**20, "stat": f"anon 9\ninactive_file {20 * 2**20}\nkernel 1"}
    for name, value in values.items():
        (tmp_path / f"memory.{name}").write_text(f"{value}\n")
    monkeypatch.setattr(memory, "CGROUP", tmp_path)
    monkeypatch.setattr(memory, "_machine_mb", lambda: 1000.0)
    assert available_mb() == remaining


def test_the_peak_sees_what_was_held_and_is_forgotten_where_the_system_can():
    forget_peak()
    before = peak_mb()
    array = np.ones(MB * 2**17)
    with_it = peak_mb()
    assert with_it >= max(before, array.nbytes / 2**20)
    del array
    assert peak_mb() == with_it
    forget_peak()
    assert (peak_mb() < with_it - 0.9 * MB) == CLEARED.exists()


def test_freed_memory_is_kept_where_the_c_library_can_and_else_nothing_happens(monkeypatch):
    """Two numbers of mallopt(3); a library without that function is no error."""
    calls = []
    monkeypatch.setattr(
        memory.ctypes, "CDLL", lambda _: SimpleNamespace(mallopt=lambda *arguments: calls.append(arguments))
    )
    memory.keep_freed_memory()
    assert [option for option, _ in calls] == [memory.MMAP_THRESHOLD, memory.TRIM_THRESHOLD]
    monkeypatch.setattr(memory.ctypes, "CDLL", lambda _: SimpleNamespace())
    memory.keep_freed_memory()
