"""Certificates that prove something of nothing in particular: random data, meshes, v, p and y."""

from fractions import Fraction
from random import Random

from recomputed import doubled_area, normal, number_edges, place_nodes

POWERS = (-3, 0, 0, 1, 2, 4, 8)
TINY = -30
"""c is drawn between 1/7 and 50/7, then multiplied by a power of ten: also by a tiny one if there is b."""
POLYGONS = (
    "0 0, 1 0, 1 1, 0 1",
    "0 0, 1 0, 1/3 1",
    "0 0, 3 0, 3 2, 1 2, 1 1, 0 1",
    "0 0, 2/3 1/7, 1 1/2, 4/5 3/2, -1/3 9/10",
    "0 0, 2 -1, 1 0, 2 1",
    "0 0, 1/2 0, 1 0, 1 1, 0 1",
)
TRIANGLE = 1  # the polygon for which a field b is known: its first side may be without a condition on u


def cut_ears(random, nodes, ring):
    """Triangles without nodes inside, with up to three edges at the boundary; None at a dead end."""
    ring = list(ring)
    triangles = []
    while len(ring) > 2:
        ears = []
        for n in range(len(ring)):
            triangle = [ring[n - 1], ring[n], ring[(n + 1) % len(ring)]]
            a, b, c = [nodes[i] for i in triangle]
            other_nodes = [nodes[i] for i in ring if i not in triangle]
            crossed = any(
                min(doubled_area(a, b, z), doubled_area(b, c, z), doubled_area(c, a, z)) >= 0
                for z in other_nodes
            )
            if doubled_area(a, b, c) > 0 and not crossed:
                ears.append((n, triangle))
        if not ears:
            return None
        n, triangle = random.choice(ears)
        triangles.append(triangle)
        del ring[n]
    return triangles


def random_mesh(random, polygon):
    """Random places on the sides, ears, then triangles split in three at points that are doubles."""
    while True:
        boundary = [[0, *sorted(random.random() for _ in range(random.randrange(4)))] for _ in polygon]
        mesh = {"boundary": boundary, "inside": []}
        nodes, side = place_nodes({"problem": {"polygon": polygon}, "mesh": mesh})
        triangles = cut_ears(random, nodes, range(len(nodes)))
        if triangles:
            break
    for _ in range(random.randrange(6)):
        a, b, c = triangles.pop(random.randrange(len(triangles)))
        weights = [1 + random.randrange(4) for _ in range(3)]
        point = [
            float(sum(w * nodes[i][axis] for w, i in zip(weights, (a, b, c), strict=True)) / sum(weights))
            for axis in (0, 1)
        ]
        mesh["inside"].append(point)
        nodes.append(tuple(map(Fraction, point)))
        triangles += [[a, b, len(nodes) - 1], [len(nodes) - 1, b, c], [c, a, len(nodes) - 1]]
    random.shuffle(triangles)
    return mesh | {"triangles": triangles}, nodes, side


def random_polynomial(random, below=0):
    powers = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)]
    coefficients = [Fraction(random.randint(-20, 20), random.choice([1, 3, 7])) for _ in powers]
    coefficients[0] -= below
    return [[i, j, str(c)] for (i, j), c in zip(powers, coefficients, strict=True)]


def random_certificate(seed):
    random = Random(seed)
    shape = random.randrange(len(POLYGONS))
    polygon = [corner.split() for corner in POLYGONS[shape].split(", ")]
    mesh, nodes, side = random_mesh(random, polygon)
    numbers = number_edges(mesh["triangles"])
    with_field = shape == TRIANGLE and random.random() < 0.7
    kinds = [random.choice(["contact", "free", "clamped"]) for _ in polygon]
    if with_field:
        kinds[1:] = "clamped", "clamped"
    u_D = random_polynomial(random)
    draw_data = {
        "contact": lambda: random_polynomial(random, below=500),  # less than every trace below
        "free": lambda: random_polynomial(random),
        "clamped": lambda: u_D,
    }
    problem = {
        "polygon": polygon,
        "k": str(Fraction(random.randint(1, 50), random.randint(1, 50))),
        "c": "0" if with_field and random.random() < 0.5 else str(Fraction(random.randint(1, 50), 7)),
        "f": random_polynomial(random),
        "sides": [{kind: draw_data[kind]()} for kind in kinds],
    }
    powers = (*POWERS, TINY) if with_field else POWERS
    problem["c"] = str(Fraction(problem["c"]) * Fraction(10) ** random.choice(powers))
    # p of the size of (c k)^(1/2) v: so neither p - k grad v nor f - c v is all that counts for a large c
    size = max(1.0, float(Fraction(problem["c"]) * Fraction(problem["k"])) ** 0.5)
    flux = [random.gauss(0, size) for _ in range(2 * len(numbers))]
    for i in range(len(side)):
        j = (i + 1) % len(side)
        if kinds[side[i]] == "contact":
            edge, sign = ((i, j), 1) if (i, j) in numbers else ((j, i), -1)
            first = 2 * numbers[edge]
            flux[first : first + 2] = [sign * abs(z) for z in flux[first : first + 2]]
    certificate = {
        "format": "unilateral certificate 1",
        "problem": problem,
        "mesh": mesh,
        "v": [random.gauss(0, 1) for _ in nodes],
        "flux": flux,
        "trace": [random.uniform(1, 3) for _ in range(2 * len(side))],
    }
    if with_field:
        # x - (1/2, -1/5) enters through the side from (0, 0) to (1, 0), and its divergence is 2
        certificate["field"] = []
        for a, b in numbers:
            n = normal(nodes[a], nodes[b])
            for x, y in (nodes[a], nodes[b]):
                certificate["field"].append(float((x - Fraction(1, 2)) * n[0] + (y + Fraction(1, 5)) * n[1]))
    return certificate
