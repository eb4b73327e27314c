"""What lies between chords and a circle at which f jumps, in the bound of an integral."""

from itertools import pairwise

import numpy as np
from scipy.integrate import quad
from test_source import Source

from unilateral.bounds import source
from unilateral.geometry import mesh as meshes
from unilateral.geometry.polygon import Polygon

SLOPE = 50
CORNERS = np.array([[0.98, -0.03], [1.02, -0.02], [0.99, 0.05]])


def in_the_disc(y):
    """The integral of 1 + SLOPE x along y in the triangle with CORNERS and the unit disc."""
    ends = []
    for a, b in zip(CORNERS, np.roll(CORNERS, -1, axis=0), strict=True):
        t = (y - a[1]) / (b[1] - a[1])
        if 0 <= t <= 1:
            ends.append(a[0] + t * (b[0] - a[0]))
    low, high = min(ends), min(max(ends), np.sqrt(1 - y**2))
    return (high - low) + SLOPE / 2 * (high**2 - low**2) if high > low else 0.0


def test_slivers_between_chords_and_a_circle_count_in_the_integral():
    """Of f = 1 + 50 x in a disc, 0 outside, on a triangle that the circle cuts, by strips.

    The jump is not constant along the circle, so that the slivers' share is known up to its variation only.
    """
    mesh = meshes.from_arrays(Polygon(CORNERS, "triangle"), CORNERS, [[0, 1, 2]])
    found = source.enclosed(mesh, Source(f"pos(1 - x**2 - y**2, 0)*(1 + {SLOPE}*x)"))
    cuts = np.linspace(-0.03, 0.05, 401)
    exact = sum(quad(in_the_disc, a, b, epsabs=1e-16)[0] for a, b in pairwise(cuts))
    away = abs(exact - found.moments.sum())
    assert 1e-12 < away <= found.rest[0] * np.sqrt(mesh.areas[0])
