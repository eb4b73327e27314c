"""What is said of the memory of a run."""

from pathlib import Path

import numpy as np

from unilateral.memory import forget_peak, peak_mb

MB = 200
CLEARED = Path("/proc/self/clear_refs")
"""Where a system lets a process forget its peak."""


def test_the_peak_sees_what_was_held_and_is_forgotten_where_the_system_can():
    forget_peak()
    before = peak_mb()
    held = np.ones(MB * 2**17)
    with_it = peak_mb()
    assert with_it >= max(before, held.nbytes / 2**20)
    del held
    assert peak_mb() == with_it
    forget_peak()
    assert (peak_mb() < with_it - 0.9 * MB) == CLEARED.exists()
