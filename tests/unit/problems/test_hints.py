"""Hints are tried: what a message says to write is typed, and is read.

Every text in the code that says what to write occurs in a message of this table.
"""

import ast
import re

import pytest
from conftest import ROOT

from unilateral.errors import InputError
from unilateral.formulas import grammar
from unilateral.problems import problem_file

FREE = {"g": "[-9, null, -9, -9]", "free_sides": "[1]"}
CLAMPED = {"g": "[null, -9, -9, -9]"}
IN_F = {  # a formula that is refused, and what the message says to write for it
    "abs(x - 1/2)": "pos(x - 1/2, 1) + pos(-(x - 1/2), 1)",
    "max(x, y)": "y + pos(x - y, 1)",
    "min(x, y)": "x - pos(x - y, 1)",
    "sign(x - 1/2)": "2*pos(x - 1/2, 0) - 1",
    "where(x > 1/2, x, y)": "y + (x - y)*pos(x - 1/2, 0)",
    "heaviside(x - 1/2)": "pos(x - 1/2, 0)",
    "Heaviside(x - 1/2)": "pos(x - 1/2, 0)",
    "step(x - 1/2)": "pos(x - 1/2, 0)",
    "ln(2)*x": "log(2)*x",
    "log10(2)*x": "log(2)/log(10)*x",
    "tan(x)": "sin(x)/cos(x)",
    "pow(x, 2)": "x**2",
    "cbrt(1 + x)": "(1 + x)**(1/3)",
    "sqrt(x - y)": "pos(x - y, 1/2)",
    "sqrt((x - y)**2)": "pos(x - y, 1) + pos(-(x - y), 1)",
    "log(1 + x)": "log(2)",
    "x > 1/2": "pos(x - 1/2, 0)",
    "x if x > y else y": "pos(x - 1/2, 0)",
    "x^2 - y": "x**2 - y",
    "2x": "2*x",
    "2xy": "2*x*y",
    "0.5 sin(x)": "0.5*sin(x)",
    "2(x + 1)": "2*(x + 1)",
    "x(y + 1)": "x*(y + 1)",
    "-50 N/m2": "-50",
    "50*kN": "50",
    "1e3 [Pa]": "1e3",
    "600mm*x": "600*x",
    "0,5*x": "0.5*x",
    "1,000.5": "1000.5",
    "1,000": "1000",
    "1,050*x": "1.050*x",
    "1,000,000": "1000000",
    "1.000,5": "1000.5",
    "12 000*x": "12000*x",
    "1'000.5": "1000.5",
    "1,5e3": "1.5e3",
    "-50 N/m²": "-50",
    "5 µm": "5",
    "12 °C": "12",
    "2π*x": "2*pi*x",
    "5%": "5/100",
    "1e": "1e-3",
    "1e-": "exp(1)",
    "010": "10",
    "x[0] - x[1]": "x - y",
    "PI*x": "pi*x",
    "X": "x",
    "Sin(x)": "sin(x)",
    "np.sin(x)": "sin(x)",
    "math.pi": "pi",
    "e*x": "exp(1)*x",
    "2π": "2*pi",
    "x²": "x**2",
    "x³": "x**3",
    "x·y": "x*y",
    "x×y": "x*y",
    "x÷2": "x/2",
    "x − y": "x - y",
    "x – y": "x - y",
    "√(2)": "sqrt(2)",
    "sin*x": "sin(x)",
    "none": "0",
    "sin(1)**2 + cos(1)**2 - 1": "0",
    "pos(x*y - 1/4, 1)": "pos(1/4 - (x - 1/2)**2 - (y - 1/3)**2, 1)",
    "pos(1 - 1e-150*(x**2 + y**2) - x, 1)": "pos(1 - x, 1)",
}
ELSEWHERE = [
    ({"g": "heaviside(x - 1/2)"}, {"g": "pos(x - 1/2, 1) - 9"}),
    ({"g": "x > 1/2"}, {"g": "pos(x - 1/2, 1) - 9"}),
    ({"g": "where(x > 1/2, 1, 0)"}, {"g": "pos(x - 1/2, 1) - 9"}),
    ({"g": "abs(x - 1/2) - 9"}, {"g": "pos(x - 1/2, 1) + pos(-(x - 1/2), 1) - 9"}),
    ({"u": "{0: sign(x)}", **CLAMPED}, {"u": "{0: 'pos(x, 1)'}", **CLAMPED}),
    ({"q": "sqrt(y)", **FREE}, {"q": "pos(y, 1/2)", **FREE}),
    ({"q": "y > 1/2", **FREE}, {"q": "pos(y - 1/2, 0)", **FREE}),
    ({"q": "nil", **FREE}, {"q": "0", **FREE}),
    ({"q": "nil", **FREE}, {"q": "[null, null, null, null]", **FREE}),
    ({"q": "[1, 1, null, null]", **FREE}, {"q": "[null, 1, null, null]", **FREE}),
    ({"q": "[1, 1, null, null]", **FREE}, {"q": "[1, 1, null, null]", "free_sides": "[0, 1]"}),
    ({"q": "1"}, {"q": "1", **FREE}),
    ({"g": "[none, -9, -9, -9]"}, FREE),
    ({"g": "[-9, null, -9, -9]"}, FREE),
    ({"g": "[-9, null, -9, -9]"}, {"g": "[-9, -9, -9, -9]"}),
    ({"g": "[-9, -9, -9, -9]", "free_sides": "[1]"}, FREE),
    ({"g": "null"}, {"g": "-9"}),
    ({"g": "[-9, -9, -9, -9]", "free_sides": "[1]"}, {"g": "[-9, null, -9, -9]", "free_sides": "[1]"}),
    ({"g": "[-9, -9, -9, -9]", "free_sides": "[1]"}, {"g": "[-9, -9, -9, -9]"}),
    ({"u": "{0: none}"}, {"u": "{0: 0}"}),
    ({"u": "{0: 0}", "g": "[-9, -9, -9, -9]"}, {"u": "{0: 0}", **CLAMPED}),
    ({"u": "{0:0}"}, {"u": "{0: 0}"}),
    ({"u": "{0: 0}", "free_sides": "[0]"}, {"u": "{0: 0}"}),
    ({"u": "0"}, {"u": "{0: x*(1 - x), 3: 0}"}),
    ({"c": "0"}, {"c": "0", "u": "{0: 0}"}),
    ({"k": "2pi"}, {"k": "2*pi"}),
    ({"k": "5 N/m"}, {"k": "5"}),
    ({"k": "two"}, {"k": "1/3"}),
    ({"polygon": "[[0, 0], [1;0], [0, 1]]"}, {"polygon": "[[0, 0], [1, 0], [0, 1]]"}),
    ({"polygon": "[[0, 0], ['1,5', 0], [0, 1]]"}, {"polygon": "[[0, 0], [1.5, 0], [0, 1]]"}),
    ({"free_sides": "1"}, {"free_sides": "[1]"}),
    ({"title": "{a: 1}"}, {"title": "one line"}),
    ({"g": "\n\t- -9"}, {"g": "-9"}),
    ({"f": "&a 1"}, {"f": "1"}),
    ({"f": "!!int 1"}, {"f": "1"}),
    ({"f:1\ng": "-9", "f": None}, {"f": "1", "g": "-9"}),
]
PAIRS = [*(({"f": bad}, {"f": good}) for bad, good in IN_F.items()), *ELSEWHERE]
FILES = [
    *("formulas/grammar.py", "formulas/formula.py", "system/declarations.py"),
    *("problems/reading.py", "problems/build.py", "problems/data_checks.py", "problems/problem_file.py"),
]


