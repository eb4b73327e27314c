"""The grammar of formulas: what it reads, exactly, and that it refuses everything else by an InputError."""

import math

import mpmath
import numpy as np
import pytest
import sentences
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st
from symbolic import X, Y, compile_numpy, symbolic

from unilateral.errors import InputError
from unilateral.formulas import formula, grammar
from unilateral.formulas.derivative import derivative
from unilateral.formulas.exact_numbers import as_float
from unilateral.formulas.formula import find_kinks, parse_formula, parse_number
from unilateral.formulas.interval import positive_power


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1/3", sympy.Rational(1, 3)),
        ("0.1", sympy.Rational(1, 10)),
        (0.1, sympy.Rational(1, 10)),
        ("1_000", sympy.Integer(1000)),
        ("2.5e-3", sympy.Rational(1, 400)),
        ("-2**2", sympy.Integer(-4)),
        ("+3", sympy.Integer(3)),
        ("sqrt(2)**2", sympy.Integer(2)),
        ("2*pi", 2 * sympy.pi),
        ("sqrt(3)/9", sympy.sqrt(3) / 9),
        ("pos(4, 1/2) + pos(-4, 1/2)", sympy.Integer(2)),
        ("pos(2, 0) + pos(0, 0)", sympy.Integer(1)),
        ("sqrt(8) - 2*sqrt(2)", sympy.Integer(0)),
        ("sqrt(2)*sqrt(3) - sqrt(6)", sympy.Integer(0)),
        *(
            (f"{f}({k}*pi/12)", getattr(sympy, f)(k * sympy.pi / 12))
            for f in ("sin", "cos")
            for k in (-3, 2, 8, 30)
        ),
    ],
)
def test_numbers_are_exact(text, value):
    assert symbolic(parse_number(text, "here")) == value


def test_functions_are_sympys():
    text = "sin(x)*cos(y) - exp(x)/cosh(y) + sinh(x)*tanh(y) + log(1 + x**2) + sqrt(2 + y)"
    expected = (
        sympy.sin(X) * sympy.cos(Y)
        - sympy.exp(X) / sympy.cosh(Y)
        + sympy.sinh(X) * sympy.tanh(Y)
        + sympy.log(1 + X**2)
        + sympy.sqrt(2 + Y)
    )
    assert symbolic(parse_formula(text, ("x", "y"), "here")) == expected


