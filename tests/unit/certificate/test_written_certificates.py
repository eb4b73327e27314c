"""What is written is a certificate that the checker proves; what no checker reads is refused by name.

The checker runs as a process of its own, without this package.
"""

import errno
import gzip
import json
import os
import pickle
import re
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import mpmath
import numpy as np
import pytest
import sentences
from conftest import ROOT

import unilateral as ul
from unilateral import api
from unilateral.certificates.export import (
    judge_solution,
    make_certificate,
    obstacle_bounds,
    write_certificate,
)
from unilateral.certificates.statement import has_formulas, state_problem
from unilateral.errors import StorageError

EXAMPLES = ROOT / "examples"
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
KITE = [(0, 0), (2, 0), (7 / 3, 1), (1, 1.5)]
CLOSE = 0.03
SIZES = ("--h", "1/8", "--H", "1/4")


def check(path, program="certificate/check.py"):
    """The exit code of a checker, and what it prints; -I and -S leave out all packages."""
    line = [sys.executable, "-I", "-S", str(ROOT / program), str(path)]
    done = subprocess.run(line, capture_output=True, text=True, timeout=60)
    assert done.stderr == ""
    return done.returncode, done.stdout


def read_proved_bounds(path, *program):
    """The bounds on the errors of u and of the flux."""
    code, printed = check(path, *program)
    assert code == 0, printed
    return [float(bound) for bound in re.findall(r"<= (\S+?)(?:,|$)", printed.splitlines()[-1])]


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    """A certificate of a clamped problem without a reaction, with contact on a part of a side only."""
    path = tmp_path_factory.mktemp("certificate") / "seal.json"
    ul.solve(EXAMPLES / "seal.yaml", h=1 / 16, H=1 / 8).save_certificate(path)
    return json.loads(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("field", "factor", "shift", "reason"),
    [
        ("flux", 1, -1e-9, "p.n < 0 on a contact side"),
        ("trace", 1, -1e-9, "v + y < g is possible"),
        ("field", 1 - 1e-8, 0, "div b < 1"),
    ],
)
def test_the_checker_refuses_numbers_that_are_a_little_smaller(
    record, tmp_path, field, factor, shift, reason
):
    """Control: what is written is neither cut off nor raised more than by rounding."""
    values = factor * np.array(record[field]) + shift
    write_certificate(record | {field: values.tolist()}, tmp_path / "c.json")
    code, printed = check(tmp_path / "c.json")
    assert code == 1
    assert reason in printed


@pytest.mark.parametrize("c", ["0", "1e-6"])
def test_without_a_reaction_or_with_a_small_one_the_flux_is_balanced(c, tmp_path):
    """The checker's bound is below the program's, which counts what multigrid left of f + div p - c v.

    Control: with the flux as it is, it is above, because the checker's constant of Friedrichs is larger.
    """
    seal = (EXAMPLES / "seal.yaml").read_text(encoding="utf-8")
    assert "\nc: 0 " in seal
    (tmp_path / "seal.yaml").write_text(seal.replace("\nc: 0 ", f"\nc: {c} "), encoding="utf-8")
    s = ul.solve(tmp_path / "seal.yaml", accuracy=0.05)
    judged = judge_solution(s.solved)
    unbalanced = judged._replace(flux=s.solved.flux)
    bounds = []
    for solved in (judged, unbalanced):
        write_certificate(make_certificate(s.problem, solved), tmp_path / "c.json")
        bounds.append(read_proved_bounds(tmp_path / "c.json")[0])
    assert bounds[0] < s.bounds.u < bounds[1]


@pytest.mark.parametrize(
    ("c", "has_field"), [("0", True), ("1e-30", True), ("8", True), ("12", False), ("1e8", False)]
)
def test_a_field_is_written_for_a_small_reaction(c, has_field, tmp_path):
    """Where c C_F^2 < k = 4: with one side clamped C_F^2 = 4/pi^2, by the function sin(pi x/2)."""
    problem = ul.Problem(SQUARE, f="x", u={3: 0}, free_sides=[0, 1, 2], k=4, c=c)
    ul.solve(problem, h=1 / 8, H=1 / 4).save_certificate(tmp_path / "c.json")
    stated = json.loads((tmp_path / "c.json").read_text(encoding="utf-8"))
    assert ("field" in stated) == has_field
    assert len(read_proved_bounds(tmp_path / "c.json")) == 2


def test_without_a_clamped_side_there_is_no_field(tmp_path):
    ul.solve(ul.Problem(SQUARE, f="x - 1", g=0, c="1e-6"), h=1 / 8, H=1 / 4).save_certificate(
        tmp_path / "c.json"
    )
    assert "field" not in json.loads((tmp_path / "c.json").read_text(encoding="utf-8"))


