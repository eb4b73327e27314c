"""Random polygons of a size of about 1; coordinates are whole multiples of 2^-20."""

import numpy as np

LEAST = 0.02
"""The smallest distance of 0 from the lines of sides, and the smallest angle in which a side is seen."""


def round_vertices(vertices):
    return np.round(vertices * 2**20) / 2**20


def distances(vertices):
    """(n,) those of 0 from the lines of the sides, positive on their inner side."""
    edges = np.roll(vertices, -1, axis=0) - vertices
    return (vertices[:, 0] * edges[:, 1] - vertices[:, 1] * edges[:, 0]) / np.hypot(*edges.T)


def star(rng):
    """Star-shaped about 0, with 3 to 12 sides, sharp and re-entrant corners, and sometimes a short side."""
    while True:
        n = int(rng.integers(3, 12))
        gaps = rng.dirichlet(np.full(n, 2.0)) * 2 * np.pi
        radii = np.exp(rng.uniform(np.log(0.15), 0, n)) if rng.random() < 0.7 else np.ones(n)
        vertices = round_vertices(_polar(radii, np.cumsum(gaps)))
        if rng.random() < 0.3:
            vertices = cut_off(vertices, int(rng.integers(n)), 10.0 ** rng.uniform(-3, -1))
        if gaps.min() > LEAST and gaps.max() < 0.9 * np.pi and distances(vertices).min() > LEAST:
            return vertices


def _polar(radius, angles):
    return np.column_stack([radius * np.cos(angles), radius * np.sin(angles)])


def cut_off(vertices, i, share):
    """With a short side in place of the vertex i."""
    ends = vertices[[i - 1, (i + 1) % len(vertices)]]
    short = round_vertices(vertices[i] + share * (ends - vertices[i]))
    return np.concatenate([vertices[:i], short, vertices[i + 1 :]])


def wedge(rng):
    """Star-shaped about 0; the angle at vertex 0 is a whole number of twentieths of pi, but not pi."""
    while True:
        omega = np.pi * rng.choice(np.setdiff1d(np.arange(3, 38), [20])) / 20
        angles = omega * np.concatenate([[0], np.sort(rng.random(rng.integers(1, 5))), [1]])
        vertices = np.concatenate([[[0, 0]], _polar(rng.uniform(0.4, 1), angles)])
        vertices -= _polar(0.3, np.array([omega / 2]))
        if np.diff(angles).min() > LEAST and distances(vertices).min() > LEAST:
            return vertices


def columns(rng):
    """Up to four columns of unit squares side by side, as they are, turned or slanted."""
    heights = rng.integers(1, 4, rng.integers(1, 5)).tolist()
    corners = [(0, 0), (len(heights), 0)]
    for i in range(len(heights) - 1, -1, -1):
        corners += [(i + 1, heights[i]), (i, heights[i])]
    vertices = np.array([p for i, p in enumerate(corners) if p != corners[i - 1]], dtype=float)
    turned = np.array([[3, 4], [-4, 3]]) / 8
    slanted = np.array([[1, 0], [rng.integers(1, 9) / 8, 1]])
    return vertices @ [np.eye(2), np.eye(2), turned, slanted][rng.integers(4)]


def draw_over_base(rng):
    """Convex; side 0 is the base from 0 to 1, with angles of at most 90 degrees."""
    points = np.column_stack([rng.uniform(0, 1, 8), rng.uniform(0.02, 1.5) * rng.uniform(0.1, 1, 8)])
    points[:2, 0] = np.where(rng.random(2) < 0.5, [0, 1], points[:2, 0])
    points = round_vertices(points[: rng.integers(1, 9)])
    hull = [np.array([0.0, 0.0]), np.array([1.0, 0.0])]
    for p in points[np.argsort(-points[:, 0])]:
        while len(hull) > 2 and _turn(hull[-2], hull[-1], p) <= 1e-3:
            hull.pop()
        if _turn(hull[-2], hull[-1], p) > 1e-3 and _turn(hull[-1], p, hull[0]) > 1e-3:
            hull.append(p)
    return np.array(hull) if len(hull) > 2 else draw_over_base(rng)


def _turn(a, b, c):
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