NO_CONDITION = (  # not the step of another condition than the one that is written
    "; there are no conditions in formulas; pos(a, 0) is 1 where a > 0 and 0 elsewhere, "
    "such as pos(x - 1/2, 0) for x > 1/2"
)
REFUSED = {
    "x.real": "'x.real' is not allowed",
    "x.__class__": "'x.__class__' is not allowed",
    "x[0]": "'x[0]' is not allowed",
    "[x]": "'[x]' is not allowed",
    "(x, y)": "'(x, y)' is not allowed",
    "lambda: x": "'lambda: x' is not allowed",
    "x if y else 1": f"'x if y else 1' is not allowed in a formula{NO_CONDITION}",
    "x>0.5": f"'x>0.5' is not allowed in a formula{NO_CONDITION}",
    "x<0.5": f"'x<0.5' is not allowed in a formula{NO_CONDITION}",
    "x==1": f"'x==1' is not allowed in a formula{NO_CONDITION}",
    "2*(x < y)": f"'x < y' is not allowed in a formula{NO_CONDITION}",
    "x > 1/2 ? 1 : 0": f"is not a formula in x, y{NO_CONDITION}",
    "if(x, 1, 0)": f"is not a formula in x, y{NO_CONDITION}",
    "0,5*x": "'0,5*x' is not allowed in a formula; write 0.5 for 0,5",
    "x + sin(0,5*x)": "'sin(0,5*x)' takes 1 argument; write 0.5 for 0,5",
    "x, y": "'x, y' is not allowed in a formula",
    "not x": "'not x' is not allowed",
    "~x": "'~x' is not allowed",
    "f'{x}'": "is not allowed",
    "[x for x in y]": "is not allowed",
    "__import__('os')": "is not a known function",
    "eval(x)": "'eval(x)' is not a known function; known are pos, sin",
    "x.sin(y)": "'x.sin(y)' is not a known function",
    "sin(sin)(x)": "'sin(sin)(x)' is not a known function",
    "sin(x=y)": "'sin(x=y)' is not a known function",
    "sin(x, y)": "'sin(x, y)' takes 1 argument",
    "sin(*x)": "'*x' is not allowed",
    "pos(x)": "'pos(x)' takes 2 arguments",
    "pos(x, y)": "'pos(x, y)' needs a rational power between 0 and 100",
    "pos(x, -1)": "'pos(x, -1)' needs a rational power",
    "pos(x, 101)": "'pos(x, 101)' needs a rational power",
    "pos(x, pi)": "'pos(x, pi)' needs a rational power",
    "pos(x, 1/21)": "with a denominator of at most 20",
    "pos((x**7 + 1)**3, 1)": "'pos((x**7 + 1)**3, 1)' needs an argument of degree at most 20",
    "(((x + y)/9)**100)**100": "has the degree 10000 when multiplied out; at most 100",
    "x**60/(x - 1)**41": "has the degree 101 when multiplied out; at most 100 is allowed",
    "pos(x, 99)*sin(x)*cos(y)": "has the degree 101 when multiplied out; at most 100 is allowed",
    "pos(x**4, 26)": "'pos(x**4, 26)' has the degree 104",
    "sin(" * 7 + "x" + ")" * 7: "has more than 6 nested functions",
    "sin(" * 190 + "x" + ")" * 190: "the formula has more than 30 nested parentheses",
    "*".join(["x"] * 502): "the formula has more than 500 operations",
    "-" * 501 + "x": "the formula has more than 500 operations",
    "010 + x": "'010 + x' is not a formula in x, y; write 10 for 010",
    "1,050*x": "write 1050 or 1.050 for 1,050",
    "0o10": "'0o10' is not a decimal number",
    "1:30": "'1:30' is not a formula in x, y",
    "2001-01-01": "'2001-01-01' is not a formula in x, y; write 1 for 01",
    "'x'": "''x'' is not a decimal number",
    "b'x'": "is not a decimal number",
    "True": "'True' is not a decimal number",
    "None": "'None' is not a decimal number",
    "none": "'none' is unknown; known are x, y, pi",
    "...": "'...' is not a decimal number",
    "2j": "'2j' is not a decimal number",
    "0x10": "'0x10' is not a decimal number",
    "z": "'z' is unknown; known are x, y, pi, pos, sin, cos, exp, sinh, cosh, tanh",
    "sin": "'sin' is a function; write its argument after it, as in sin(a)",
    "sin**2*(x)": "'sin' is a function; write its argument after it, as in sin(a)",
    "pos + x": "'pos' is a function; write its argument after it, as in pos(a, k)",
    "x // y": "'x // y' uses an operator other than + - * / **",
    "x % y": "'x % y' uses an operator",
    "x @ y": "'x @ y' uses an operator",
    "x^2": "'x^2' uses an operator other than + - * / **; write x**2 for x^2",
    "1 + 2x": "'1 + 2x' is not a formula in x, y; write 2*x for 2x",
    "0.5 sin(x)": "is not a formula in x, y; write 0.5*sin for 0.5 sin",
    "2(x + 1)": "'2(x + 1)' is not a product; write 2*(x + 1)",
    "x(y + 1)": "'x(y + 1)' is not a product; write x*(y + 1)",
    "abs(x)": "'abs(x)' is not a known function; write pos(a, 1) + pos(-a, 1) for abs(a)",
    "max(x, 0)": "is not a known function; write b + pos(a - b, 1) for max(a, b)",
    "min(x, y)": "is not a known function; write a - pos(a - b, 1) for min(a, b)",
    "ln(x)": "is not a known function; write log(a) for ln(a), where a is a number",
    "tan(x)": "is not a known function; write sin(a)/cos(a) for tan(a)",
    "sign(x)": "is not a known function; write 2*pos(a, 0) - 1 for sign(a)",
    "heaviside(x)": "is not a known function; write pos(a, 0), which is 1 where a > 0 and 0 elsewhere",
    "where(x, 1, 0)": "is not a known function; write b + (a - b)*pos(c, 0) for where(c > 0, a, b)",
    "2.5e-3 +": "'2.5e-3 +' is not a formula in x, y",
    "9**9**9": "'9**9**9' needs a rational exponent between -100 and 100",
    "x**y": "'x**y' needs a rational exponent",
    "x**101": "'x**101' needs a rational exponent",
    "((10**100)**100)**100": "'(10**100)**100' has a number that is too large or too small",
    "(sqrt(2)*10**99)**99 * x": "'(sqrt(2)*10**99)**99' has a number that is too large or too small",
    "pos(10**100, 100)": "'pos(10**100, 100)' has a number that is too large or too small",
    "1e400": "'1e400' has a number that is too large or too small",
    "x + 1e-999999999": "'1e-999999999' has a number that is too large or too small",
    "1 + 1/0": "'1/0' is not a finite real number",
    "x/(x - x)": "'x/(x - x)' is not a finite real number",
    "log(0)": "'log(0)' is not a finite real number",
    "sqrt(-1) + x": "'sqrt(-1)' is not a finite real number",
    "(-2)**(1/3)": "'(-2)**(1/3)' is not a finite real number",
    "log(sin(4))": "'log(sin(4))' is not a finite real number",
    "exp(exp(exp(100)))": "'exp(exp(100))' is not a finite real number",
    "x + 5*pos(1 - sin(1)**2 - cos(1)**2, 0)": "'1 - sin(1)**2 - cos(1)**2' cannot be distinguished from 0",
    "pos(5 + 2*sqrt(6) - (sqrt(2) + sqrt(3))**2, 0)": "distinguished from 0; write it as a single number",
    "exp(1)*exp(-1) - 1 + x": "'exp(1)*exp(-1) - 1' cannot be distinguished from 0",
    "(sin(1)**2 + cos(1)**2 - 1)*10**99*x": "'sin(1)**2 + cos(1)**2 - 1' cannot be distinguished from 0",
    "sqrt(x**2)": "'sqrt(x**2)' has a kink; write pos(a, 1) + pos(-a, 1) for abs(a)",
    "": "is not a formula in x, y",
    "x +": "'x +' is not a formula in x, y",
    "x; y": "'x; y' is not a formula in x, y",
    "x = 1": "'x = 1' is not a formula in x, y",
    "x\x00": "is not a formula in x, y",
    "(" * 500 + "x" + ")" * 500: "the formula has more than 30 nested parentheses",
    "x" + "+x" * 1000: "the formula has more than 2000 characters",
}