def test_the_problem_that_is_proved_is_the_user_s(tmp_path):
    ul.solve(EXAMPLES / "seal.yaml", h=1 / 8, H=1 / 4).save_certificate(tmp_path / "c.json")
    _, printed = check(tmp_path / "c.json")
    assert printed.splitlines()[:6] == [
        "-k lap u + c u = f, k = 500, c = 0, f = -50",
        "  polygon (0, 0), (3/5, 0), (3/5, 2/5), (0, 2/5)",
        "  side 0: contact, u >= 0",
        "  side 1: free, k du/dn = 0",
        "  side 2: free, k du/dn = 0",
        "  side 3: clamped, u = 1/200",
    ]


def test_functions_are_terms_where_the_checker_reads_them():
    """Exact ones, from the rules of docs/certificate.md: f of degree 2, g of degree 2 along its side."""
    stated = state_problem(ul.Problem(KITE, f="(x - 1/3)**2 - 0.1*y", g="x**2*y/8 + pi*x*0"))
    assert stated["f"] == [[0, 0, "1/9"], [0, 1, "-1/10"], [1, 0, "-2/3"], [2, 0, "1"]]
    kinds = [side_data for side in stated["sides"] for side_data in side.values()]
    terms = [[2, 1, "1/8"]]
    text = "x**2*y/8"
    # of degree 0 on the bottom, and of degree 3 along each slanted side
    assert kinds == [terms, text, text, text]
    assert state_problem(ul.Problem(SQUARE, f="x**3 - 9", g=0))["f"] == "x**3 - 9"
    assert state_problem(ul.Problem(SQUARE, f="pi*x", g=0))["f"] == "pi*x"


def test_formulas_need_the_other_checker():
    shelter = ul.load(EXAMPLES / "shelter.yaml")
    shelf = ul.load(EXAMPLES / "shelf.yaml")
    assert has_formulas(state_problem(shelter))
    assert not has_formulas(state_problem(shelf))


def test_vertices_are_the_simplest_fractions_that_round_to_them():
    """And a double that is near no simple fraction is its own decimal."""
    vertices = [(0, 0), (0.123456789012345, -2e-7), (1 / 3, 0.1)]
    stated = state_problem(ul.Problem(vertices, f=-1, g=0))["polygon"]
    assert stated == [["0", "0"], [str(Fraction("0.123456789012345")), "-1/5000000"], ["1/3", "1/10"]]
    assert [tuple(float(Fraction(z)) for z in vertex) for vertex in stated] == vertices


def line_through(side, start, end):
    """sin(3 x) exp(y) on a part of a side of KITE, of t in [0, 1], to 30 digits."""
    a = np.array(KITE)[side]
    b = np.array(KITE)[(side + 1) % 4]

    def g(t):
        share = start + (end - start) * t
        x = a[0] + (b[0] - a[0]) * share
        y = a[1] + (b[1] - a[1]) * share
        return mpmath.sin(3 * x) * mpmath.exp(y)

    return g


@pytest.mark.parametrize("side", range(4))
@pytest.mark.parametrize("size", [0.3, 0.01])
def test_bounds_on_g_hold_and_leave_room_for_the_remainder(side, size):
    """By 30 digits and derivatives from them; control: without the remainder g lies above somewhere.

    Let g''' be linear on an edge, and at most T. Then a half of its change is at most T, which counts twice,
    and T itself once, times INTERVALS: without higher terms the room is at most 4.5 times what is needed.
    """
    problem = ul.Problem(KITE, f=-1, g="sin(3*x)*exp(y)")
    t = np.linspace(0, 1, 21)
    above = []
    for start in (0.0, 0.4, 1 - size):
        values = (np.array([z]) for z in (side, start, start + size))
        first, bend, last = obstacle_bounds(problem, *values)[:, 0]
        g = line_through(side, start, start + size)
        on_part = np.array([float(g(s)) for s in t])
        with mpmath.workdps(30):
            thirds = [abs(float(mpmath.diff(g, s, 3))) for s in t]
        without = 2 * on_part[10] - (on_part[0] + on_part[-1]) / 2
        assert bend >= without + max(thirds) / 24
        assert bend <= without + 5 * max(thirds) / 24 + 1e-12 or size > 0.1
        for middle, expected in ((bend, False), (without, None)):
            quadratic = first * (1 - t) ** 2 + 2 * middle * t * (1 - t) + last * t**2
            lies_above = (on_part > quadratic).any()
            assert expected is None or lies_above == expected
            above.append(lies_above)
    assert any(above)


def zero(x, y):
    return 0 * x


