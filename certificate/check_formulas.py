#!/usr/bin/env python3
"""Proves the error bound of a certificate whose data are formulas. It needs check.py beside it, and Python 3.9.

    python3 check_formulas.py FILE      as check.py, which has the theorem; docs/certificate.md describes FILE

FORMULAS. + - * /, ** with numbers as exponents, sqrt, exp, log, sin, cos, sinh, cosh, tanh, pi, x, y and decimals,
which are taken exactly. Everything else is refused.

INTERVALS. An interval is a pair of whole numbers in units of 2^-P. Lower ends are rounded down and upper ends up, so
the result of an operation contains all results for numbers in its arguments.

EXPANSIONS. For a smooth f and a set Z in the plane, a dictionary has, for all i + j <= 3, an interval that contains
    f_ij(z) = (d/dxi)^i (d/deta)^j f(z) / (i! j!)  for all z in Z.
A pair (i, j) that is missing means 0. These numbers are the coefficients of f(z + (xi, eta)) up to the order 3.
Expansions of f + g, f g and h(f) are made from those of f and g: polynomials are added, multiplied, and put into
    h(f(z) + d) = h(f(z)) + h'(f(z)) d + h''(f(z))/2 d^2 + h'''(f(z))/6 d^3 + ..
Terms above the order 3 are dropped: they do not enter the coefficients up to the order 3.

TRIANGLES. Let xi and eta be the coordinates in which the corners are (0, 0), (1, 0), (0, 1), and u = xi - 1/3, v =
eta - 1/3. Let T be Taylor's polynomial of degree n - 1 at the centroid, n = 1, 2 or 3. By Taylor's theorem
    f - T = sum of f_ij u^i v^j over i + j = n,  f_ij at some point of the triangle, another one for each (u, v).
So the root mean square of f - T on the triangle is at most the sum of max |f_ij| times that of u^i v^j. The means of
u^2, u^4, u^2 v^2, u^6, u^4 v^2 are 1/18, 1/135, 1/270, 31/20412, 53/102060, by that of xi^a eta^b, 2 a! b!/(a + b + 2)!

EDGES. Let s be 0 at a and 1 at b. The quadratic polynomial I with the values of f at 0, 1/2 and 1 has
    f(s) = I(s) + F s (s - 1/2) (s - 1),  F = f'''/6 at some point of the edge, another one for each s.
|s - 1/2| <= 1/2, so the last term is 2 e s (1 - s) with |e| <= max |F|/4. In Bernstein's basis (1 - s)^2, 2 s (1 - s),
s^2 the coefficients of I are I(0), 2 I(1/2) - (I(0) + I(1))/2, I(1), and e adds to the second one.
"""

import ast
import functools
import math
import operator
import os
import re
import sys
from fractions import Fraction as Q

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from check import OPPOSITE, Polynomial, Refused, divide_up, main, require

P = 100
ONE = 1 << P
LENGTH, NESTING, EXPONENT, BITS = 2000, 300, 100, 20_000  # the largest that are read
ARGUMENT = 1000  # the largest argument of exp, sin and cos


# ---- Intervals ----


def enclose(q):
    """The interval of a fraction or a whole number."""
    return (q.numerator << P) // q.denominator, divide_up(q.numerator << P, q.denominator)


DIGITS = 314159265358979323846264338327950288419716939937510  # of pi, rounded down
PI = enclose(Q(DIGITS, 10**50))[0], enclose(Q(DIGITS + 1, 10**50))[1]
INVERSE_FACTORIALS = [enclose(Q(1, n)) for n in (1, 1, 2, 6)]
PLACES = (-2, -2), (4, -2), (-2, 4), (1, 1), (-2, 1), (1, -2)  # six times (u, v) at corners and midpoints
ROOT_MEAN_SQUARES = {(1, 0): 2358, (2, 0): 861, (1, 1): 609, (3, 0): 390, (2, 1): 228}  # of u^i v^j, times 10^4
PIECES = 8  # of an edge, on each of which |F| is bounded


def negative(t):
    return -t[1], -t[0]


def times(s, t):
    products = [a * b for a in s for b in t]
    return min(products) >> P, divide_up(max(products), ONE)