@pytest.mark.parametrize(("text", "message"), REFUSED.items(), ids=[text[:30] for text in REFUSED])
def test_refusals_name_the_place_and_the_part(text, message):
    with pytest.raises(InputError) as refusal:
        parse_formula(text, ("x", "y"), "file.yaml, field u[0]")
    assert str(refusal.value).startswith("file.yaml, field u[0]: ")
    assert message in str(refusal.value)


@pytest.mark.parametrize(
    "text",
    [
        "sin(" * 190 + "x" + ")" * 190,
        "*".join(["(x - 1)"] * 148),
        "-" * 501 + "x",
        "+x" * 501,
        "(((x + y)/9)**100)**100 - (((x + y)/9)**100)**99",
    ],
    ids=lambda text: text[:30],
)
def test_limits_are_looked_at_before_the_work(text, monkeypatch):
    """No power of x + y above its 100th, and no product above the 100th degree, is worked out."""
    degrees = []

    def recording(operation):
        return lambda a, b: degrees.append(sympy.total_degree(symbolic(operation(a, b)))) or operation(a, b)

    operators = {kind: recording(operation) for kind, operation in grammar.OPERATORS.items()}
    monkeypatch.setattr(grammar, "OPERATORS", operators)
    with pytest.raises(InputError):
        parse_formula(text, ("x", "y"), "here")
    assert max(degrees, default=0) <= 100
    assert symbolic(parse_formula("(x + y)**3", ("x", "y"), "here")) == (X + Y) ** 3
    assert degrees[-1] == 3


@pytest.mark.parametrize(
    "text",
    [
        "+".join(["x"] * 501),
        "(" * 30 + "x" + ")" * 30,
        "sin(cos(exp(tanh(sinh(cosh(x))))))",
        "pos((x - 1/3)**20, 5)",
        "((x + y)/2)**100",
        "sqrt(1 + " * 20 + "2" + ")" * 20,
    ],
    ids=lambda text: text[:30],
)
def test_a_formula_at_a_limit_is_read(text):
    """With one more of what is limited it is refused above; functions of numbers are numbers."""
    assert parse_formula(text, ("x", "y"), "here").variables <= {"x", "y"}