NODES = ul.mesh(SQUARE, [[0, 1, 2], [0, 2, 3]])
REFUSED = {
    "pos in f": lambda: ul.Problem(SQUARE, f="pos(x - 1/2, 1)", g=0),
    "pos in g": lambda: ul.Problem(SQUARE, f=-1, g="-pos(x - 1/2, 1)"),
    "jump of q": lambda: ul.Problem(
        SQUARE, f=-1, g=0, free_sides=[2], q=[None, None, "pos(x - 1/2, 0)", None]
    ),
    "array f": lambda: ul.Problem(NODES, f=NODES.points[:, 0], g=0),
    "array g": lambda: ul.Problem(NODES, f=-1, g=NODES.points[:, 0]),
    "k": lambda: ul.Problem(SQUARE, f=-1, g=0, k="sqrt(2)"),
    "c": lambda: ul.Problem(SQUARE, f=-1, g=0, c="pi"),
    "cubic u": lambda: ul.Problem(SQUARE, f=-1, g=-9, u={2: "x**3"}),
    "irrational u": lambda: ul.Problem(SQUARE, f=-1, g=-9, u={2: "pi*x"}),
    "case": lambda: ul.case("natural"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_no_checker_reads_is_refused_by_name(name):
    with sentences.raises(ul.InputError):
        state_problem(REFUSED[name]())


def test_a_solution_of_functions_has_no_certificate(tmp_path):
    """No checker reads values at nodes, and nothing is written."""
    s = ul.solve(ul.Problem(SQUARE, f=lambda x, y: x - 1, g=0), h=1 / 4, H=1 / 2)
    with sentences.raises(ul.InputError):
        s.save_certificate(tmp_path / "c.json")
    assert [*tmp_path.iterdir()] == []


def test_a_copy_has_the_same_certificate(tmp_path):
    s = ul.solve(EXAMPLES / "seal.yaml", h=1 / 8, H=1 / 4)
    for name, solution in (("a", s), ("b", pickle.loads(pickle.dumps(s)))):
        solution.save_certificate(tmp_path / f"{name}.json")
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


def test_the_bytes_are_the_same_whenever_and_wherever_it_is_written(record, tmp_path, monkeypatch):
    write_certificate(record, tmp_path / "a.json.gz")
    monkeypatch.setattr("time.time", lambda: 1e9)
    write_certificate(record, tmp_path / "b.json.gz")
    write_certificate(record, tmp_path / "c.json")
    assert (tmp_path / "a.json.gz").read_bytes() == (tmp_path / "b.json.gz").read_bytes()
    assert gzip.decompress((tmp_path / "a.json.gz").read_bytes()) == (tmp_path / "c.json").read_bytes()


def test_nothing_half_written_remains(record, tmp_path, monkeypatch):
    """On a full disk the file that was there stays."""
    path = tmp_path / "c.json"
    full = Path.write_bytes
    path.write_text("before")

    def half(file, content):
        full(file, content[: len(content) // 2])
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", half)
    with pytest.raises(StorageError):
        write_certificate(record, path)
    assert [*tmp_path.iterdir()] == [path]
    assert path.read_text() == "before"


def test_solve_prints_the_line_that_checks(run, tmp_path):
    file = tmp_path / "a name.json.gz"
    code, out, err = run("solve", EXAMPLES / "shelf.yaml", *SIZES, "--certificate", file)
    assert (code, err) == (0, "")
    (line,) = re.findall(r"^  check it with +python3 (.*)$", out, re.MULTILINE)
    (program,) = re.findall(r"^(\S+) '[^']*a name.json.gz'$", line)
    assert Path(program).resolve() == ROOT / "certificate/check.py"
    assert len(read_proved_bounds(file)) == 2


def test_with_json_nothing_else_is_printed(run, tmp_path):
    code, out, _ = run(
        "solve", EXAMPLES / "shelf.yaml", *SIZES, "--certificate", tmp_path / "c.json", "--json"
    )
    assert code == 0
    assert json.loads(out)["problem"] == "shelf"
    assert len(read_proved_bounds(tmp_path / "c.json")) == 2


def test_sharp_bounds_are_not_what_is_proved(run, tmp_path):
    """It is said, with the cheap bound; control: without --sharp it is not."""
    arguments = ["solve", EXAMPLES / "shelf.yaml", *SIZES, "--certificate", tmp_path / "c.json"]
    _, out, _ = run(*arguments, "--sharp")
    (cheap,) = re.findall(r"it proves +the bound without --sharp: at most (\S+)$", out, re.MULTILINE)
    assert float(cheap) == pytest.approx(read_proved_bounds(tmp_path / "c.json")[0], rel=CLOSE)
    assert "without --sharp" not in run(*arguments)[1]


@pytest.mark.parametrize(
    ("problem", "options", "reason"),
    [
        ("natural", [], "'natural' is a case,"),
        (EXAMPLES / "shelf.yaml", ["c.txt"], "c.txt: the ending must be .json or .gz"),
        (EXAMPLES / "shelf.yaml", ["none/c.json"], "there is no folder none"),
    ],
)
def test_refusals_come_before_the_solve(refusal, monkeypatch, tmp_path, problem, options, reason):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(api, "solve", lambda *_, **__: pytest.fail("it was solved"))
    assert reason in refusal("solve", problem, *SIZES, "--certificate", *(options or ["c.json"]))
    assert [*tmp_path.iterdir()] == []


def test_a_dry_run_writes_no_certificate(refusal, tmp_path):
    arguments = ["solve", EXAMPLES / "shelf.yaml", "--accuracy", "0.1", "--dry-run"]
    assert "--certificate" in refusal(*arguments, "--certificate", tmp_path / "c.json")
