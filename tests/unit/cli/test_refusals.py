"""What `solve` refuses, in one sentence and with code 2: arguments and files."""

import pytest
from typed import OWN_CASE, PROBLEM, SIZES

pytestmark = pytest.mark.usefixtures("shared_cases")


@pytest.mark.parametrize("option", ["--h", "--H", "--rho", "--tolerance"])
@pytest.mark.parametrize(
    "text", ["0", "-1", "nan", "inf", "1/0", "abc", "1/", "", "1e-400", "1e400", "0/3", "1e999999999", "1;2"]
)
def test_a_size_must_be_a_positive_number(refused, option, text):
    message = refused("solve", "natural", *SIZES, f"{option}={text}")
    assert f"argument {option}: '{text}' must be a positive number or a fraction such as 1/64" in message


SINGULAR, ACCURATE = ("--h", "1/8", "--H", "1/8", "--rho", "1/2"), ("natural", "--accuracy", "0.1")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "missing command; see 'unilateral --help'"),
        (("draw",), "there is no command 'draw'; see 'unilateral --help'"),
        (("solve",), "PROBLEM is missing; see 'unilateral solve --help'"),
        (("solve", "natural"), "solve needs --h and --H, or --accuracy; --h is missing"),
        (("solve", "natural", "--h", "1/8"), "solve needs --h and --H, or --accuracy; --H is missing"),
        (("solve", "natural", *SIZES, "--accuracy", "0.1"), "--H is chosen by --accuracy; leave one of the"),
        (("solve", *ACCURATE, "--tolerance", "1"), "--tolerance is chosen by --accuracy"),
        (("solve", "natural", "--accuracy", "1"), "--accuracy: it is relative and must be below 1"),
        (("solve", "natural", *SIZES, "--absolute"), "--absolute is only for --accuracy"),
        (("solve", "natural", *SIZES, "--norm", "h1"), "--norm is only for --accuracy"),
        (("solve", "natural", *SIZES, "--max-seconds", "9"), "--max-seconds is only for --accuracy"),
        (
            ("solve", *ACCURATE, "--norm", "l2"),
            "argument --norm: 'l2' is none of h1, hm12; see 'unilateral solve --help'",
        ),
        (("solve", *ACCURATE, "--max-unknowns", "8"), "needs 9 unknowns; --max-unknowns"),
        (("solve", "natural", *SINGULAR), "rho has no use where S is singular"),
        (("solve", "smooth", *SIZES, "--free-sides", "1,x"), "'1,x' must be numbers of sides such as 1,2,3"),
        (("solve", "smooth", *SIZES, "--free-sides", "2,4"), "'square' has the sides 0 to 3, not 4"),
        (("solve", "smooth", *SIZES, "--free-sides", "0"), "case 'smooth' has contact on side 0"),
        (("solve", "no_contact", *SIZES, "--free-sides", "0,1,2,3"), "one side at least must not be free"),
        (("solve", "natural", *SIZES, "--leave-out-idle-sides"), "is for problem files; of a case name"),
        (("solve", PROBLEM, *SIZES, "--side", "1"), "--side is for cases; "),
        (("solve", PROBLEM, *SIZES, "--polygon", "square"), "--polygon is for cases; "),
        (("solve", PROBLEM, *SIZES, "--free-sides", "1"), "--free-sides is for cases; "),
        (("solve", PROBLEM, *SIZES, "--mesh", "structured"), "polygon 'triangle' has no structured mesh"),
        (
            ("solve", "natural", *SIZES, "--levels", "3"),
            "there is no option --levels; see 'unilateral solve --help'",
        ),
        (("solve", "natural", "--h"), "option '--h' requires an argument; see 'unilateral solve --help'"),
        (("solve", "natural", "smooth"), "got unexpected extra argument (smooth); see 'unilateral solve"),
        (("solve", "natural", *SIZES, "--js"), "there is no option --js; did you mean --json?"),
        (("solve", "two\nlines", *SIZES), "case 'two lines' is unknown"),
        (
            ("solve", "natural", "--h", "1e-7", "--H", "1/4"),
            "h = 1e-07 makes 1e+14 unknowns on 'square',",
        ),
        (("solve", "natural", "--h", "1/4", "--H", "1e-6"), "16 of them on the boundary, take about"),
        (("solve", "thirds", *SIZES, "--polygon", "disc"), "polygon 'disc' is unknown; the named ones are"),
        (("solve", "thirds", *SIZES, "--side", "left"), "argument --side: 'left' is not a valid integer"),
        (
            ("solve", "natural", *SIZES, "--mesh", "quads"),
            "'quads' is neither structured nor unstructured nor",
        ),
        (
            ("solve", "natural", *SIZES, "--algorithm", "simplex"),
            "argument --algorithm: 'simplex' is none of auto, uzawa",
        ),
        (("solve", "natural", *SIZES, "--max-steps", "0"), "'0' must be a whole number of at least 1"),
        (
            ("solve", "natural", "--h", "0,5", "--H", "1"),
            "number or a fraction such as 1/64; write 0.5 for 0,5",
        ),
        (("solve", "natural", *SIZES, "--max-steps", "1.5"), "'1.5' must be a whole number of at least 1"),
    ],
)
def test_bad_arguments(refused, arguments, message):
    assert message in refused(*arguments)


OWN_PROBLEM = "polygon: [[0, 0], [1, 0], [0, 1]]\nf: 1\ng: 0\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (OWN_CASE.replace("title", "titel"), "there is no field 'titel' here"),
        (OWN_CASE.replace("formula: ", "formula: -"), "lambda = du/dn < 0"),
        ("\x00", "is not a YAML file"),
        ("a: [1, 2", "is not a YAML file"),
        ("# λ\ng:\n\t- 0\n", "is not a YAML file: there is a tab in line 3; write spaces"),
        ("g: [a,\t1", "is not a YAML file: while parsing a flow sequence in line 1"),
        ("f: !!int x", "own.yaml: 'tag:yaml.org,2002:int' in line 1 is a tag; write the value alone"),
        (f"{OWN_PROBLEM}? {'k' * 100_000}\n: 1\n", f"there is no field '{'k' * 57}...' here; the fields are"),
        (f"{OWN_PROBLEM}title: [{'[1], ' * 2000}]\n", f"field title: it is [{'[1], ' * 11}[...; it"),
    ],
    ids=["typo", "not a solution", "binary", "half", "tab", "tab elsewhere", "tag", "long name", "long list"],
)
def test_bad_files(refused, tmp_path, content, message):
    """What else a file may have is refused in the tests of declarations, cases and problems."""
    file = tmp_path / "own.yaml"
    file.write_text(content)
    assert message in refused("solve", str(file), *SIZES)
