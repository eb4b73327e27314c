"""The bounds of a certificate from their definitions; shares no code with the checker.

Functions are polynomials in x and y, {(i, j): coefficient of x^i y^j}, with fractions; roots have 60 digits.
"""

import math
from decimal import Context, Decimal, localcontext
from fractions import Fraction

J = Decimal("3.8317")
"""The first zero of the Bessel function J_1, rounded down."""
ONE = {(0, 0): Fraction(1)}
EDGES = ((1, 2), (2, 0), (0, 1))


def decimal(fraction):
    return Decimal(fraction.numerator) / Decimal(fraction.denominator)


def total(*polynomials):
    result = {}
    for polynomial in polynomials:
        for powers, coefficient in polynomial.items():
            result[powers] = result.get(powers, 0) + coefficient
    return result


def times(factor, polynomial):
    return {powers: factor * coefficient for powers, coefficient in polynomial.items()}


def product(first, second):
    terms = [
        {(a + i, b + j): c * d} for (a, b), c in first.items() for (i, j), d in second.items() if c and d
    ]
    return total(*terms)


def gradient(z):
    along_x = {(i - 1, j): i * c for (i, j), c in z.items() if i}
    along_y = {(i, j - 1): j * c for (i, j), c in z.items() if j}
    return along_x, along_y


def divergence(p):
    return total(gradient(p[0])[0], gradient(p[1])[1])


def square(p):
    return total(*[product(component, component) for component in p])


def value(z, point):
    return sum((c * point[0] ** i * point[1] ** j for (i, j), c in z.items()), Fraction(0))


def substitute(z, X, Y):
    """z(X, Y) for polynomials X and Y."""
    terms = [{}]
    for (i, j), coefficient in z.items():
        term = times(coefficient, ONE)
        for factor in [X] * i + [Y] * j:
            term = product(term, factor)
        terms.append(term)
    return total(*terms)


def affine(a, b, c):
    """a + (b - a) x + (c - a) y."""
    return {(0, 0): a, (1, 0): b - a, (0, 1): c - a}


def doubled_area(a, b, c):
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def integral(z, corners):
    """Over a triangle: the integral of x^i y^j over the reference triangle is i! j!/(i + j + 2)!."""
    X = affine(*[corner[0] for corner in corners])
    Y = affine(*[corner[1] for corner in corners])
    moments = [
        c * Fraction(math.factorial(i) * math.factorial(j), math.factorial(i + j + 2))
        for (i, j), c in substitute(z, X, Y).items()
    ]
    return doubled_area(*corners) * sum(moments, Fraction(0))


def middle(a, b):
    return tuple((p + q) / 2 for p, q in zip(a, b, strict=True))


def normal(a, b):
    """The normal to the right of the edge from a to b, times its length."""
    return b[1] - a[1], a[0] - b[0]


