"""Small certificates written by hand for problems whose u is known: nothing of the project takes part."""

import json
import math
import types
from fractions import Fraction
from itertools import pairwise

import numpy as np
from conftest import ROOT

CHECKER = ROOT / "certificate/check.py"
OPPOSITE = ((1, 2), (2, 0), (0, 1))
"""The ends of the edges of a triangle in the order in which the format mentions them."""
X_GAUSS, W_GAUSS = np.polynomial.legendre.leggauss(5)
X_GAUSS = (X_GAUSS + 1) / 2
W_GAUSS = W_GAUSS / 2


def checker(*edits):
    """The checker as a module; each edit is a text of it, which has to occur once, and what replaces it."""
    source = CHECKER.read_text(encoding="utf-8")
    for text, replacement in edits:
        assert source.count(text) == 1, f"{text!r} occurs {source.count(text)} times in check.py, not once"
        source = source.replace(text, replacement)
    module = types.ModuleType("checker")
    exec(compile(source, str(CHECKER), "exec"), module.__dict__)
    return module


def written(certificate):
    """The certificate as a program reads it from its file."""
    return json.loads(json.dumps(certificate))


def polynomial(**coefficients):
    """The format's terms of a polynomial: polynomial(one=1, xy=-2, xx="1/2") is 1 - 2 x y + x^2 / 2."""
    return [
        [0, 0, str(value)] if name == "one" else [name.count("x"), name.count("y"), str(value)]
        for name, value in coefficients.items()
    ]


def value(terms, x, y):
    """A polynomial at a point, exactly if the point is; or at arrays of points."""
    if isinstance(x, np.ndarray):
        return sum((float(Fraction(c)) * x**i * y**j for i, j, c in terms), np.zeros_like(x))
    return sum((Fraction(c) * x**i * y**j for i, j, c in terms), Fraction(0))


def derivative(terms, axis):
    """The derivative of a polynomial in x (axis 0) or y (axis 1)."""
    return [
        [i - (axis == 0), j - (axis == 1), str(Fraction(c) * (i, j)[axis])]
        for i, j, c in terms
        if (i, j)[axis] > 0
    ]


def upward(number):
    """The least double that is not below a fraction."""
    nearest = float(number)
    return nearest if Fraction(nearest) >= number else math.nextafter(nearest, math.inf)


def nodes(certificate):
    """The exact nodes of a certificate: those of the boundary, then those inside."""
    corners = [tuple(map(Fraction, corner)) for corner in certificate["problem"]["polygon"]]
    boundary = [
        tuple(p + (q - p) * Fraction(place) for p, q in zip(start, end, strict=True))
        for places, (start, end) in zip(
            certificate["mesh"]["boundary"], pairwise([*corners, corners[0]]), strict=True
        )
        for place in places
    ]
    return boundary + [(Fraction(x), Fraction(y)) for x, y in certificate["mesh"]["inside"]]


def edge_values(triangles, points, field):
    """Two numbers for each edge: outward normal times length times the best linear field, at both ends.

    Of a quadratic function with the values a, m, b that has the mean (a + 4 m + b) / 6 and the slope b - a.
    """
    values = []
    mentioned = set()
    for triangle in triangles:
        for i, j in OPPOSITE:
            first = triangle[i]
            last = triangle[j]
            if (last, first) not in mentioned:
                mentioned.add((first, last))
                start_x, start_y = points[first]
                end_x, end_y = points[last]
                dx = end_x - start_x
                dy = end_y - start_y

                def normal_flux(x, y, dx=dx, dy=dy):
                    flux_x, flux_y = field(x, y)
                    return flux_x * dy - flux_y * dx

                a = normal_flux(start_x, start_y)
                m = normal_flux((start_x + end_x) / 2, (start_y + end_y) / 2)
                b = normal_flux(end_x, end_y)
                mean = Fraction(a + 4 * m + b) / 6
                values += [float(mean - Fraction(b - a) / 2), float(mean + Fraction(b - a) / 2)]
    return values


def zero(x, y):
    return 0


def zero_field(x, y):
    return 0, 0


