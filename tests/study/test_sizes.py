"""Where the errors of lambda are measured: sizes are compared exactly."""

import pytest

from unilateral.study.sizes import normed


@pytest.mark.parametrize(
    ("H", "h", "levels", "limits", "expected"),
    [
        (["1/4", "1/8", "1/16", "1/32"], "1/8", 3, {"min": "1/2"}, [0, 1, 2]),
        (["1/4", "1/8", "1/16"], "1/8", 3, {"min": 2, "max": 1}, [1, 2]),
        ([2.2, 2.1, 0.7], 0.7, 1, {"max": 3}, [1]),
        (["1/8"], "1/8", 1, {}, []),
    ],
)
def test_partitions_coarser_than_the_finest_mesh_and_within_the_limit(H, h, levels, limits, expected):
    """2.1 is no more than 3 times 0.7, but it is in floating point."""
    scene = {"H": H, "mesh": {"h": h, "levels": levels}, "H_over_h": limits}
    assert normed(scene) == expected
