"""Intervals and Taylor models against arb, from the smallest numbers to the largest."""

import operator
import random

import numpy as np
import pytest
import sympy
from balls import between, box, certain, exact, holds, polynomial, positive_power, value
from flint import acb, arb
from symbolic import X, Y, evaluate, pos, symbolic

from unilateral.formulas import interval, taylor, taylor_enclosures
from unilateral.formulas.formula import parse_formula
from unilateral.formulas.taylor import TaylorModel, affine_model, monomial_basis, range_model

SPECIAL = [0.0, 5e-324, 1e-320, 2.0**-1022, 1e-160, 0.5, 1.0, 1e154, 1e308, np.finfo(float).max]
EXPONENTS = [1, 2, 3, 10, 31, 100, -1, -2, -3, -7, -100]
FRACTIONS = [
    sympy.Rational(k) for k in ("1", "2", "10", "1/20", "1/3", "3/2", "141/20", "100/7", "199/2", "-1/4")
]
BOXES = 180
POINTS = 3
FORMULAS = 25
OF_EACH = 90
"""Boxes of a random formula, a point in each."""


def numbers(rng, k):
    """(k,) of either sign: of all scales, moderate, near 1, very small, very large, and special ones."""
    low, high = np.array([[-1074, -60, 0, -1074, 1000], [1022.9, 60, 0, -1020, 1022.9]])
    kind = rng.integers(0, 6, k)
    scale = rng.uniform(low[kind % 5], high[kind % 5])
    values = np.where(kind == 5, rng.choice(SPECIAL, k), rng.uniform(1, 2, k) * 2.0**scale)
    return values * rng.choice([-1, 1], k)


def intervals(rng, k):
    """Of all widths: points, narrow ones, and those that contain 0."""
    a = numbers(rng, k)
    b = numbers(rng, k)
    narrow = 2.0 ** rng.uniform(-55, -1, k)
    second = np.select([rng.uniform(size=k) < 0.2, rng.uniform(size=k) < 0.7], [a, a * (1 - narrow)], b)
    return np.minimum(a, second), np.maximum(a, second)


def models(rng, operation, k):
    """Polynomials with coefficients of all scales, alike or not, and remainders that may be 0.

    A third of them are about 1, linear and without a remainder, so that only that of the operation counts.
    """
    size = numbers(rng, k) / 64
    shrink = 2.0 ** rng.choice([-60, -30, -5, -1, 0], k)
    c = size * shrink ** operation.degrees[:, None] * rng.uniform(-1, 1, (len(operation.degrees), k))
    rad = np.where(rng.uniform(size=k) < 0.5, 0.0, np.abs(size) * shrink * rng.uniform(0, 1e-3, k))
    samples = rng.uniform(0.2, 3.0, k)
    plain = rng.uniform(size=k) < 1 / 3
    arms = 0.3 * np.minimum(samples, 1.0) * rng.choice([0.0, 1e-9, 1.0, 1.0], k) * rng.choice([-1, 1], (2, k))
    c[:, plain] = 0.0
    rad[plain] = 0.0
    c[:3, plain] = np.vstack([samples, arms])[:, plain]
    reach = np.abs(c[1:]).sum(axis=0) * (1 + 1e-12) + rad + 1e-310
    return TaylorModel(operation, c, rad, interval.round_outward(c[0] - reach, c[0] + reach))


def tally(answers):
    """How many of them are True, and how many False."""
    expected = [*answers]
    return expected.count(True), expected.count(False)


def try_intervals(operation, oracle, rng, arity, k):
    """Whether values of the `oracle` at points of random boxes lie in the ranges that `of` finds."""
    arguments = [intervals(rng, k) for _ in range(arity)]
    low, high = operation(*arguments)
    assert not np.isnan(low).any()
    assert not np.isnan(high).any()

    def answer(j, t):
        places = (arb(float(a[j])) + (arb(float(b[j])) - float(a[j])) * t for a, b in arguments)
        return between(low[j], oracle(*places), high[j])

    for j in range(k):
        for t in rng.choice([0.0, 1.0, 0.5, 0.37], POINTS).tolist():
            yield certain(answer, j, t)


def try_models(operation, oracle, rng, arity, k, order=3, points=POINTS):
    """The same of Taylor models: the arguments differ from their polynomials by a share of the remainders."""
    space = monomial_basis(2, order)
    arguments = [models(rng, space, k) for _ in range(arity)]
    model = operation(*arguments)
    assert np.isfinite(model.c).all()
    assert (model.rad >= 0).all()
    assert (model.range[0] <= model.range[1]).all()

    def answer(j, sigma, share):
        values = (
            polynomial(a.c[:, j].tolist(), space.exponents.tolist(), sigma) + arb(float(a.rad[j])) * share
            for a in arguments
        )
        return holds(model, j, sigma, oracle(*values))

    for j in range(k):
        for *sigma, share in rng.choice([-1.0, 0.25, 1.0], (points, 3)).tolist():
            yield certain(answer, j, sigma, share)


