"""`init` and `check`: what they write and show, and what they refuse."""

import re
from fractions import Fraction

import numpy as np
import pytest
from conftest import ROOT

from unilateral.cli.init_check import draw_problem
from unilateral.problems import problem_file

SHELTER = str(ROOT / "examples/shelter.yaml")


def test_what_init_writes_can_be_checked_and_solved(run, tmp_path):
    """The commands in its first lines are the ones to type. It shows contact that ends, and a gap.

    Force and reaction carry the load, 5e-5 N/mm^2 times 600 mm times 400 mm, which is 12 N.
    Control: a field less, and it is refused.
    """
    file = tmp_path / "my_problem.yaml"
    code, out, _ = run("init", str(file))
    assert (code, out.split(", ")[0]) == (0, f"written: {file}")
    text = file.read_text(encoding="utf-8")
    named = rf"unilateral (check|solve) ({re.escape(str(file))})( --accuracy [0-9.]+)?"
    commands = re.findall(named, text)
    assert len(commands) == 2
    for command, *remaining in commands:
        assert run(command, *" ".join(remaining).split())[0] == 0
    printed = run("solve", str(file))[1]
    start, end = map(float, re.search(r"contact, side 0 .*computed: (\S+) to (\S+),", printed).groups())
    assert 0 < start < end == 600  # it ends inside the side
    assert float(re.search(r"sum of forces, reactions +(\S+) ±", printed)[1]) == pytest.approx(12)
    file.write_text(text.replace("f: ", "#"), encoding="utf-8")
    code, _, err = run("check", str(file))
    assert (code, err) == (
        2,
        f"unilateral: {file}: the field f is missing; it holds the source in the polygon\n",
    )


def test_the_template_has_every_field(tmp_path):
    """So that nobody has to look for one: those of the schema."""
    import yaml

    folder = ROOT / "src/unilateral/problems"
    schema = yaml.safe_load((folder / "problem.schema.yaml").read_text())
    template = yaml.safe_load((folder / "template.yaml").read_text())
    assert set(template) == set(schema["properties"])


def test_init_overwrites_nothing(run, tmp_path):
    file = tmp_path / "own.yaml"
    file.write_text("mine")
    code, out, err = run("init", str(file))
    assert (code, out, err) == (2, "", f"unilateral: {file} exists already; name another file\n")
    assert file.read_text() == "mine"
    assert run("init", str(tmp_path / "own.txt"))[0] == 2
    assert "there is no folder" in run("init", str(tmp_path / "no/own.yaml"))[2]


def test_check_shows_what_was_understood(run):
    """By hand from the file: the area is 2 + 1/2, the slanted sides are 5^(1/2)/2 long, f grows with x."""
    code, out, err = run("check", SHELTER)
    assert (code, err) == (0, "")
    assert out.splitlines() == [
        "shelter: -k lap u + c u = f with k = 1 and c = 1",
        "  polygon     5 sides, area 2.5, perimeter 6.23607",
        "  f           3*x - 5, between -5.00000000001 and 1.00000000001, rounding included",
        "  side 0      (0, 0) to (2, 0), length 2: u >= sin(pi*x)/4, from -0.25 to 0.25",
        "  side 1      (2, 0) to (2, 1), length 1: u >= y*(1 - y)/2, from 0 to 0.125",
        "  side 2      (2, 1) to (1, 1.5), length 1.11803: free, du/dn = 0",
        "  side 3      (1, 1.5) to (0, 1), length 1.11803: free, du/dn = 0",
        "  side 4      (0, 1) to (0, 0), length 1: free, du/dn = 0",
        "  guaranteed  u >= -5.00000000001, a lower bound on inf f / c, rounding included",
    ]


@pytest.mark.parametrize(
    ("f", "minimum", "largest"),
    [
        ("x", 0, 1),
        ("-1/3*x", Fraction(-1, 3), 0),
        ("2/3 + x*1e-8", Fraction(2, 3), Fraction(2, 3) + Fraction(1, 10**8)),
    ],
)
def test_the_printed_range_of_f_is_outward(run, problem_file_of, f, minimum, largest):
    """The values of f at the square's corners lie in it; it is wider by 11 digits at most."""
    out = run("check", problem_file_of(f=f, g="-9"))[1]
    ends = [Fraction(x) for x in re.search(r"between (\S+) and (\S+), rounding included", out).groups()]
    bound = Fraction(re.search(r"guaranteed  u >= (\S+),", out)[1])
    assert ends[0] <= minimum <= largest <= ends[1]
    assert ends[1] - ends[0] <= largest - minimum + Fraction(3, 10**11)
    assert bound == ends[0]