@pytest.fixture
def message(problem_file_of):
    """What a file with these fields is refused with."""

    def refusal(fields):
        file = problem_file_of(**{"f": "x - y", "g": "-9"} | fields)
        with pytest.raises(InputError) as error:
            problem_file.load_problem(file)
        return str(error.value)

    return refusal


@pytest.mark.parametrize(("bad", "good"), PAIRS, ids=[str(bad) for bad, _ in PAIRS])
def test_what_a_hint_says_to_write_is_read(problem_file_of, message, bad, good):
    """Where the message has the very text, and not letters for parts of it, that text is typed."""
    literal = re.search(r"write (\S+) for \S+$", message(bad))
    if literal and not re.search(r"\b[abk]\b", literal[1]):
        assert literal[1] in "".join(good.values())
    problem_file.load_problem(problem_file_of(**{"f": "x - y", "g": "-9"} | good))


def test_every_text_that_says_what_to_write_was_tried(message):
    """Texts with `write` in the code, with anything for their braces, occur in the messages above."""
    report = "\n".join(message(bad) for bad, _ in PAIRS)
    texts = {text for name in FILES for text in offers(ROOT / "src/unilateral" / name)}
    assert len(texts) > 20
    assert sorted(text for text in texts - CASES if not re.search(text, report)) == []
    typed = " ".join(IN_F)
    assert [
        word for word in (*grammar.FUNCTION_SUBSTITUTES, *grammar.LETTER_SUBSTITUTES) if word not in typed
    ] == []


CASES = {re.escape(text) for text in (grammar.NO_ROOT,)}
"""What is said of cases only."""


def offers(file):
    """Patterns of the texts with the word `write` in a module, but for docstrings."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    inside = {
        id(component)
        for node in ast.walk(tree)
        if isinstance(node, ast.JoinedStr)
        for component in ast.walk(node)
    }
    plain = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr) and id(node) not in plain:
            escapes = [
                re.escape(component.value) if isinstance(component, ast.Constant) else ".*"
                for component in node.values
            ]
        elif (
            isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in inside | plain
        ):
            escapes = [re.escape(node.value)]
        else:
            continue
        if re.search(r"\bwrite\b", "".join(escapes)):
            yield "".join(escapes)


def test_a_text_that_nothing_says_is_noticed(tmp_path):
    """Control: it is found in a module, docstrings are not."""
    file = tmp_path / "own.py"
    file.write_text(
        '"""write"""\na = 1\n"""write b"""\nraise ValueError(f"{a}; write {a} or x")\nc = "write 0"\n'
    )
    assert sorted(offers(file)) == [".*;\\ write\\ .*\\ or\\ x", "write\\ 0"]