def length2(a, b):
    return (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2


def hat_functions(corners):
    hats = []
    for i, j in EDGES:
        # linear, 0 at the corners i and j
        a = corners[i]
        b = corners[j]
        n = normal(b, a)
        z = {(0, 0): -n[0] * a[0] - n[1] * a[1], (1, 0): n[0], (0, 1): n[1]}
        hats.append(times(1 / doubled_area(*corners), z))
    return hats


def place_nodes(stated):
    """All nodes, and for each of those on the boundary its side."""
    polygon = [tuple(map(Fraction, corner)) for corner in stated["problem"]["polygon"]]
    nodes = []
    side = []
    for number, places in enumerate(stated["mesh"]["boundary"]):
        a = polygon[number]
        b = polygon[(number + 1) % len(polygon)]
        for place in places:
            nodes.append(tuple(p + Fraction(place) * (q - p) for p, q in zip(a, b, strict=True)))
            side.append(number)
    return nodes + [tuple(map(Fraction, point)) for point in stated["mesh"]["inside"]], side


def number_edges(triangles):
    numbers = {}
    for triangle in triangles:
        for i, j in EDGES:
            edge = triangle[i], triangle[j]
            if edge[::-1] not in numbers:
                numbers[edge] = len(numbers)
    return numbers


def read_polynomial(terms):
    return total(*[{(i, j): Fraction(coefficient)} for i, j, coefficient in terms])


class Recomputed:
    """The bounds X and L of a certificate to 60 digits, and what they are the least of.

    `constants` are the two C, and `S` has both S for v and for v + y; what is not there is infinite.
    `is_by_parts` says for each residual on a triangle whether its bound by parts is the lesser one.
    """

    def __init__(self, stated):
        problem = stated["problem"]
        self.stated = stated
        self.k = Fraction(problem["k"])
        self.c = Fraction(problem["c"])
        self.f = read_polynomial(problem["f"])
        self.sides = [(kind, read_polynomial(g)) for side in problem["sides"] for kind, g in side.items()]
        self.nodes, self.side = place_nodes(stated)
        self.triangles = stated["mesh"]["triangles"]
        self.numbers = number_edges(self.triangles)
        self.boundary = [(i, (i + 1) % len(self.side)) for i in range(len(self.side))]
        self.trace = self.read_trace()
        self.is_by_parts = []
        with localcontext(Context(prec=60)):
            self.X, self.L = self.bounds()

    def read_trace(self):
        """v + y at boundary nodes and at (i, j), the midpoints: from the file, but u_D on clamped sides."""
        values = [Fraction(z) for z in self.stated["trace"]]
        n = len(self.side)
        trace = dict(enumerate(values[:n])) | dict(zip(self.boundary, values[n:], strict=True))
        for i, j in self.boundary:
            kind, data = self.sides[self.side[i]]
            if kind == "clamped":
                a = self.nodes[i]
                b = self.nodes[j]
                trace |= {i: value(data, a), j: value(data, b), (i, j): value(data, middle(a, b))}
        return trace

    def outflow(self, name, a, b, end):
        """What leaves to the right of the edge from a to b, at one of its ends."""
        values = self.stated[name]
        if (a, b) in self.numbers:
            return Fraction(values[2 * self.numbers[a, b] + (end == b)])
        return -Fraction(values[2 * self.numbers[b, a] + (end == a)])

    def vector_field(self, name, triangle, hats):
        """The linear field with the given outflows: at each corner two equations for two components."""
        first = {}
        second = {}
        for m in range(3):
            corner = triangle[(m + 0) % 3]
            after = triangle[(m + 1) % 3]
            before = triangle[(m + 2) % 3]
            a, b = normal(self.nodes[before], self.nodes[corner])
            c, d = normal(self.nodes[corner], self.nodes[after])
            r = self.outflow(name, before, corner, corner)
            s = self.outflow(name, corner, after, corner)
            first = total(first, times((r * d - b * s) / (a * d - b * c), hats[m]))
            second = total(second, times((a * s - r * c) / (a * d - b * c), hats[m]))
        return first, second

    def lift(self, triangle, hats):
        """y by the six quadratic shape functions: psi (2 psi - 1) at corners and 4 psi psi' at midpoints."""
        v = [Fraction(z) for z in self.stated["v"]]
        difference = {i: self.trace.get(i, v[i]) - v[i] for i in triangle}
        y = {}
        for m, (i, j) in enumerate(EDGES):
            a = triangle[i]
            b = triangle[j]
            linear = (difference[a] + difference[b]) / 2
            at_middle = self.trace[a, b] - (v[a] + v[b]) / 2 if (a, b) in self.trace else linear
            corner_shape = total(times(2, product(hats[m], hats[m])), times(-1, hats[m]))
            y = total(y, times(difference[triangle[m]], corner_shape))
            y = total(y, times(4 * at_middle, product(hats[i], hats[j])))
        return y

    def residual(self, z, p, corners):
        """A^2 = (m + theta d/j o)^2, M^2 = ||mean||^2 + (1 - theta)^2 o^2 and the lesser bound on a triangle.

        rho = f + div p - c z, m = ||p - k grad z||, o = ||rho - mean||, and theta is a multiple of 2^-20. The
        lesser bound is A^2/k + M^2/c or that by parts, and 0 for c = 0.
        """
        misfit = [total(p[axis], times(-self.k, gradient(z)[axis])) for axis in (0, 1)]
        rho = total(self.f, divergence(p), times(-self.c, z))
        area = integral(ONE, corners)
        mean = integral(rho, corners) / area
        remaining = total(rho, times(-mean, ONE))
        diameter = decimal(max(length2(corners[i], corners[j]) for i, j in EDGES)).sqrt()
        b = diameter / J
        ratio = decimal(self.c / self.k)
        m = decimal(integral(square(misfit), corners)).sqrt()
        o = decimal(integral(product(remaining, remaining), corners)).sqrt()
        theta = (o - ratio * b * m) / (o * (1 + ratio * b**2)) if o else Decimal(0)
        theta = max((theta * 2**20).to_integral_value(), Decimal(0)) / 2**20
        A2 = (m + theta * b * o) ** 2
        M2 = decimal(mean**2 * area) + ((1 - theta) * o) ** 2
        if self.c == 0:
            return A2, M2, Decimal(0)
        energy2 = A2 / decimal(self.k) + M2 / decimal(self.c)
        by_parts2 = self.bound_by_parts(z, p, corners)
        self.is_by_parts.append(by_parts2 < energy2)
        return A2, M2, min(energy2, by_parts2)

    def bound_by_parts(self, z, p, corners):
        """(||f - c z||/c^(1/2) + G a)^2 on a triangle; infinite if z is not linear, or c d^2 <= k.

        G^2 is the larger root of k c x^2 - k x = R^2/4: the largest (s^2 + R s t)/(c s^2 + k t^2).
        """
        d2 = max(length2(corners[i], corners[j]) for i, j in EDGES)
        if self.c * d2 <= self.k or any(coefficient for (i, j), coefficient in z.items() if i + j > 1):
            return Decimal("inf")
        k = decimal(self.k)
        c = decimal(self.c)
        area = integral(ONE, corners)
        remaining = total(self.f, times(-self.c, z))
        field = [total(p[axis], times(-self.k, gradient(z)[axis])) for axis in (0, 1)]
        weights = []
        for i, j in EDGES:
            # |e| ||b_e||_e^2 is the integral over s in [0, 1] of the square of what field has along |e| n
            a = corners[i]
            b = corners[j]
            X = {(0, 0): a[0], (1, 0): b[0] - a[0]}
            Y = {(0, 0): a[1], (1, 0): b[1] - a[1]}
            through = total(*[times(n, component) for n, component in zip(normal(a, b), field, strict=True)])
            density = square([substitute(through, X, Y)])
            weights.append(decimal(sum(q / (power + 1) for (power, _), q in density.items()) / area).sqrt())
        a = sum(weights)
        points = [tuple(map(decimal, corner)) for corner in corners]
        pairs = list(zip(weights, points, strict=True))
        centre = [sum(weight * point[axis] for weight, point in pairs) / a for axis in (0, 1)]
        R2 = max(length2(point, centre) for point in points)
        G = ((k + (k**2 + k * c * R2).sqrt()) / (2 * k * c)).sqrt()
        return (decimal(integral(product(remaining, remaining), corners) / self.c).sqrt() + G * a) ** 2

    def bounds(self):
        k = decimal(self.k)
        c = decimal(self.c)
        field = "field" in self.stated
        D2 = Fraction(0)
        b2 = Fraction(0)
        sums = [Decimal(0)] * 6
        for triangle in self.triangles:
            corners = [self.nodes[i] for i in triangle]
            hats = hat_functions(corners)
            p = self.vector_field("flux", triangle, hats)
            v = total(
                *[times(Fraction(self.stated["v"][i]), hat) for i, hat in zip(triangle, hats, strict=True)]
            )
            y = self.lift(triangle, hats)
            D2 += self.k * integral(square(gradient(y)), corners) + self.c * integral(product(y, y), corners)
            position = self.residual(v, p, corners) + self.residual(total(v, y), p, corners)
            sums = [old + new for old, new in zip(sums, position, strict=True)]
            if field:
                b = self.vector_field("field", triangle, hats)
                b2 = max(b2, *[value(square(b), corner) for corner in corners])
        never = Decimal("inf")
        self.constants = 2 * (decimal(b2) / k).sqrt() if field else never, 1 / c.sqrt() if c else never
        C = min(self.constants)
        free = self.free_sides(C)
        self.S = [
            ((A2 / k).sqrt() + C * M2.sqrt() + free, energy2.sqrt() + free if c else never)
            for A2, M2, energy2 in (sums[:3], sums[3:])
        ]
        S2 = [min(pair) ** 2 for pair in self.S]
        B = decimal(self.contact_sides())
        X = (S2[0] + 2 * B + decimal(D2)).sqrt()
        return X, min(decimal(D2).sqrt() + X, (S2[1] + 2 * B).sqrt())

    def edges_of(self, kind):
        """Its boundary edges with the function on their side, and p.n times the length at both ends."""
        for i, j in self.boundary:
            if self.sides[self.side[i]][0] == kind:
                yield i, j, self.sides[self.side[i]][1], [self.outflow("flux", i, j, end) for end in (i, j)]

    def contact_sides(self):
        """<p.n, v + y - g>, integrated over s in [0, 1] along each edge."""
        B = Fraction(0)
        s = {(1, 0): Fraction(1)}
        remaining = {(0, 0): Fraction(1), (1, 0): Fraction(-1)}
        for i, j, g, (first, last) in self.edges_of("contact"):
            trace = total(
                times(self.trace[i], product(remaining, total(remaining, times(-1, s)))),
                times(4 * self.trace[i, j], product(s, remaining)),
                times(self.trace[j], product(s, total(s, times(-1, remaining)))),
            )
            X = total(times(self.nodes[i][0], remaining), times(self.nodes[j][0], s))
            Y = total(times(self.nodes[i][1], remaining), times(self.nodes[j][1], s))
            gap = total(trace, times(-1, substitute(g, X, Y)))
            density = product(total(times(first, remaining), times(last, s)), gap)
            B += sum((c / (power + 1) for (power, _), c in density.items()), Fraction(0))
        return B

    def free_sides(self, C):
        """(3 sum |e|/|T| ||t - p.n||_e^2 (C^2 + d C/k^(1/2)))^(1/2)."""
        flux2 = Decimal(0)
        d2 = Fraction(0)
        for i, j, t, (first, last) in self.edges_of("free"):
            triangle = next(T for T in self.triangles if (i, j) in [(T[m], T[n]) for m, n in EDGES])
            corners = [self.nodes[m] for m in triangle]
            a = self.nodes[i]
            b = self.nodes[j]
            d2 = max(d2, *[length2(corners[m], corners[n]) for m, n in EDGES])
            length = decimal(length2(a, b)).sqrt()
            # |t - p.n| is at most the largest of its coefficients in Bernstein's basis
            ends = value(t, a), value(t, b)
            bernstein = ends[0], 2 * value(t, middle(a, b)) - sum(ends) / 2, ends[1]
            flux = first, (first + last) / 2, last
            displaced = max(
                abs(decimal(z) - decimal(q) / length) for z, q in zip(bernstein, flux, strict=True)
            )
            flux2 += 3 * length / decimal(integral(ONE, corners)) * length * displaced**2
        return (flux2 * (C**2 + decimal(d2).sqrt() * C / decimal(self.k).sqrt())).sqrt()