def test_check_shows_coefficients_and_sides_without_contact(run, problem_file_of):
    """f / c = 1/2 lies above g = 0.4 on all sides."""
    out = run("check", problem_file_of(f="1", g="0.4", c="2", k="1/3"))[1]
    assert "with k = 1/3 and c = 2" in out
    assert "no contact  on sides 0, 1, 2, 3" in out
    assert "no contact" not in run("check", problem_file_of(f="1", g="0.6", c="2"))[1]


def test_check_shows_the_flux_on_free_sides(run, problem_file_of):
    """q of side 1 is y (1 - y), at most 1/4 at y = 1/2 and on 200 points next to it; side 2 has none."""
    free = {"g": "[0, null, null, 0]", "free_sides": "[1, 2]", "q": '[null, "y*(1 - y)", null, null]'}
    out = run("check", problem_file_of(f="1", **free))[1]
    assert "length 1: free, du/dn = y*(1 - y), from 0 to 0.25\n" in out
    assert "length 1: free, du/dn = 0\n" in out
    assert (
        "length 1: free, k du/dn = y*(1 - y), from" in run("check", problem_file_of(f="1", k="2", **free))[1]
    )


def test_the_picture_has_the_sides_and_the_obstacle(tmp_path, run):
    """Numbers 0 to 4, three dashed sides, and g = sin(pi x)/4 along the first side; the same bytes twice."""
    top, bottom, *_ = draw_problem(problem_file.load_problem(SHELTER)).axes
    assert [text.get_text() for text in top.texts] == list("01234")
    assert [line.get_linestyle() for line in top.lines] == ["-", "-", "--", "--", "--"]
    s, g = bottom.lines[0].get_data()
    assert g == pytest.approx(np.sin(np.pi * s) / 4, abs=1e-12)
    assert [line.get_linestyle() for line in bottom.lines[:5]] == ["-", "-", "--", "--", "--"]
    pictures = [tmp_path / name for name in ("a.svg", "b.svg")]
    for picture in pictures:
        assert run("check", SHELTER, "-o", str(picture))[0] == 0
    assert pictures[0].read_bytes() == pictures[1].read_bytes()


def test_check_still_draws_to_its_former_option_out(tmp_path, run):
    """As before, and stderr says -o; control: -o says nothing, and both together are refused."""
    pictures = {option: tmp_path / f"{option.strip('-')}.svg" for option in ("-o", "--out")}
    messages = [run("check", SHELTER, option, str(picture))[2] for option, picture in pictures.items()]
    assert messages == ["", "unilateral: --out of check is now called -o; type -o in its place\n"]
    assert pictures["-o"].read_bytes() == pictures["--out"].read_bytes()
    assert "--out " not in run("check", "--help")[1]
    code, _, message = run("check", SHELTER, "-o", "a.svg", "--out", "a.svg")
    assert (code, message) == (2, "unilateral: -o and --out both name the picture; leave out --out\n")


@pytest.mark.parametrize(("f", "constant_title"), [("-4", "f = −4"), ("0", "f = 0"), ("1e-3", "f = 0.001")])
def test_the_picture_of_a_constant_has_no_colour_bar(tmp_path, f, constant_title):
    """Its colours would span a range that f does not have; control: another f has a bar."""
    for text, title, n_bars in ((f, constant_title, 0), (f"{f} + x", "f", 1)):
        file = tmp_path / "problem.yaml"
        file.write_text(f"polygon: [[0, 0], [1, 0], [0, 1]]\nf: {text}\ng: 0\n", encoding="utf-8")
        axes = draw_problem(problem_file.load_problem(str(file))).axes[0]
        assert axes.get_title().partition(", and the sides")[0] == title
        assert len(axes.child_axes) == n_bars
