#!/usr/bin/env python3
"""Proves the error bound of a certificate in exact arithmetic. It needs Python 3.9 or later and nothing else.

    python3 check.py FILE      FILE is a certificate (.json or .json.gz); docs/certificate.md describes it

PROBLEM. In a polygon -k lap u + c u = f, k > 0, c >= 0. On each side one of three conditions holds:
    contact   u >= g, s = k du/dn >= 0, s (u - g) = 0      free   k du/dn = t      clamped   u = u_D
V: the functions in H^1 that vanish on clamped sides; a(w, z) = k (grad w, grad z) + c (w, z); |||w|||^2 = a(w, w).
K: the functions z in H^1 with z >= g on contact sides and z = u_D on clamped sides. The conditions mean: u is in K, and
    a(u, z - u) >= (f, z - u) + <t, z - u>_free  for all z in K.
If K is not empty (v + y will be in it), there is one such u: a is coercive on V, for c > 0 or a side is clamped.
The certificate has a triangulation of the polygon, the function v to be judged (linear on triangles), a flux p
(linear on triangles, one p.n on each edge), and the trace of v + y. y is continuous, quadratic on triangles, linear
along edges inside, and 0 at nodes inside.

THEOREM. Let p.n >= 0 and v + y >= g on contact sides, and v + y = u_D on clamped sides. Let
    S = the norm on V of R(z) = (f, z) + <t, z>_free + <p.n, z>_contact - a(v, z),
    B = <p.n, v + y - g>_contact,    D = |||y|||,    X = |||u - v|||,    L = the norm on V of s - p.n.
Then X^2 <= S^2 + 2 B + D^2 and L <= D + (S^2 + 2 B + D^2)^(1/2). With v + y in place of v, and 0 in place of y, the
second says L <= (S^2 + 2 B)^(1/2) for the S of v + y.
PROOF. s is the functional a(u, z) - (f, z) - <t, z>_free on V, so a(u - v, z) = R(z) + <s - p.n, z>. Let r in V have
a(r, z) = R(z) for all z in V, and let w = u - v - r. Then |||r||| = S, and a(w, z) = <s - p.n, z> for z in V, so
L <= |||w|||. As e = u - v - y is in V,
    X^2 + |||w|||^2 - S^2 = 2 a(u - v, w) = 2 <s - p.n, e> + 2 a(y, w).
<s, e> <= 0 is the variational inequality of u, tested with v + y. As u >= g and p.n >= 0, -<p.n, e> =
<p.n, (v + y - g) - (u - g)> <= B. So X^2 + |||w|||^2 <= S^2 + 2 B + 2 D |||w|||, that is,
    X^2 + (|||w||| - D)^2 <= S^2 + 2 B + D^2.  []

BOUND ON S. With rho = f + div p - c v, R(z) = (p - k grad v, grad z) + (rho, z) + <t - p.n, z>_free. On a triangle T
with longest edge d, ||z - mean z|| <= d/j |z|_1, where j = 3.8317.. (Laugesen and Siudeja 2010). With o =
||rho - mean of rho|| and any number theta from 0 to 1 let A = ||p - k grad v|| + theta d/j o and M =
||mean of rho + (1 - theta) (rho - mean of rho)||. The terms on T are at most A |z|_1 + M ||z||; their sum is at most
(sum A^2/k + sum M^2/c)^(1/2) |||z|||, or ((sum A^2/k)^(1/2) + C (sum M^2)^(1/2)) |||z||| if ||z|| <= C |||z||| on V.
If f is not quadratic on T, a quadratic function takes its place, and M has the norm of the difference added.

BY PARTS. Where v is linear on T, the terms on T are (f - c v, z)_T + sum <b_e, z>_e over the edges e of T, with b_e =
(p - k grad v).n. Let x_e be the corner off e. (x - x_e).n is 2 |T|/|e| on e and 0 on other edges, so the divergence
theorem for (x - x_e) z^2 gives |T|/|e| ||z||_e^2 = ||z||^2 + (z, (x - x_e).grad z).
For any a_e >= (|e|/|T|)^(1/2) ||b_e||_e with the sum a, Cauchy's inequality gives
    (sum <b_e, z>_e)^2 <= a sum a_e |T|/|e| ||z||_e^2 = a^2 (||z||^2 + (z, (x - x_0).grad z)), x_0 = sum a_e x_e / a.
With R = max |x - x_0| at corners that is at most a^2 (||z||^2 + R ||z|| |z|_1) <= a^2 G^2 |||z|||^2 on T, where
G^2 = (1 + (1 + R^2 c/k)^(1/2))/(2 c) is the largest (s^2 + R s t)/(c s^2 + k t^2). So A^2/k + M^2/c on T may be
replaced by (||f - c v||/c^(1/2) + G a)^2. If f is not quadratic, ||f - c v|| has the same norm added as M.
"""