def fix_exponent(operation, k):
    """A function of a base and an exponent as one of the base."""
    return lambda a: operation(a, k)


OPERATIONS = {  # the functions of balls, of intervals and of models
    "sum": (operator.add, interval.add_intervals, TaylorModel.__add__),
    "product": (operator.mul, interval.multiply_intervals, TaylorModel.__mul__),
}
for name, model_function in taylor_enclosures.MODEL_FUNCTIONS.items():
    OPERATIONS[name] = getattr(arb, name), getattr(interval, name), model_function
for n in EXPONENTS:
    OPERATIONS[f"power {n}"] = (
        fix_exponent(pow, n),
        fix_exponent(interval.integer_power, n),
        fix_exponent(taylor_enclosures.power_model, n),
    )
for k in FRACTIONS:
    OPERATIONS[f"positive power {k}"] = (
        fix_exponent(lambda a, k: positive_power(a, exact(k)), k),
        fix_exponent(interval.positive_part_power, float(k)),
        fix_exponent(taylor_enclosures.positive_power_model, float(k)),
    )
for k in FRACTIONS:
    if k.q > 1:
        OPERATIONS[f"root {k}"] = (
            fix_exponent(lambda a, k: a ** exact(k), k),
            None,
            fix_exponent(taylor_enclosures.root_model, float(k)),
        )
for n in (1e-320, -1 / 3, 1e300):
    OPERATIONS[f"times {n}"] = fix_exponent(operator.mul, n), None, fix_exponent(TaylorModel.scale, n)


def count_enclosed_values(name, k=BOXES, seed=1):
    """How many values of that operation are in its enclosures, and how many are not."""
    operation, kind = name.split(" of ")
    oracle, *functions = OPERATIONS[operation]
    trying, item = (try_intervals, functions[0]) if kind == "intervals" else (try_models, functions[1])
    arity = 2 if operation in ("sum", "product") else 1
    return tally(trying(item, oracle, np.random.default_rng(seed), arity, k))


ENCLOSED = [f"{name} of intervals" for name, functions in OPERATIONS.items() if functions[1]]
ENCLOSED += [f"{name} of models" for name in OPERATIONS]


@pytest.mark.parametrize("name", ENCLOSED)
def test_every_operation_encloses_its_values(name):
    inside, outside = count_enclosed_values(name)
    assert outside == 0
    # a root has values on the boxes on which its argument is positive, half of them
    assert inside > (0.25 if name.startswith("root") else 0.5) * BOXES * POINTS


def random_formula(rng, depth):
    """In x and y, with numbers of all scales; None where sympy finds that it is not defined."""
    kind = rng.random()
    if depth == 0:
        scale = sympy.Rational(10) ** rng.choice([0, 0, 0, rng.randint(-300, 300)])
        number = rng.choice(
            [sympy.Rational(rng.randint(-99, 99), rng.randint(1, 99)), sympy.pi, sympy.sqrt(2)]
        )
        return rng.choice([X, Y, X - Y, scale * number, number * X + scale])
    a = random_formula(rng, depth - 1)
    b = random_formula(rng, rng.randrange(depth))
    if kind < 0.5:
        return a + b if kind < 0.2 else a * b
    if kind < 0.6:
        return a ** rng.choice(EXPONENTS)
    if kind < 0.75:
        return pos(a, rng.choice([sympy.Integer(0), *FRACTIONS]))
    return getattr(sympy, rng.choice(list(taylor_enclosures.MODEL_FUNCTIONS)))(a)


def formulas(seed, n):
    """So many of them that depend on x or y and are defined somewhere, the same ones for each seed."""
    rng = random.Random(seed)
    while n:
        formula = random_formula(rng, rng.choice([1, 2, 2, 3]))
        if formula.free_symbols and not formula.has(sympy.zoo, sympy.nan, sympy.I, sympy.Abs):
            n -= 1
            yield formula


def count_enclosed_formulas(seed):
    rng = np.random.default_rng(seed)
    for formula in formulas(seed, FORMULAS):
        yield from try_models(
            lambda x, y, e=formula: evaluate(e, {X: x, Y: y}),
            lambda x, y, e=formula: value(e, {X: x, Y: y}),
            rng,
            arity=2,
            k=OF_EACH,
            points=1,
            order=int(rng.choice([2, 4])),
        )


@pytest.mark.parametrize("seed", range(12))
def test_random_formulas_enclose_their_values(seed):
    """27 000 pairs of a formula and a box in all, besides those of single operations."""
    inside, outside = tally(count_enclosed_formulas(seed))
    assert outside == 0
    assert inside > 0.5 * FORMULAS * OF_EACH