def test_a_message_quotes_the_beginning_of_a_long_formula():
    with pytest.raises(InputError) as refusal:
        parse_formula("x + " + "y" * 1000, ("x", "y"), "here")
    assert str(refusal.value).startswith(f"here: '{'y' * 57}...' is unknown; known are x, y, pi")


@pytest.mark.parametrize("component", ["{}%", "{}x", "0{}", "{},5", "{}^x", "{}(x)", "{}[0]"])
def test_a_hint_quotes_the_beginning_of_a_long_number(component):
    with pytest.raises(InputError) as refusal:
        parse_formula(component.format("9" * 1000), ("x", "y"), "here")
    assert "999..." in str(refusal.value)
    assert len(str(refusal.value)) < 300


@pytest.mark.filterwarnings("error")
def test_python_s_own_warnings_are_not_shown():
    """Of '1or x' Python's parser says that a decimal literal is invalid; our refusal says it, too."""
    with sentences.raises(InputError):
        parse_formula("1or x", ("x", "y"), "here")


def test_a_number_has_no_variables():
    with sentences.raises(InputError):
        parse_number("x", "gap")


@given(st.text(alphabet="xyp0123456789.eE_jJ+-*/%()[]{},:;<>=!~@#'\" \n\\os(λ", max_size=40))
@settings(max_examples=1000, derandomize=True, deadline=None, database=None)
@pytest.mark.filterwarnings("ignore::SyntaxWarning")
def test_any_text_parses_or_is_refused(text):
    try:
        value = parse_formula(text, ("x", "y"), "here")
    except InputError:
        return
    assert value.variables <= {"x", "y"}


PIECES = st.recursive(
    st.sampled_from(["x", "y", "pi", "0", "1", "2", "100", "1e300", "1e-300", "1/2", "-1"]),
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(["+", "-", "*", "/", "**"]), inner).map(lambda p: f"({''.join(p)})"),
        st.tuples(st.sampled_from(["sin", "exp", "log", "sqrt", "cosh", "tanh"]), inner).map(
            lambda p: f"{p[0]}({p[1]})"
        ),
        inner.map(lambda p: f"pos({p}, 3/2)"),
    ),
    max_leaves=8,
)


@given(PIECES)
@settings(max_examples=300, derandomize=True, deadline=None, database=None)
def test_any_formula_parses_to_reals_or_is_refused(text):
    """And what parses can be evaluated; a value may still be infinite, where a formula is singular."""
    try:
        value = parse_formula(text, ("x", "y"), "here")
    except InputError:
        return
    with np.errstate(all="ignore"):
        (result,) = formula.compile_numpy([value], "xy")(np.array([0.3]), np.array([0.7]))
    assert result.dtype == float


@pytest.mark.parametrize("k", ["1", "3/2", "2", "7/3", "4"])
def test_the_derivative_of_pos_is_the_difference_quotient_and_0_on_the_other_side(k):
    """Against central differences, whose error is O(step^2) = 1e-10; exactly 0 where the argument is <= 0."""
    f = parse_formula(f"pos(2*t - 1, {k})", ("t",), "here")
    value = formula.compile_numpy([f], "t")
    slope = formula.compile_numpy([derivative(f, "t")], "t")
    t = np.linspace(0.6, 1.4, 9)
    step = 1e-5
    difference = (value(t + step)[0] - value(t - step)[0]) / (2 * step)
    np.testing.assert_allclose(slope(t)[0], difference, rtol=1e-8)
    remaining = np.array([-1.0, 0.0, 0.25, 0.5])
    assert not np.any(value(remaining)[0])
    assert not np.any(slope(remaining)[0])
    assert not np.allclose(slope(t)[0], 1.01 * difference, rtol=1e-8)


@pytest.mark.parametrize("k", [0, 1, 2, 8, 0.5, 1.5, -0.25, 1 / 3, 9.0])
def test_positive_power_is_the_power(k):
    a = np.array([1e-300, 1e-9, 0.3, 2.0])
    np.testing.assert_allclose(positive_power(a, k), a**k, rtol=1e-13)
    assert not np.any(positive_power(np.array([-1.0, -0.0, 0.0]), k))