import decimal
import gzip
import itertools
import json
import math
import re
import sys
import zlib
from fractions import Fraction as Q

FORMAT = "unilateral certificate 1"
UNITS = 1 << 200  # numbers that are rounded become multiples of 1/UNITS, rounded in the safe direction
J = Q(38317, 10**4)  # a lower bound for the first zero of the Bessel function J_1
OPPOSITE = ((1, 2), (2, 0), (0, 1))  # the ends of the edge opposite to corner 0, 1, 2 of a triangle


class Refused(Exception):
    """The certificate proves nothing; the message says why."""


def require(condition, reason):
    if not condition:
        raise Refused(reason)


def divide_up(a, b):
    return -(-a // b)


def root(q):
    """A lower and an upper bound on the square root of a fraction q >= 0."""
    lower = math.isqrt(q.numerator * UNITS**2 // q.denominator)
    return Q(lower, UNITS), Q(lower + 1, UNITS)


# ---- Reading: all numbers are taken exactly ----


def fraction(text):
    written = isinstance(text, str) and re.fullmatch(r"-?[0-9]{1,400}(/[0-9]{1,400})?", text)
    require(written, f"{text!a} is no fraction, such as '-3/4'")
    return Q(text)


def integers(values, count, name):
    """A list of doubles as integers over their common denominator."""
    numbers = isinstance(values, list) and all(type(value) in (int, float) for value in values)
    require(numbers and len(values) == count, f"{name}: {count} numbers are needed")
    ratios = [value.as_integer_ratio() for value in values]
    denominator = math.lcm(1, *{bottom for _, bottom in ratios})
    return [top * (denominator // bottom) for top, bottom in ratios], denominator


class Polynomial:
    """The sum of coefficient * x^i * y^j over terms [i, j, "coefficient"]."""

    def __init__(self, terms):
        require(isinstance(terms, list), f"{terms!a} is no polynomial; check_formulas.py reads formulas")
        self.terms = [(i, j, fraction(coefficient)) for i, j, coefficient in terms]
        powers = all(type(i) is type(j) is int and min(i, j) >= 0 and i + j <= 20 for i, j, _ in terms)
        require(powers, f"{terms!a}: powers of x and y are whole numbers, up to 20 together")
        self.degree = max([i + j for i, j, _ in terms], default=0)

    def __str__(self):
        return " + ".join("*".join([str(c)] + ["x"] * i + ["y"] * j) for i, j, c in self.terms) or "0"

    def value(self, point):
        return sum((c * point[0] ** i * point[1] ** j for i, j, c in self.terms), Q(0))

    def on_triangle(self, points, D):
        """Its values at points/D, their unit, and how many units it may be off a quadratic function: 0.

        For other functions that is the root mean square of what they are off on the triangle.
        """
        require(self.degree <= 2, "f has a degree above 2; check_formulas.py reads formulas")
        unit = math.lcm(1, *(c.denominator for _, _, c in self.terms))
        terms = [(i, j, int(c * unit) * D ** (2 - i - j)) for i, j, c in self.terms]
        return [sum(c * x**i * y**j for i, j, c in terms) for x, y in points], unit * D * D, 0

    def on_edge(self, a, b):
        """Lower and upper bounds on its three coefficients in Bernstein's basis on the edge from a to b."""
        values = [self.value([p + s * (q - p) for p, q in zip(a, b)]) for s in range(self.degree + 1)]
        third = [z - 3 * y + 3 * x - w for w, x, y, z in zip(values, values[1:], values[2:], values[3:])]
        require(not any(third), f"{self} has a degree above 2 along a side; check_formulas.py reads formulas")
        first, middle, last = self.value(a), self.value([(p + q) / 2 for p, q in zip(a, b)]), self.value(b)
        return [(z, z) for z in (first, 2 * middle - (first + last) / 2, last)]


class Problem:
    def __init__(self, stated, function):
        self.k, self.c, self.f = fraction(stated["k"]), fraction(stated["c"]), function(stated["f"])
        self.corners = [(fraction(x), fraction(y)) for x, y in stated["polygon"]]
        one_each = len(stated["sides"]) == len(self.corners) > 2 and all(len(side) == 1 for side in stated["sides"])
        require(one_each, "sides: each side of the polygon needs one condition")
        self.sides = [(kind, function(data)) for side in stated["sides"] for kind, data in side.items()]
        kinds = {kind for kind, _ in self.sides}
        unknown = sorted(kinds - {"contact", "free", "clamped"})
        require(not unknown, f"sides: {unknown!a} is not contact, free or clamped")
        positive = self.k > 0 and (self.c > 0 or (self.c == 0 and "clamped" in kinds))
        require(positive, "k, c: both have to be positive; c may be 0 if a side is clamped")
        check_polygon(self.corners)

    def __str__(self):
        words = {"contact": "contact, u >=", "free": "free, k du/dn =", "clamped": "clamped, u ="}
        corners = ", ".join(f"({x}, {y})" for x, y in self.corners)
        sides = "".join(f"\n  side {i}: {words[kind]} {data}" for i, (kind, data) in enumerate(self.sides))
        return f"-k lap u + c u = f, k = {self.k}, c = {self.c}, f = {self.f}\n  polygon {corners}{sides}"


def cross(a, b, c):
    """Twice the area of the triangle a, b, c: positive if it is anticlockwise."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def contains(a, b, p):
    """Whether p lies on the segment from a to b."""
    return all(min(a[z], b[z]) <= p[z] <= max(a[z], b[z]) for z in (0, 1)) and cross(a, b, p) == 0


def check_polygon(corners):
    """Neighbouring sides have one point in common, other sides none; and the polygon is anticlockwise."""
    unit, n = math.lcm(*(z.denominator for corner in corners for z in corner)), len(corners)
    corners = [(int(x * unit), int(y * unit)) for x, y in corners]
    sides = list(zip(corners, corners[1:] + corners[:1]))
    require(all(a != b for a, b in sides), "polygon: a side has no length")
    for (i, (a, b)), (j, (c, d)) in itertools.combinations(enumerate(sides), 2):
        if j == i + 1:
            meet = contains(a, b, d) or contains(c, d, a)
        elif j + 1 == i + n:
            meet = contains(a, b, c) or contains(c, d, b)
        else:
            meet = contains(a, b, c) or contains(a, b, d) or contains(c, d, a) or contains(c, d, b)
            meet = meet or (cross(a, b, c) * cross(a, b, d) < 0 and cross(c, d, a) * cross(c, d, b) < 0)
        require(not meet, f"polygon: sides {i} and {j} meet")
    require(sum(a[0] * b[1] - a[1] * b[0] for a, b in sides) > 0, "polygon: it is clockwise")


class Mesh:
    """Nodes in units of 1/D: those of the boundary, side by side, each on the exact side; then those inside.

    Edges are numbered in the order in which the triangles (a, b, c) mention them: (b, c), (c, a), (a, b).
    """

    def __init__(self, stated, corners):
        sides = [integers(places, len(places), "boundary") for places in stated["boundary"]]  # with denominators
        require(len(sides) == len(corners), "boundary: each side of the polygon needs a list")
        inside, unit = integers([z for x, y in stated["inside"] for z in (x, y)], 2 * len(stated["inside"]), "inside")
        on_sides = math.lcm(*(z.denominator for corner in corners for z in corner)) * math.lcm(*(n for _, n in sides))
        self.D = D = math.lcm(on_sides, unit)
        self.nodes, self.side, self.numbers = [], [], {}
        for i, (places, n) in enumerate(sides):
            grow = places[:1] == [0] and all(s < t for s, t in zip(places, [*places[1:], n]))
            require(grow, f"boundary: places on side {i} start at 0, grow, and stay below 1")
            a, b = corners[i], corners[(i + 1) % len(corners)]
            self.nodes += [tuple(int(D * (p + (q - p) * Q(t, n))) for p, q in zip(a, b)) for t in places]
            self.side += [i] * len(places)
        self.nb = len(self.nodes)
        self.nodes += [(x * (D // unit), y * (D // unit)) for x, y in zip(inside[::2], inside[1::2])]
        # A triangle winds once around its points. If edges inside cancel, the winding numbers of all triangles
        # add up to that of the boundary, which is 1: so each point off the edges lies in exactly one triangle. The two
        # triangles at an edge inside lie on its two sides, so v and y are in H^1, and div p is in L2.
        self.triangles, owner = stated["triangles"], {}
        for number, triangle in enumerate(self.triangles):
            nodes = len(triangle) == 3 and all(type(i) is int and 0 <= i < len(self.nodes) for i in triangle)
            require(nodes, f"triangle {number}: it needs three nodes")
            require(cross(*(self.nodes[i] for i in triangle)) > 0, f"triangle {number}: it is not anticlockwise")
            for i, j in OPPOSITE:
                edge = triangle[i], triangle[j]
                require(edge not in owner, f"triangle {number}: there is another one on the same side of {edge}")
                owner[edge] = number
                if edge[::-1] not in owner:
                    self.numbers[edge] = len(self.numbers)
        self.beside = [owner.pop((i, (i + 1) % self.nb), None) for i in range(self.nb)]
        require(None not in self.beside, "triangles: an edge of the boundary has none")
        require(all(edge[::-1] in owner for edge in owner), "triangles: an edge inside has one on one side only")

    def outflow(self, values, a, b):
        """The outflow to the right of the edge from a to b, at a and at b, by two values for each edge."""
        if (a, b) in self.numbers:
            number = self.numbers[a, b]
            return values[2 * number], values[2 * number + 1]
        number = self.numbers[b, a]
        return -values[2 * number + 1], -values[2 * number]

    def shape(self, triangle, values):
        """The corners of a triangle, 2 D^2 |T|, its edges opposite to them, and the outflows there by `values`."""
        X = [self.nodes[i] for i in triangle]
        return X, cross(*X), vectors(X), [self.outflow(values, triangle[i], triangle[j]) for i, j in OPPOSITE]

    def point(self, i, j):
        """The middle between the nodes i and j."""
        return [Q(p + q, 2 * self.D) for p, q in zip(self.nodes[i], self.nodes[j])]


def vectors(X):
    """The edges of a triangle with the corners X, anticlockwise, each opposite to its corner."""
    return [(X[j][0] - X[i][0], X[j][1] - X[i][1]) for i, j in OPPOSITE]


def gradients(e, corners, middles):
    """2 |T| grad z at the corners, for a quadratic z, by its values at corners and at midpoints opposite to them."""
    hats = [(-dy, dx) for dx, dy in e]  # 2 |T| grad psi_i; z is the sum of z_i psi_i and bubble_i psi_j psi_k
    bubbles = [4 * middle - 2 * (corners[i] + corners[j]) for middle, (i, j) in zip(middles, OPPOSITE)]
    x, y = (sum(z * hat[axis] for z, hat in zip(corners, hats)) for axis in (0, 1))
    bends = [[bubbles[k] * hats[j][axis] + bubbles[j] * hats[k][axis] for axis in (0, 1)] for j, k in OPPOSITE]
    return [(x + dx, y + dy) for dx, dy in bends]


def quadratic_mass(corners, middles):
    """180/|T| ||z||^2 for a quadratic z, by its values at the corners and at the midpoints opposite to them."""
    squares = sum(6 * a * a - 8 * a * m + 32 * m * m for a, m in zip(corners, middles))
    return squares + sum(32 * middles[i] * middles[j] - 2 * corners[i] * corners[j] for i, j in OPPOSITE)


def add_up(a2, b2):
    """An integer that is not below (a + b)^2, for integers a^2 and b^2."""
    return a2 + b2 + math.isqrt(4 * a2 * b2) + 1


def linear_mass(fields):
    """12/|T| ||z||^2 for a linear vector field z, by its values at the corners."""
    return sum(sum(value * value for value in part) + sum(part) ** 2 for part in zip(*fields))


class Certificate:
    def __init__(self, stated, function=Polynomial):
        require(stated["format"] == FORMAT, f"format: {stated['format']!a} is not {FORMAT!r}")
        self.problem = Problem(stated["problem"], function)
        self.mesh = Mesh(stated["mesh"], self.problem.corners)
        edges, self.field = 2 * len(self.mesh.numbers), None
        self.v, self.V = integers(stated["v"], len(self.mesh.nodes), "v")
        self.flux, self.W = integers(stated["flux"], edges, "flux")  # p.n times the length, at both ends of edges
        self.trace, self.Y = integers(stated["trace"], 2 * self.mesh.nb, "trace")  # at nodes, then at midpoints
        require("field" in stated or self.problem.c > 0, "field: it is needed if c is 0")
        if "field" in stated:
            self.field, self.U = integers(stated["field"], edges, "field")

    def residual(self, triangle, corners, middles, N):
        """A^2, M^2 and A^2/k + M^2/c, times UNITS^2, for the quadratic function with these values/N in place of v.

        The bound by parts replaces the third one where it is less. The third one is 0 if c = 0.
        """
        D, W = self.mesh.D, self.W
        (kn, kd), (cn, cd) = self.problem.k.as_integer_ratio(), self.problem.c.as_integer_ratio()
        X, area, e, out = self.mesh.shape(triangle, self.flux)
        # 2 |T| (k grad v - p) in units of 1/(D N W kd); at the corner between the edges j and k,
        # 2 |T| p = outflow_k e_j - outflow_j e_k
        misfit = []
        for (dx, dy), (j, k) in zip(gradients(e, corners, middles), OPPOSITE):
            at_j, at_k = kd * N * out[j][1], kd * N * out[k][0]
            x, y = at_k * e[j][0] - at_j * e[k][0], at_k * e[j][1] - at_j * e[k][1]
            misfit.append((kn * W * dx - x, kn * W * dy - y))
        misfit2 = divide_up(linear_mass(misfit) * UNITS**2, 24 * (kd * N * W) ** 2 * area)
        # 2 |T| rho = 2 |T| (f + div p - c v) at corners and midpoints in units of 1/scale. f may be off
        # by a function whose norm is at most |T|^(1/2) doubt/unit
        points = [(2 * x, 2 * y) for x, y in X] + [(X[i][0] + X[j][0], X[i][1] + X[j][1]) for i, j in OPPOSITE]
        values, unit, doubt = self.problem.f.on_triangle(points, 2 * D)
        scale = unit * D * D * W * cd * N
        per_f, div_p, per_v = W * cd * N * area, scale // W * sum(map(sum, out)), cn * unit * W * area
        rho = [per_f * value + div_p - per_v * v for value, v in zip(values, [*corners, *middles])]
        sum_rho = sum(rho[3:])  # three times the mean of a quadratic function
        off = [3 * value - sum_rho for value in rho]
        o2 = divide_up((D * UNITS) ** 2 * quadratic_mass(off[:3], off[3:]), 3240 * scale**2 * area)
        mean2, doubt2 = (divide_up((z * D * UNITS) ** 2, 18 * scale**2 * area) for z in (sum_rho, 3 * doubt * per_f))
        d2 = Q(max(x * x + y * y for x, y in e), D**2)
        b2 = d2 / J**2
        # A^2/k + M^2/c is about least for theta = (1 - (c/k) b m/o) / (1 + (c/k) b^2) or 0, m = ||p - k grad v||
        ratio = Q(cn * kd, cd * kn)
        share = (1 - root(ratio**2 * b2 * Q(misfit2, o2 or 1))[0]) / (1 + ratio * b2)
        theta = Q(max(round(share * 2**20), 0), 2**20)
        A2 = add_up(misfit2, math.ceil(theta**2 * b2 * o2))
        M2 = add_up(mean2 + math.ceil((1 - theta) ** 2 * o2), doubt2)
        energy2 = divide_up(A2 * kd * cn + M2 * cd * kn, kn * cn) if cn else 0
        is_linear = all(2 * middle == corners[i] + corners[j] for middle, (i, j) in zip(middles, OPPOSITE))
        if is_linear and ratio * d2 > 1:  # otherwise the bound by parts is hardly ever the lesser one
            rest = [z - div_p for z in rho]  # 2 |T| (f - c v)
            rest2 = divide_up((D * UNITS) ** 2 * quadratic_mass(rest[:3], rest[3:]), 360 * scale**2 * area)
            inside2 = divide_up(add_up(rest2, doubt2) * cd, cn)
            energy2 = min(energy2, add_up(inside2, self.edge_terms(X, misfit, kd * N * W)))
        return A2, M2, energy2

    def edge_terms(self, X, misfit, unit):
        """G^2 a^2, times UNITS^2, by 2 |T| (k grad v - p) at the corners X in units of 1/(D unit)."""
        k, c, D = self.problem.k, self.problem.c, self.mesh.D
        # |e| b_e at both ends of e is misfit x e/(2 D^2 |T| unit), up to its sign; the weights are the a_e
        pairs = [(misfit[i], misfit[j]) for i, j in OPPOSITE]
        ends = [[x * dy - y * dx for x, y in pair] for pair, (dx, dy) in zip(pairs, vectors(X))]
        squares = [(p * p + p * q + q * q) * 2 * D**2 for p, q in ends]
        weights = [math.isqrt(z * UNITS**2 // (3 * unit**2 * cross(*X) ** 3)) + 1 for z in squares]
        a = sum(weights)
        arms = [[sum(w * (p - q) for w, q in zip(weights, line)) for p in line] for line in zip(*X)]  # a (x - x_0)
        R2 = Q(max(x * x + y * y for x, y in zip(*arms)), (a * D) ** 2)
        return math.ceil(a * a * (1 + root(1 + R2 * c / k)[1]) / (2 * c))

    def friedrichs_constant(self):
        """C with ||z|| <= C |z|_1 on V, by a field b, linear on triangles, with one b.n on each edge.

        If div b >= 1 and b.n <= 0 off clamped sides, ||z||^2 <= (div b, z^2) <= -2 (z b, grad z), so C = 2 max |b|.
        """
        mesh, largest = self.mesh, Q(0)
        for i, side in enumerate(mesh.side):
            inward = max(mesh.outflow(self.field, i, (i + 1) % mesh.nb)) <= 0
            clamped = self.problem.sides[side][0] == "clamped"
            require(inward or clamped, f"field: b.n > 0 on side {side}, which is not clamped")
        for number, triangle in enumerate(mesh.triangles):
            _, area, e, out = mesh.shape(triangle, self.field)
            # 2 |T| div b is the sum of the outflows at all ends; b at corners is found like p in `residual`
            require(mesh.D**2 * sum(map(sum, out)) >= self.U * area, f"field: div b < 1 on triangle {number}")
            for j, k in OPPOSITE:
                b = [out[k][0] * e[j][z] - out[j][1] * e[k][z] for z in (0, 1)]
                largest = max(largest, Q((b[0] ** 2 + b[1] ** 2) * mesh.D**2, (self.U * area) ** 2))
        return 2 * root(largest)[1]

    def boundary_edges(self):
        """For each boundary edge its nodes, its condition, its function in Bernstein's basis, and its two outflows."""
        mesh = self.mesh
        for i, side in enumerate(mesh.side):
            j, (kind, function) = (i + 1) % mesh.nb, self.problem.sides[side]
            outflows = [Q(z, self.W) for z in mesh.outflow(self.flux, i, j)]
            yield i, j, kind, function.on_edge(mesh.point(i, i), mesh.point(j, j)), outflows

    def boundary_values(self, edges):
        """v + y at boundary nodes, then at midpoints of boundary edges: u_D on clamped sides, the trace elsewhere."""
        w, fixed = [Q(z, self.Y) for z in self.trace], {}
        for i, j, kind, bounds, _ in edges:
            if kind == "clamped":
                require(all(lower == upper for lower, upper in bounds), f"boundary edge {i}: u_D is not quadratic")
                first, bend, last = (lower for lower, _ in bounds)
                same = fixed.setdefault(i, first) == first and fixed.setdefault(j, last) == last
                require(same, f"boundary edge {i}: u_D jumps")
                w[i], w[j], w[self.mesh.nb + i] = first, last, (first + 2 * bend + last) / 4
        return w

    def contact_product(self, edges, w):
        """B = <p.n, v + y - g>_contact; p.n >= 0 and v + y >= g are tested.

        Let a, b, c be the coefficients of z = v + y - g on an edge in Bernstein's basis (1 - s)^2, 2 s (1 - s), s^2.
        z >= 0 if a, c >= 0 and b >= -(a c)^(1/2). The integrals of (1 - s) z and s z over [0, 1] are
        a/4 + b/6 + c/12 and a/12 + b/6 + c/4. They grow with a, b and c.
        """
        B = Q(0)
        for i, j, kind, bounds, (first, last) in edges:
            if kind == "contact":
                require(first >= 0 and last >= 0, f"boundary edge {i}: p.n < 0 on a contact side")
                trace = w[i], 2 * w[self.mesh.nb + i] - (w[i] + w[j]) / 2, w[j]
                a, b, c = (z - upper for z, (_, upper) in zip(trace, bounds))
                above = a >= 0 and c >= 0 and (b >= 0 or b * b <= a * c)
                require(above, f"boundary edge {i}: v + y < g is possible")
                a, b, c = (z - lower for z, (lower, _) in zip(trace, bounds))
                B += first * (a / 4 + b / 6 + c / 12) + last * (a / 12 + b / 6 + c / 4)
        return B

    def free_norm(self, edges, C):
        """An upper bound on the norm on V of <t - p.n, z>_free.

        On a free edge e of T, by the field x - (corner off e), ||z||_e^2 <= |e|/|T| (||z||^2 + d ||z|| |z|_1). T has at
        most three such edges, so the norm is at most (3 sum |e|/|T| ||t - p.n||_e^2 (C^2 + d C/k^(1/2)))^(1/2).
        """
        sum2, d = 0, Q(0)  # sum2 in units of 1/UNITS^2
        for i, j, kind, bounds, (first, last) in edges:
            if kind == "free":
                X = [self.mesh.point(corner, corner) for corner in self.mesh.triangles[self.mesh.beside[i]]]
                x, y = (q - p for p, q in zip(self.mesh.point(i, i), self.mesh.point(j, j)))
                # |e| |t - p.n| is at most the largest of its coefficients in Bernstein's basis
                pairs = zip(bounds, (first, (first + last) / 2, last))
                off = max(abs(t * length - out) for both, out in pairs for t in both for length in root(x * x + y * y))
                sum2 += math.ceil(3 * off**2 / (cross(*X) / 2) * UNITS**2)
                d = max(d, *(root(x * x + y * y)[1] for x, y in vectors(X)))
        return root(Q(sum2, UNITS**2) * (C * C + d * C / root(self.problem.k)[0]))[1]

    def sums(self, w):
        """Sums of A^2, M^2, A^2/k + M^2/c for v, for v + y, and D^2; w is v + y at boundary nodes and midpoints."""
        mesh, nb = self.mesh, self.mesh.nb
        N = 2 * math.lcm(self.V, *{z.denominator for z in w})
        v, w = [z * (N // self.V) for z in self.v], [int(z * N) for z in w]
        y = [w[i] - v[i] for i in range(nb)] + [0] * (len(v) - nb)
        middle = {(i, (i + 1) % nb, mesh.beside[i]): w[nb + i] - (v[i] + v[(i + 1) % nb]) // 2 for i in range(nb)}
        sums_v, sums_w, D2 = [0] * 3, [0] * 3, 0  # in units of 1/UNITS^2: exact sums of fractions take quadratic time
        for number, triangle in enumerate(mesh.triangles):
            ends = [(triangle[i], triangle[j]) for i, j in OPPOSITE]
            corners, middles = [v[i] for i in triangle], [(v[i] + v[j]) // 2 for i, j in ends]
            terms_v = terms_w = self.residual(triangle, corners, middles, N)
            y_corners = [y[i] for i in triangle]
            y_middles = [middle.get((i, j, number), (y[i] + y[j]) // 2) for i, j in ends]
            if any(y_corners) or any(y_middles):
                raised = [a + b for a, b in zip(corners, y_corners)], [a + b for a, b in zip(middles, y_middles)]
                terms_w = self.residual(triangle, *raised, N)
                X = [mesh.nodes[i] for i in triangle]
                slopes = linear_mass(gradients(vectors(X), y_corners, y_middles))
                gradient2 = self.problem.k * slopes / (24 * cross(*X) * N**2)
                mass2 = self.problem.c * quadratic_mass(y_corners, y_middles) * cross(*X) / (360 * mesh.D**2 * N**2)
                D2 += math.ceil((gradient2 + mass2) * UNITS**2)
            sums_v = [sum(pair) for pair in zip(sums_v, terms_v)]
            sums_w = [sum(pair) for pair in zip(sums_w, terms_w)]
        return [Q(z, UNITS**2) for z in sums_v], [Q(z, UNITS**2) for z in sums_w], Q(D2, UNITS**2)

    def bounds(self):
        """Upper bounds on X and L."""
        k, c = self.problem.k, self.problem.c
        constants = [root(1 / c)[1]] if c else []
        constants += [self.friedrichs_constant() / root(k)[0]] if self.field else []
        C = min(constants)  # ||z|| <= C |||z|||
        edges = list(self.boundary_edges())
        w = self.boundary_values(edges)
        B, free = self.contact_product(edges, w), self.free_norm(edges, C)
        *sums, D2 = self.sums(w)
        pairs = [(root(A2 / k)[1] + C * root(M2)[1], root(energy2)[1]) for A2, M2, energy2 in sums]
        S_v, S_w = (free + (min(pair) if c else pair[0]) for pair in pairs)
        X = root(S_v**2 + 2 * B + D2)[1]
        return X, min(root(D2)[1] + X, root(S_w**2 + 2 * B)[1])


def upward(q):
    """A decimal with six digits that is not below q."""
    up = decimal.Context(prec=6, rounding=decimal.ROUND_CEILING)
    return up.divide(decimal.Decimal(q.numerator), decimal.Decimal(q.denominator))


def main(function=Polynomial):
    if sys.version_info < (3, 9):  # noqa: UP036
        sys.exit("Python 3.9 or later is needed")
    try:
        _, path = sys.argv
        with (gzip.open if path.endswith(".gz") else open)(path, "rb") as file:
            stated = json.load(file)
    except (OSError, EOFError, ValueError, RecursionError, zlib.error) as error:
        print(f"usage: python3 {sys.argv[0]} FILE; no certificate can be read: {error!r}", file=sys.stderr)
        return 2
    try:
        certificate = Certificate(stated, function)
        X, L = certificate.bounds()
    except Refused as reason:
        print(f"REFUSED: {reason}")
    except (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
        print(f"REFUSED: this is not the format of docs/certificate.md: {error!a}")
    else:
        print(f"{certificate.problem}\n  v is linear on {len(certificate.mesh.triangles)} triangles")
        print("  |||w|||^2 = k ||grad w||^2 + c ||w||^2")
        print(f"PROVED: |||u - v||| <= {upward(X)}, the dual norm of k du/dn - p.n is <= {upward(L)}")
        return 0
    return 1


if __name__ == "__main__":
    sys.exit(main())