def last_times(factor, computed):
    """The same sequence with its last member spoilt."""

    def sequence(*arguments):
        values = computed(*arguments)
        values[-1] *= factor
        return values

    return sequence


WIDENED = ("sum", "product", "exp", "sin", "cos", "sinh", "cosh", "tanh", "power 2", "power -1")
UNDERFLOWING = ("product", "exp", "power -3", "positive power 141/20")
FACTORIALS = last_times(2.5, taylor_enclosures._factorials)
BINOMIALS = last_times(0.4, taylor_enclosures._binomial_coefficients)
CONTROLS = {  # what is spoilt, and operations that need it
    "widening": (interval, "ROUNDING_ULPS", 0, [f"{name} of intervals" for name in WIDENED]),
    "factors of powers": (interval, "POWER_ERROR_PER_FACTOR", 0.0, ["positive power 199/2 of intervals"]),
    "fractional exponents": (interval, "EXPONENT_ERROR", 0.0, ["positive power 100/7 of intervals"]),
    "underflow": (taylor, "UNDERFLOW_ALLOWANCE", 0.0, [f"{name} of models" for name in UNDERFLOWING]),
    "rounding of sums": (taylor, "EPS", 0.0, ["sum of models"]),
    "rounding of products": (taylor, "EPS", 0.0, ["product of models"]),
    "rounding of numbers": (taylor, "EPS", 0.0, ["times -0.3333333333333333 of models"]),
    "coefficients of powers": (taylor_enclosures, "EPS", 0.0, ["positive power 100/7 of models"]),
    "last factorial": (taylor_enclosures, "_factorials", FACTORIALS, ["exp of models", "sin of models"]),
    "last binomial": (
        taylor_enclosures,
        "_binomial_coefficients",
        BINOMIALS,
        ["positive power 3/2 of models"],
    ),
    "Cauchy's estimate": (taylor_enclosures, "MAX_TANH_ON_CIRCLE", 0.01, ["tanh of models"]),
}


@pytest.mark.parametrize("name", CONTROLS)
def test_without_a_term_values_lie_outside(monkeypatch, name):
    """Each term of a bound is needed: factorials 2.5 times too large, binomials 2.5 times too small."""
    module, attribute, smaller, operations = CONTROLS[name]
    monkeypatch.setattr(module, attribute, smaller)
    for operation in operations:
        assert count_enclosed_values(operation, 4 * BOXES)[1] > 0, operation


@pytest.mark.parametrize(
    ("name", "module", "constant"),
    [
        ("exp", taylor, "FUNCTION_COEFFICIENT_ERROR"),
        ("tanh", taylor_enclosures, "TANH_COEFFICIENT_ERROR"),
    ],
)
def test_functions_of_numpy_may_be_off_by_four_units(monkeypatch, name, module, constant):
    """As the guarantee assumes; here they are better. Control: without the term for it values lie outside."""
    original = getattr(np, name)
    monkeypatch.setattr(np, name, lambda x: original(x) + 4 * np.spacing(np.abs(original(x))))
    assert (
        count_enclosed_values(f"{name} of intervals", seed=3)[1]
        == count_enclosed_values(f"{name} of models", seed=3)[1]
        == 0
    )
    monkeypatch.setattr(module, constant, 0.0)
    assert count_enclosed_values(f"{name} of models", seed=3)[1] > 0


@pytest.mark.parametrize("name", ["exp", "sin", "cos", "sinh", "cosh", "tanh", "log", "sqrt"])
def test_functions_of_numpy_are_off_by_less_than_four_units(name):
    """Of arguments of all sizes, subnormal and huge ones; what overflows is beyond the largest number."""
    x = numbers(np.random.default_rng(4), 2000)
    function = getattr(arb, name)
    x = np.abs(x[x != 0]) if name in ("log", "sqrt") else x
    with np.errstate(over="ignore"):
        values = getattr(np, name)(x)
    finite = np.isfinite(values)
    assert finite.sum() > 1000
    for a, f, unit in zip(
        x[finite].tolist(),
        values[finite].tolist(),
        np.spacing(np.abs(values[finite])).tolist(),
        strict=True,
    ):
        assert certain(
            lambda a, f, half_width: between(-half_width, function(arb(a)) - f, half_width), a, f, 4 * unit
        ), a
    assert not any(abs(function(arb(a))) < np.finfo(float).max * (1 - 1e-15) for a in x[~finite].tolist())