def certificate(
    polygon,
    sides,
    f=(),
    k=1,
    c=0,
    *,
    triangles,
    boundary=None,
    inside=(),
    v=zero,
    p=zero_field,
    trace=None,
    field=None,
):
    """A certificate from functions of points: v, the trace, which is v by default, and the fields p and b.

    p may also be the list of its values on edges.
    """
    stated = {
        "format": "unilateral certificate 1",
        "problem": {
            "k": str(k),
            "c": str(c),
            "polygon": [[str(x), str(y)] for x, y in polygon],
            "f": list(f),
            "sides": [{kind: list(data)} for kind, data in sides],
        },
        "mesh": {
            "boundary": boundary or [[0.0] for _ in polygon],
            "inside": [list(map(float, point)) for point in inside],
            "triangles": [list(triangle) for triangle in triangles],
        },
    }
    points = nodes(stated)
    rim = points[: sum(map(len, stated["mesh"]["boundary"]))]
    middles = [tuple((a + b) / 2 for a, b in zip(*ends, strict=True)) for ends in pairwise([*rim, rim[0]])]
    stated["v"] = [float(v(*point)) for point in points]
    stated["flux"] = p if isinstance(p, list) else edge_values(triangles, points, p)
    stated["trace"] = [upward(Fraction((trace or v)(*point))) for point in rim + middles]
    if field is not None:
        stated["field"] = edge_values(triangles, points, field)
    return stated


def fan(polygon, centre, n):
    """A mesh of a convex polygon: triangles from its centre to its sides, each cut into n^2 similar ones."""
    places = [float(Fraction(step, n)) for step in range(n)]
    sides = len(polygon)
    # Nodes (side, ring, step): ring n is the boundary, ring 0 the centre
    number = {(side, n, step): side * n + step for side in range(sides) for step in range(n)}
    inside = []
    for ring in range(n - 1, 0, -1):
        for side, (start, end) in enumerate(pairwise([*polygon, polygon[0]])):
            for step in range(ring):
                number[side, ring, step] = sides * n + len(inside)
                inside.append(
                    tuple(
                        m + Fraction(ring - step, n) * (a - m) + Fraction(step, n) * (b - m)
                        for m, a, b in zip(centre, start, end, strict=True)
                    )
                )
    for side in range(sides):
        number[side, 0, 0] = sides * n + len(inside)
    inside.append(centre)
    for side in range(sides):
        for ring in range(1, n + 1):
            number[side, ring, ring] = number[(side + 1) % sides, ring, 0]
    triangles = []
    for side in range(sides):
        for ring in range(n):
            for step in range(ring + 1):
                outer = number[side, ring + 1, step], number[side, ring + 1, step + 1]
                triangles.append((*outer, number[side, ring, step]))
                if step < ring:
                    middle = number[side, ring + 1, step + 1]
                    triangles.append((middle, number[side, ring, step + 1], number[side, ring, step]))
    return {"boundary": [places] * sides, "inside": inside, "triangles": triangles}


def true_error(certificate, u):
    """|||u - v||| on the certificate's own mesh, by a rule that is exact for polynomials u up to degree 4."""
    problem = certificate["problem"]
    k = float(Fraction(problem["k"]))
    c = float(Fraction(problem["c"]))
    points = np.array([[float(z) for z in point] for point in nodes(certificate)])
    triangles = np.array(certificate["mesh"]["triangles"])
    corners = points[triangles]
    v = np.array(certificate["v"], dtype=float)[triangles]
    along = corners[:, 1] - corners[:, 0]
    across = corners[:, 2] - corners[:, 0]
    twice = along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]
    slope_x = ((v[:, 1] - v[:, 0]) * across[:, 1] - (v[:, 2] - v[:, 0]) * along[:, 1]) / twice
    slope_y = ((v[:, 2] - v[:, 0]) * along[:, 0] - (v[:, 1] - v[:, 0]) * across[:, 0]) / twice
    square = 0.0
    for s, weight_s in zip(X_GAUSS, W_GAUSS, strict=True):
        for t, weight_t in zip(X_GAUSS, W_GAUSS, strict=True):
            # the square (s, t) is mapped to the triangle by (s, t (1 - s))
            second = s
            third = t * (1 - s)
            x, y = (corners[:, 0] + second * along + third * across).T
            v_here = v[:, 0] + second * (v[:, 1] - v[:, 0]) + third * (v[:, 2] - v[:, 0])
            slopes = (value(derivative(u, 0), x, y) - slope_x) ** 2
            slopes += (value(derivative(u, 1), x, y) - slope_y) ** 2
            density = k * slopes + c * (value(u, x, y) - v_here) ** 2
            square += np.sum(weight_s * weight_t * (1 - s) * twice * density)
    return float(np.sqrt(square))