def whole_root(n, q):
    """The largest whole number whose q-th power is at most n, for n >= 0; n itself if q = 1."""
    if n <= 0:
        return n
    root = 1 << divide_up(n.bit_length(), q)
    while True:  # Newton's method for r^q = n decreases from above until it is there
        better = ((q - 1) * root + n // root ** (q - 1)) // q
        if better >= root:
            return root
        root = better


def power(t, r):
    """t^r for a fraction r."""
    if r < 0:
        low, high = power(t, -r)
        require(low > 0 or high < 0, "a denominator may be 0")
        return ONE * ONE // high, divide_up(ONE * ONE, low)
    low, high = t
    p, q = r.numerator, r.denominator
    require(q == 1 or low > 0, "a root is taken of what may not be positive")
    require(max(-low, high).bit_length() * p <= BITS, "a power is too large")
    # t^p, in units of 2^(-P p), is monotone; or p is even, and it is 0 at 0
    ends = [low**p, high**p] + ([0] if low < 0 < high and p > 0 and p % 2 == 0 else [])
    # (n 2^(-P p))^(1/q) = 2^-P (n 2^(P q - P p))^(1/q)
    lower, upper = (min(ends) << P * q) >> P * p, divide_up(max(ends) << P * q, 1 << P * p)
    return whole_root(lower, q), whole_root(upper - 1, q) + 1


@functools.lru_cache(10_000)
def series(x):
    """The intervals of exp x, cos x and sin x for a number x in units of 2^-P, by sums of x^n/n!."""
    require(abs(x) <= ARGUMENT * ONE, f"an argument of exp, sin or cos may be beyond {ARGUMENT}")
    # Terms are whole numbers in units of 2^(-P - guard), each rounded down. The n-th one has an error e_n <=
    # e_(n-1) |x|/n + 1, e_0 = 0, so e_n <= 1 + |x| + |x|^2/2! + .. <= e^|x|, as n (n - 1) .. (n - m + 1) >= m!. From
    # the N-th on, N > 2 |x|, exact terms at least halve: their sum is at most twice the N-th one, 2 (1 + e_N). So the
    # error of the sum of N terms is at most N e^|x| + 2 + 2 e^|x| <= (N + 4) 4^|x|. That is below 2^guard: N < 2^15,
    # for terms are below 2^4000 units, and halve from n = 2000 on.
    guard = 2 * divide_up(abs(x), ONE) + 16
    sums, term, n = [0, 0, 0, 0], ONE << guard, 0
    while n * ONE <= 2 * abs(x) or abs(term) > 1:
        sums[n % 4] += term
        n += 1
        term = term * x // (n << P)
    below, above = (1, 2) if x else (0, 0)  # the sum for x = 0 is exact
    totals = [total >> guard for total in (sum(sums), sums[0] - sums[2], sums[1] - sums[3])]
    return [(total - below, total + above) for total in totals]


# ---- Functions h: intervals of h, h', h''/2, h'''/6 for all arguments in an interval t ----


def divide_by_factorials(*derivatives):
    return [times(t, factor) for t, factor in zip(derivatives, INVERSE_FACTORIALS)]


def power_terms(t, r):
    """r (r - 1) .. (r - k + 1)/k! t^(r - k); terms after one that is 0 are 0 and left out."""
    terms, factor = [], Q(1)
    for k in range(4):
        if factor:
            terms.append(times(enclose(factor), power(t, r - k)))
        factor *= (r - k) / (k + 1)
    return terms


def exp_terms(t):
    value = max(series(t[0])[0][0], 0), series(t[1])[0][1]
    return divide_by_factorials(value, value, value, value)


def log_terms(t):
    require(t[0] << 90 > ONE and t[1] < ONE << 1000, "log is taken of what may not be between 2^-90 and 2^1000")
    ends = []
    for x in t:
        # log x = y + log z, z = x/e^y, for a y near log x; and 1 - 1/z <= log z <= z - 1
        y = int(math.log(x / ONE) * 2**50) << (P - 50)
        low, high = series(y)[0]
        ends += [y + ONE - divide_up(ONE * high, x), y + divide_up(ONE * x, low) - ONE]
    return [(ends[0], ends[3])] + [times(enclose(Q(-((-1) ** k), k)), power(t, Q(-k))) for k in (1, 2, 3)]


def sin_and_cos(t):
    # they change by at most the radius of t, and are at most 1
    middle = sum(t) >> 1
    radius = t[1] - middle
    cos, sin = [(max(low - radius, -ONE), min(high + radius, ONE)) for low, high in series(middle)[1:]]
    return sin, cos


def sin_terms(t):
    sin, cos = sin_and_cos(t)
    return divide_by_factorials(sin, cos, negative(sin), negative(cos))


def cos_terms(t):
    sin, cos = sin_and_cos(t)
    return divide_by_factorials(cos, negative(sin), negative(cos), sin)


def sinh_and_cosh(t):
    # e^t/2 and e^-t/2; the former grows, the latter falls
    _, _, half, _ = exp_terms(t)
    _, _, inverse, _ = exp_terms(negative(t))
    return (half[0] - inverse[1], half[1] - inverse[0]), (half[0] + inverse[0], half[1] + inverse[1])


def sinh_terms(t):
    sinh, cosh = sinh_and_cosh(t)
    return divide_by_factorials(sinh, cosh, sinh, cosh)


def cosh_terms(t):
    sinh, cosh = sinh_and_cosh(t)
    return divide_by_factorials(cosh, sinh, cosh, sinh)


def tanh_terms(t):
    # tanh x = 1 - 2/(e^2x + 1) grows; tanh' = 1 - tanh^2, tanh''/2 = -tanh tanh', tanh'''/6 = (tanh^2 - 1/3) tanh'
    low, high = max(series(2 * t[0])[0][0], 0), series(2 * t[1])[0][1]
    tanh = ONE - divide_up(2 * ONE * ONE, low + ONE), ONE - 2 * ONE * ONE // (high + ONE)
    square, third = power(tanh, Q(2)), enclose(Q(1, 3))
    slope = ONE - square[1], ONE - square[0]
    return [tanh, slope, times(negative(tanh), slope), times((square[0] - third[1], square[1] - third[0]), slope)]


TERMS = {"exp": exp_terms, "log": log_terms, "sin": sin_terms, "cos": cos_terms}
TERMS = {**TERMS, "sinh": sinh_terms, "cosh": cosh_terms, "tanh": tanh_terms}


# ---- Expansions: dictionaries from (i, j) to intervals ----


def linear(values, low, high):
    """The expansion of the linear function with these values at (0, 0), (1, 0), (0, 1), where it is in [low, high]."""
    slopes = [enclose(value - values[0]) for value in values[1:]]
    return {(0, 0): (enclose(low)[0], enclose(high)[1]), **dict(zip(((1, 0), (0, 1)), slopes))}


def turn(values, first):
    """The values in the same cyclic order, from this one on."""
    return values[first:] + values[:first]


def add(f, g):
    total = dict(f)
    for key, (low, high) in g.items():
        lower, upper = total.get(key, (0, 0))
        total[key] = lower + low, upper + high
    return total


def subtract(f, g):
    return add(f, {key: negative(t) for key, t in g.items()})


def multiply(f, g):
    total = {}
    for (i, j), (a, b) in f.items():
        for (k, m), (c, d) in g.items():
            if i + j + k + m <= 3:
                products = a * c, a * d, b * c, b * d
                low, high = total.get((i + k, j + m), (0, 0))
                total[i + k, j + m] = low + min(products), high + max(products)
    return {key: (low >> P, divide_up(high, ONE)) for key, (low, high) in total.items()}


def compose(terms, f):
    """The expansion of h(f), by the terms of h for all arguments in the interval of f."""
    change = {key: t for key, t in f.items() if key != (0, 0)}
    total = {}
    for term in reversed(terms):  # Horner's scheme
        total = add(multiply(total, change), {(0, 0): term})
    return total


# ---- Formulas: ("number", fraction), ("x",), ("y",), ("pi",), or an operation and its arguments ----

SIGNS = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
EXACT = {"+": operator.add, "-": operator.sub, "*": operator.mul, "**": operator.pow}


def number(q):
    return "number", Q(q)


def combine(sign, a, b):
    """The formula of a + b, a - b, a * b, a / b or a ** b; a number if it is rational."""
    if sign == "/":
        return combine("*", a, combine("**", b, number(-1)))
    if sign == "**" and b == number(0):
        return number(1)
    if sign == "**":
        exponent = b[0] == "number" and max(abs(b[1]), b[1].denominator) <= EXPONENT
        require(exponent, f"exponents are fractions of whole numbers up to {EXPONENT}")
        require(a != number(0) or b[1] >= 0, "0 is a denominator")
    if a[0] != "number" or b[0] != "number" or (sign == "**" and b[1].denominator > 1):
        return sign, a, b
    size = max(a[1].numerator.bit_length(), a[1].denominator.bit_length())
    require(sign != "**" or size * abs(b[1]) <= BITS, "a power is too large")
    return number(EXACT[sign](a[1], b[1]))


def read(node, text, depth=0):
    """The formula of a node of Python's syntax tree; what is not named here is refused."""
    require(depth <= NESTING, "it is nested too deeply")
    if isinstance(node, ast.Constant):
        digits = ast.get_source_segment(text, node)
        decimal = re.fullmatch(r"([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]{1,2})?", digits)
        require(decimal, f"{digits} is no decimal number")
        return number(digits)
    if isinstance(node, ast.Name) and node.id in ("x", "y", "pi"):
        return (node.id,)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return combine("-", number(0), read(node.operand, text, depth + 1))
    if isinstance(node, ast.BinOp) and type(node.op) in SIGNS:
        left, right = read(node.left, text, depth + 1), read(node.right, text, depth + 1)
        return combine(SIGNS[type(node.op)], left, right)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and len(node.args) == 1 and not node.keywords:
        argument = read(node.args[0], text, depth + 1)
        if node.func.id in TERMS:
            return node.func.id, argument
        if node.func.id == "sqrt":
            return combine("**", argument, number(Q(1, 2)))
    raise Refused(f"{ast.get_source_segment(text, node)} cannot be read")


def degree(formula):
    """The degree of a polynomial with rational coefficients, or more; infinity for anything else."""
    kind, *parts = formula
    if kind in ("number", "x", "y"):
        return int(kind != "number")
    if kind in ("+", "-"):
        return max(map(degree, parts))
    if kind == "*":
        return sum(map(degree, parts))
    if kind == "**" and parts[1][1] > 0 and parts[1][1].denominator == 1:
        return degree(parts[0]) * int(parts[1][1])
    return math.inf


def evaluate(formula, x, y):
    """The value of a polynomial at a rational point."""
    kind, *parts = formula
    if kind == "number":
        return parts[0]
    if kind in ("x", "y"):
        return x if kind == "x" else y
    return EXACT[kind](*(evaluate(part, x, y) for part in parts))


def expand(formula, x, y):
    """The expansion of a formula, given those of x and y."""
    kind, *parts = formula
    if kind == "number":
        return {(0, 0): enclose(parts[0])}
    if kind in ("x", "y", "pi"):
        return {"x": x, "y": y, "pi": {(0, 0): PI}}[kind]
    first = expand(parts[0], x, y)
    if kind == "**":
        return compose(power_terms(first[0, 0], parts[1][1]), first)
    if kind in TERMS:
        return compose(TERMS[kind](first[0, 0]), first)
    return {"+": add, "-": subtract, "*": multiply}[kind](first, expand(parts[1], x, y))


class Formula(Polynomial):
    """A function of x and y: the text of a formula, or a list of terms as in check.py."""

    def __init__(self, function):
        text = str(Polynomial(function)) if isinstance(function, list) else function
        require(isinstance(text, str) and re.fullmatch("[ -~]*", text) and "#" not in text, f"{text!a} is no formula")
        require(len(text) <= LENGTH or isinstance(function, list), f"a formula is longer than {LENGTH}")
        self.text = text.strip()
        try:
            self.formula = read(ast.parse(self.text, mode="eval").body, self.text)
        except (MemoryError, RecursionError, Refused, SyntaxError, ValueError) as reason:
            raise Refused(f"{self.text} is no formula that can be read: {reason}") from None
        self.degree = degree(self.formula)
        if self.degree <= 2:
            self.polynomial = self.interpolate()

    def __str__(self):
        return self.text

    def value(self, point):
        return evaluate(self.formula, *point)

    def interpolate(self):
        """The polynomial of degree 2 with its values at six points."""
        points = (0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1)
        origin, east, west, north, south, corner = (self.value((Q(x), Q(y))) for x, y in points)
        terms = [(0, 0, origin), (1, 0, (east - west) / 2), (0, 1, (north - south) / 2)]
        terms += [(2, 0, (east + west) / 2 - origin), (0, 2, (north + south) / 2 - origin)]
        terms += [(1, 1, corner - east - north + origin)]
        return Polynomial([[i, j, str(c)] for i, j, c in terms if c])

    def expand(self, x, y):
        try:
            return expand(self.formula, x, y)
        except Refused as reason:
            raise Refused(f"{self.text}: {reason}") from None

    def on_triangle(self, points, D):
        """Six values, their unit, and how many units f may be off the quadratic function with these values.

        The last is a root mean square. The points/D are the corners of a triangle, then the midpoints opposite to them.
        """
        if self.degree <= 2:
            return self.polynomial.on_triangle(points, D)
        # from the corner opposite to the longest edge on, for derivatives along the other edges are smaller
        edges = [(points[j][0] - points[i][0], points[j][1] - points[i][1]) for i, j in OPPOSITE]
        lengths = [dx * dx + dy * dy for dx, dy in edges]
        first = lengths.index(max(lengths))
        x, y = ([Q(z, D) for z in turn(values, first)] for values in zip(*points[:3]))
        everywhere = self.expand(linear(x, min(x), max(x)), linear(y, min(y), max(y)))
        mean_x, mean_y = sum(x) / 3, sum(y) / 3
        centre = self.expand(linear(x, mean_x, mean_x), linear(y, mean_y, mean_y))
        choices = []
        for n in (1, 2, 3):
            largest = {key: max(-low, high) for key, (low, high) in everywhere.items() if sum(key) == n}
            rest = sum(ROOT_MEAN_SQUARES[max(key), min(key)] * f_ij for key, f_ij in largest.items())
            # T has the lower ends as coefficients: they are off by the widths at most, and |u^i v^j| <= 1
            T = {key: t for key, t in centre.items() if sum(key) < n}
            width = sum(high - low for low, high in T.values())
            choices.append((36 * width + divide_up(36 * rest, 10**4), n, T))
        doubt, _, T = min(choices)
        values = [sum(low * 6 ** (2 - i - j) * u**i * v**j for (i, j), (low, _) in T.items()) for u, v in PLACES]
        return turn(values[:3], -first) + turn(values[3:], -first), 36 * ONE, doubt

    def on_edge(self, a, b):
        """Lower and upper bounds on three coefficients in Bernstein's basis.

        At each point of the edge from a to b, f is a polynomial with coefficients in these bounds. It may be
        another one at each point.
        """
        if self.degree <= 20:
            try:
                return super().on_edge(a, b)
            except Refused:  # its degree along the edge is above 2
                pass
        x, y = zip(a, b)
        places = [[p + Q(k, PIECES) * (q - p) for p, q in zip(a, b)] for k in range(PIECES + 1)]
        largest = 0  # max |F|
        for p, q in zip(places, places[1:]):
            (left, right), (bottom, top) = map(sorted, zip(p, q))
            low, high = self.expand(linear(x, left, right), linear(y, bottom, top)).get((3, 0), (0, 0))
            largest = max(largest, -low, high)
        e = Q(largest, 4 * ONE)
        values = []
        for x, y in (a, places[PIECES // 2], b):
            low, high = self.expand({(0, 0): enclose(x)}, {(0, 0): enclose(y)})[0, 0]
            values.append((Q(low, ONE), Q(high, ONE)))
        first, middle, last = values
        lower = 2 * middle[0] - (first[1] + last[1]) / 2 - e
        upper = 2 * middle[1] - (first[0] + last[0]) / 2 + e
        return [first, (lower, upper), last]


if __name__ == "__main__":
    sys.exit(main(Formula))