def near(root):
    return pytest.approx(root, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "t*pos((t - 1/3)*(2/3 - t), 3) + pos(t**2 + 1, 5) + sin(pos(2 - 3*t, 1/2))",
            [(1 / 3, 3), (2 / 3, 0.5), (2 / 3, 3)],
        ),
        ("exp(t) + t**3", []),
        ("pos(sqrt(2)*t - 1, 2)", [(near(0.5**0.5), 2)]),
        ("pos(t**2 - pi/8, 2)", [(pytest.approx(sign * math.sqrt(math.pi / 8)), 2) for sign in (-1, 1)]),
        ("pos(t**2 + pi, 2)", []),
        ("pos(2*t**2 - 2*t - 1, 2)", [(near((1 + sign * math.sqrt(3)) / 2), 2) for sign in (-1, 1)]),
        ("pos((t - 1/2)**2, 3)", [(0.5, 3)]),
        ("pos(1e-300*t - 1e300, 1)", [(math.inf, 1)]),  # 1e600, which no float is
        ("pos(1e-300*t - 1, 1)", [(1e300, 1)]),
    ],
)
def test_kinks_are_found_with_their_exponents(text, expected):
    """Roots by hand: (t - 1/3)(2/3 - t) has two, t^2 + 1 has none, 2 - 3 t one."""
    assert find_kinks(parse_formula(text, ("t",), "here"), "t") == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("pos(sin(t), 2)", "polynomial"),
        ("pos(t**3 - pi, 2)", "rational coefficients"),
    ],
)
def test_hidden_kinks_are_refused(text, message):
    with pytest.raises(ValueError, match=message):
        find_kinks(parse_formula(text, ("t",), "here"), "t")


def test_compiled_constants_have_the_shape_of_the_arguments():
    x = np.linspace(0, 1, 3)[:, None]
    y = np.linspace(0, 1, 4)
    first, product = compile_numpy([sympy.Rational(1, 3), X * Y], (X, Y))(x, y)
    assert first.shape == product.shape == (3, 4)
    assert np.all(first == 1 / 3)
    np.testing.assert_array_equal(product, x * y)


def test_a_fraction_beyond_all_floats_is_infinite():
    """10^400/3, as a derivative may have it; control: 10^300/3 is a float."""
    huge = sympy.Rational(10**400, 3)
    large = sympy.Rational(10**300, 3)
    values = compile_numpy([huge * X, large * X], (X,))(np.array([0.5]))
    assert np.array_equal(values[0], [np.inf])
    assert values[1] == pytest.approx([1e300 / 6])


@pytest.mark.parametrize(("text", "value"), [("exp(-1000)", 1), ("tanh(400) - 1", 0), ("1 - tanh(400)", 1)])
def test_a_step_of_a_number_sees_digits_that_floats_do_not_have(text, value):
    assert parse_formula(f"pos({text}, 0)", (), "here").rational == value


def test_numbers_that_cancel_are_told_to_the_last_digit():
    """Of pi all but the first 120 digits, by another library."""
    with mpmath.workdps(200):
        digits = mpmath.nstr(mpmath.floor(mpmath.pi * 10**120), 121).removesuffix(".0")
        remaining = float(mpmath.pi * 10**120 - mpmath.mpf(digits)) * 1e-120
    assert float(as_float(parse_formula(f"pi - {digits}/1{'0' * 120}", (), "here"))) == pytest.approx(
        remaining, rel=1e-14
    )


WRITTEN = {
    "3 - 4*x": "-4*x + 3",
    "3*x - 5": "3*(x - 2) + 1",
    "x*(y - 3/4)*(5/2 - x)/2": "x*(5/2 - x)*(y - 3/4)/2",
    "sqrt(2)*x**(1/3)/(y + 1)**2": "x**(1/3)*sqrt(2)*(1 + y)**(-2)",
    "2*pos(x - 1/2, 3/2)/(3*pi)": "pos(x - 1/2, 3/2)*2/3*pi**(-1)",
    "-x*y/2": "-x*y/2",
    "0": "x - x",
}


@pytest.mark.parametrize(("expected", "typed"), WRITTEN.items())
def test_a_formula_is_written_so_that_it_could_be_typed(expected, typed):
    """By hand: terms below 0 last, a rational number last of the others. It is read as the same formula."""
    formula = parse_formula(typed, "xy", "f")
    assert str(formula) == expected
    assert parse_formula(str(formula), "xy", "f") == formula
