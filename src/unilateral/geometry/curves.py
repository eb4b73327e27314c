"""Where functions on a polygon are not smooth: curves that cross it, and points of its boundary."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from unilateral.arrays import Array
from unilateral.geometry.plane import cross
from unilateral.geometry.polygon import Polygon


@dataclass(frozen=True)
class SingularPoint:
    """A boundary point at which functions behave like r to the power of multiples of 1 / `grading`."""

    side: int
    t: float
    grading: int


@dataclass(frozen=True)
class Kink:
    """A curve {level = 0} across which u is only finitely smooth.

    |grad level| = 1. It is the circle about `centre` if `radius` > 0, and the line through `centre` along
    `tangent` if `radius` is 0. A step there is 1 where `sign` times the level is positive.
    """

    centre: tuple[float, float]
    radius: float = 0.0
    tangent: tuple[float, float] = (1.0, 0.0)
    sign: int = 1

    def signed_distances(self, points: Array) -> Array:
        """Signed distances of the points (k, 2) from the curve, (k,)."""
        # |x - m| - r of a circle, (x - m) x tangent of a line
        offsets = points - np.array(self.centre)
        if self.radius:
            return np.hypot(offsets[:, 0], offsets[:, 1]) - self.radius
        return cross(offsets, np.array(self.tangent))

    def crossings(self, polygon: Polygon) -> list[SingularPoint]:
        """Where the curve crosses the sides, as points with a kink; a side along it is not crossed."""
        points = []
        for side, (start, edge) in enumerate(zip(polygon.vertices, polygon.edges, strict=True)):
            if self.radius:
                # |a + t e - m|^2 = r^2 for the point at t on the side from a along e
                offset = start - np.array(self.centre)
                roots = np.roots([edge @ edge, 2 * edge @ offset, offset @ offset - self.radius**2])
                t = roots.real[roots.imag == 0]
            else:
                # the signed distance is linear in t, and 0 between values of two signs
                first, last = self.signed_distances(np.stack([start, start + edge]))
                t = np.array([first / (first - last)]) if first * last < 0 else np.array([])
            points += [SingularPoint(side, float(x), 1) for x in t if 0 < x < 1]
        return points


def area_in_disc(vertices: Array, radius: float) -> Array:
    """Areas (k,) of the parts of triangles (k, 3, 2) in the disc about 0: a triangle and sectors per edge."""
    # An edge start + t d meets the circle where a t^2 + 2 b t + c = 0; if nowhere, enter = leave
    start = vertices
    end = np.roll(vertices, -1, axis=1)
    d = end - start
    a = _dot_vectors(d, d)
    b = _dot_vectors(start, d)
    c = _dot_vectors(start, start) - radius**2
    root = np.sqrt(np.maximum(b**2 - a * c, 0.0))
    a = np.where(a > 0, a, 1.0)
    enter = start + np.clip((-b - root) / a, 0.0, 1.0)[..., None] * d
    leave = start + np.clip((-b + root) / a, 0.0, 1.0)[..., None] * d
    # Green: the part from enter to leave adds half their cross product, the rest half of radius^2 dtheta
    sectors = _angle_between(start, enter) + _angle_between(leave, end)
    return np.abs(0.5 * (radius**2 * sectors + cross(enter, leave)).sum(axis=1))


def _dot_vectors(a: Array, b: Array) -> Array:
    """The products a . b of vectors (..., 2)."""
    return np.asarray(np.sum(a * b, axis=-1))


def _angle_between(a: Array, b: Array) -> Array:
    """The angles from the vectors a to the vectors b (..., 2), anticlockwise, in (-pi, pi]."""
    return np.asarray(np.arctan2(cross(a, b), _dot_vectors(a, b)))
