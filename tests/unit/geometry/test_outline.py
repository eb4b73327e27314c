"""Which nodes of a mesh's boundary are its corners, if coordinates are rounded.

The true polygons are known: each mesh is made of one, and then written with few digits. What is right is the
number of sides of that polygon, or that the polygon is asked for.
"""

import numpy as np
import pytest

import unilateral as ul
from unilateral.geometry.outline import GIVE_IT

pytestmark = pytest.mark.filterwarnings("ignore::unilateral.SolutionWarning")

SLIGHTEST, SHARPEST = np.radians(0.1), np.radians(179)


def circumscribed(turns):
    """The vertices (n, 2) of the polygon about the unit circle that turns by `turns` (n,), in all by 2 pi."""
    normals = np.cumsum(turns) - turns[0]
    middle, half = normals + 0.5 * np.roll(turns, -1), 0.5 * np.roll(turns, -1)
    return np.column_stack([np.cos(middle), np.sin(middle)]) / np.cos(half)[:, None]


def random_turns(draw):
    """Turns that are 2 pi in all, of at least 0.1 and at most 179 degrees; about a third are slight ones."""
    n = int(draw.integers(3, 8))
    slight = np.exp(draw.uniform(np.log(SLIGHTEST), np.log(20 * SLIGHTEST), n // 3))
    if draw.random() < 0.2:
        slight = np.append(slight, draw.uniform(0.9, 1) * SHARPEST)
    while True:
        others = draw.dirichlet(np.ones(n)) * (2 * np.pi - slight.sum())
        turns = draw.permutation(np.append(slight, others))
        if turns.min() >= SLIGHTEST and turns.max() <= SHARPEST:
            return turns


def dented(vertices, draw):
    """The same with the middle of one side moved towards the circle's centre."""
    side = int(draw.integers(len(vertices)))
    a, b = vertices[side], vertices[(side + 1) % len(vertices)]
    depth = np.tan(0.5 * np.exp(draw.uniform(np.log(SLIGHTEST), np.log(0.3)))) * 0.5 * np.hypot(*(b - a))
    middle = 0.5 * (a + b)
    return np.insert(vertices, side + 1, middle * (1 - min(depth, 0.5) / np.hypot(*middle)), axis=0)


def fan(vertices, draw):
    """Points and triangles: the sides cut into one to eight edges, joined to the origin, the last point."""
    edges = draw.integers(1, 9, len(vertices))
    sides = np.roll(vertices, -1, axis=0) - vertices
    along = [np.arange(n)[:, None] / n * side for n, side in zip(edges, sides, strict=True)]
    places = np.repeat(vertices, edges, axis=0) + np.concatenate(along)
    k = np.arange(len(places))
    return np.append(places, [[0, 0]], axis=0), np.column_stack([k, np.roll(k, -1), np.full(len(k), len(k))])


def written(points, how, draw):
    """The points with few digits, and how they were rounded."""
    digits = int(draw.integers(4, 18))
    if how == "single precision":
        return points.astype(np.float32).astype(float), how
    if how == "decimals":
        decimals = digits - 1 - int(np.floor(np.log10(np.abs(points).max())))
        return np.round(points, decimals), f"{digits} digits"
    return np.array([[float(f"{x:.{digits - 1}e}") for x in point] for point in points]), f"{digits} digits"


def sample(seed):
    """A true polygon's number of sides, a mesh of it with rounded coordinates, and what was done to it."""
    draw = np.random.default_rng(seed)
    vertices = circumscribed(random_turns(draw))
    vertices = dented(vertices, draw) if draw.random() < 0.3 else vertices
    points, triangles = fan(vertices, draw)
    angle, size = draw.uniform(0, 2 * np.pi), 10.0 ** draw.uniform(-3, 3)
    turned = points @ [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    far = draw.choice([0, 10.0 ** draw.uniform(0, 7)])
    how = draw.choice(["digits", "decimals", "single precision"], p=[0.4, 0.4, 0.2])
    points, how = written(size * turned + far * draw.uniform(-1, 1, 2), str(how), draw)
    return len(vertices), points, triangles, how


def outcome(n_sides, points, triangles):
    """What became of the mesh: "read", "asked for the polygon", "spoilt", or how many sides were found."""
    try:
        found = ul.mesh(points, triangles).polygon.n_sides
    except ul.InputError as error:
        # A rounding as large as edges lets nodes coincide and triangles overlap.
        return "asked" if GIVE_IT in str(error) else f"spoilt {error}"
    return "read" if found == n_sides else f"{found} sides for {n_sides}"
