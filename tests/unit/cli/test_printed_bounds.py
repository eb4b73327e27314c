"""Bounds as they are printed are bounds: solutions of which the truth is known, and all that is printed."""

import json
import re
from decimal import Decimal

import numpy as np
import pytest

import unilateral as ul
from unilateral.cli import main
from unilateral.formulas import decimals

pytestmark = pytest.mark.usefixtures("shared_cases")
ON_ONE_SIDE = {"polygon": "[[0, 0], [1, 0], [1, 1], [0, 1]]", "free_sides": "[0, 2, 3]"}
LINEAR = {"f": "4/3*x", "g": "[null, 4/3, null, null]", "q": "[null, null, null, -4/3]"}
"""u = 4x/3, which is in V_h; the force is 4/3, on side 1."""
SCALE = 443.42
PARABOLA = {"f": f"{SCALE}*(x**2/2 - 1)", "g": f"[null, {SCALE}/2, null, null]"}
"""u = SCALE x^2/2. The scale puts the bound, 1.00004, where four decimals round it down."""
NUMBER = r"[0-9]+(?:\.[0-9]*)?(?:e[+-][0-9]+)?"


@pytest.fixture
def print_solution(tmp_path, capsys):
    """What `solve` prints of a problem with these fields."""

    def solve(fields, *options):
        file = tmp_path / "problem.yaml"
        file.write_text("\n".join(f"{name}: {text}" for name, text in (ON_ONE_SIDE | fields).items()))
        assert main(["solve", str(file), *options]) == 0
        return capsys.readouterr().out

    return solve


def forces(out):
    """The two ends of every force, which is printed as a number and by how much it may be off."""
    return [
        (Decimal(value) - Decimal(half_width), Decimal(value) + Decimal(half_width))
        for value, half_width in re.findall(rf"force, .* ({NUMBER}) ± ({NUMBER})", out)
    ]


@pytest.mark.parametrize(
    "options", [("--h", "1/16", "--H", "1/8", "--tolerance", "1e-7"), ("--accuracy", "1e-5")]
)
def test_the_printed_interval_has_the_force_in_it(print_solution, options):
    intervals = forces(print_solution(LINEAR, *options))
    assert len(intervals) == 2
    for lower, upper in intervals:
        assert 3 * lower <= 4 <= 3 * upper
        assert upper - lower <= Decimal("0.0002")


def gradient_error(solution):
    """||grad u - grad u_h||_0 for PARABOLA: exact, as x is linear on triangles and grad u_h constant."""
    nodes = solution.mesh.triangles
    (x, y) = solution.mesh.points[nodes].transpose(2, 0, 1)
    u = solution.u[nodes]
    planes = np.linalg.solve(np.stack([x, y, np.ones_like(x)], axis=2), u[..., None])[..., 0]
    distance = (SCALE * x.mean(axis=1) - planes[:, 0]) ** 2 + SCALE**2 * x.var(axis=1) / 4 + planes[:, 1] ** 2
    return float(np.sqrt(solution.mesh.areas @ distance))


def test_the_printed_bound_is_above_the_error(print_solution):
    """Which is above that of the gradient; the nearest number with four decimals is not."""
    options = ["--h", "1/128", "--H", "1/64", "--tolerance", "4e-5", "--sharp"]
    (bound,) = re.findall(rf"\|\|u - u_h\|\|_1 <= ({NUMBER})", print_solution(PARABOLA, *options))
    corners = [(0, 0), (1, 0), (1, 1), (0, 1)]
    g = [None, f"{SCALE}/2", None, None]
    problem = ul.Problem(corners, PARABOLA["f"], g, free_sides=[0, 2, 3])
    s = ul.solve(problem, h=1 / 128, H=1 / 64, stop=ul.Stop(tolerance=4e-5))
    error = gradient_error(s)
    assert float(f"{s.sharp_bounds.u:.4e}") < error <= float(bound)
    assert float(bound) < 1.001 * error


RUNS = {
    "sizes": ("natural", "--h", "1/16", "--H", "1/8"),
    "sharp": ("thirds", "--h", "1/16", "--H", "1/8", "--sharp"),
    "accuracy": ("natural", "--accuracy", "0.1"),
    "lambda": ("natural", "--accuracy", "0.3", "--norm", "hm12"),
    "no accuracy": ("natural", "--accuracy", "0.01", "--max-unknowns", "500"),
}


def all_numbers(computed):
    """Those of a JSON object."""
    if isinstance(computed, dict | list):
        return [
            x
            for value in (computed.values() if isinstance(computed, dict) else computed)
            for x in all_numbers(value)
        ]
    return [computed] if isinstance(computed, float) else []


def list_printed_bounds(arguments, capsys):
    """Upper and lower bounds that are printed, each with the number of --json that it shows."""
    codes = {main(["solve", *arguments, *extra]) for extra in ((), ("--json",))}
    text, record = capsys.readouterr().out.rsplit('{"problem"', 1)
    solution = json.loads('{"problem"' + record)
    for run in ("seconds", "peak_mb"):  # by chance they may be near a bound
        solution.pop(run)
    known_numbers = np.array(all_numbers(solution))
    assert len(codes) == 1
    text = "\n".join(line for line in text.splitlines() if line.startswith("  "))
    above = re.findall(rf"<= ({NUMBER})|and ({NUMBER})$", text, re.MULTILINE)
    below = re.findall(rf">= ({NUMBER})|between ({NUMBER})", text)
    return [[_round_both_ways(max(pair), known_numbers) for pair in pairs] for pairs in (above, below)]


def _round_both_ways(number, expected):
    nearest = expected[np.argmin(np.abs(expected - float(number)))]
    return Decimal(number), Decimal(float(nearest))


def _agree_with_json(pair):
    """Whether they agree to one unit of the last digit that is printed."""
    return abs(pair[0] - pair[1]) <= Decimal(1).scaleb(pair[0].as_tuple().exponent)


def wrong(above, below):
    """The bounds that are printed on the wrong side of the number."""
    return [p for p in above if _agree_with_json(p) and p[0] < p[1]] + [
        p for p in below if _agree_with_json(p) and p[0] > p[1]
    ]


@pytest.mark.parametrize("name", RUNS)
def test_every_bound_that_is_printed_is_one_of_the_number_in_json(name, capsys):
    above, below = list_printed_bounds(RUNS[name], capsys)
    assert len(above) >= 4
    assert len(below) >= 2
    assert sum(map(_agree_with_json, above + below)) >= 6
    assert wrong(above, below) == []


def test_by_plain_rounding_some_would_be_on_the_wrong_side(monkeypatch, capsys):
    monkeypatch.setattr(decimals, "_format_rounding", lambda x, spec, _: format(x, spec))
    assert any(wrong(*list_printed_bounds(arguments, capsys)) for arguments in RUNS.values())