def test_an_extremum_between_two_neighbouring_numbers_is_not_missed(monkeypatch):
    """sin is 1 between the numbers next to pi/2 + 2 pi k; control: rounded multiples of pi do not tell."""
    k = np.unique(np.geomspace(1, 1e12, 400).round())
    crests = [arb.pi() * (2 * int(period) + arb(0.5)) for period in k]
    near = np.array([float(crest.mid()) for crest in crests])
    lower = np.where(
        [bool(arb(a) < c) for a, c in zip(near.tolist(), crests, strict=True)], near, np.nextafter(near, 0)
    )
    ends = lower, np.nextafter(lower, np.inf)
    assert all(between(a, c, b) for a, c, b in zip(ends[0].tolist(), crests, ends[1].tolist(), strict=True))
    assert (interval.sin(ends)[1] == 1.0).all()
    monkeypatch.setattr(interval, "EXTREMUM_TOLERANCE", 0.0)
    assert (interval.sin(ends)[1] < 1.0).any()


def test_tanh_near_the_real_axis():
    """|tanh| <= AROUND_TANH where |Im z| <= 1; the largest is at z = i, tan 1."""
    for x in np.linspace(-3, 3, 61).tolist():
        for y in np.linspace(-1, 1, 21).tolist():
            assert abs(acb(x, y).tanh()) <= taylor_enclosures.MAX_TANH_ON_CIRCLE
    assert abs(acb(0, 1).tanh()) > taylor_enclosures.MAX_TANH_ON_CIRCLE * (1 - 1e-3)


LEAVING = {
    "a factor underflows": (
        "1 + 1e300*(1e59*(x-37/100)**2 + 1e59*(y-41/100)**2 + 1e48)**(-6)",
        (0.37, 0.41),
        1e-7,
    ),
    "coefficients underflow": (
        "((exp(pos(x,1)) + tanh(y) - (x/3 - 6*y + 167/792)**31))**(-3)",
        (0.1, 65.0),
        1e-3,
    ),
    "it overflows": ("pos(x - y + 100000000000, 100/7)**2", (1.0, 1.0), 0.1),
    "a root's series": ("pos(1e-111*x, 3/2)", (1.0, 1.0), 1e-3),
}


@pytest.mark.parametrize("name", LEAVING)
def test_formulas_of_which_parts_leave_the_range_are_enclosed(name):
    """Also the value between what is 0 and what is infinite is in the range, and near the polynomial."""
    text, centre, half = LEAVING[name]
    formula = parse_formula(text, ("x", "y"), "here")
    model = taylor_enclosures.enclose_formula(formula, box(4, centre, half * np.eye(2)))

    def answer(sigma):
        x = exact(centre[0]) + exact(half) * sigma[0]
        y = exact(centre[1]) + exact(half) * sigma[1]
        return holds(model, 0, sigma, value(symbolic(formula), {X: x, Y: y}))

    sigmas = np.random.default_rng(5).uniform(-1, 1, (10, 2)).tolist()
    assert all(certain(answer, sigma) for sigma in [[0.0, 0.0], [1.0, 1.0], *sigmas])


NUMBERS = [
    "cos(exp((842/488)**12))",
    "sin(exp(600))",
    "cos(sinh(700))",
    "exp(-700)",
    "tanh(20) - 1",
    "sqrt(2)*1e-300",
    "1/3",
    "1e300/3",
    "pi*1e-301",
    "sin(1e99)",
    "cosh(700)",
    "log(3)**99",
    "exp(1/3)**-99",
]


@pytest.mark.parametrize("text", NUMBERS)
def test_numbers_of_formulas_are_enclosed(text):
    """Against arb, where functions are taken of numbers of hundreds of digits, too."""
    e = symbolic(parse_formula(text, (), "here"))
    values = evaluate(e, {X: range_model(monomial_basis(2, 2), (np.zeros(1), np.ones(1)))})
    assert certain(lambda: holds(values, 0, [0.0, 0.0], value(e, {})))
    assert values.rad[0] <= 32 * np.spacing(np.abs(values.c[0, 0])) + 2 * taylor.UNDERFLOW_ALLOWANCE
    wrong = TaylorModel(
        values.basis, values.c * (1 + 1e-14) + 4 * taylor.UNDERFLOW_ALLOWANCE, values.rad, values.range
    )
    assert certain(lambda: holds(wrong, 0, [0.0, 0.0], value(e, {}))) is False


def test_numbers_beyond_the_largest_and_the_smallest_are_enclosed():
    """They are enclosed, too: 10^400 and its inverse, as numbers and as factors."""
    x = affine_model(monomial_basis(2, 2), np.ones(1), np.zeros((2, 1)), (np.ones(1), np.ones(1)))
    for e in (sympy.Integer(10) ** 400, sympy.Rational(1, 10**400), -(sympy.Integer(10) ** 400)):
        for formula in (e + X, e * X, e * sympy.sin(X)):
            values = evaluate(formula, {X: x})
            assert certain(
                lambda model, e: holds(model, 0, [0.0, 0.0], value(e, {X: arb(1)})), values, formula
            )
