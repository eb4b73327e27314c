"""Traps that a hostile reader of certificate/check.py found, and its numbers computed in another way."""

import gzip
import importlib.util
import json
import subprocess
import sys
from decimal import Decimal
from fractions import Fraction
from functools import cache

import pytest
import sentences
from conftest import ROOT
from known_certificates import checker
from random_certificates import random_certificate
from recomputed import Recomputed, decimal

CHECKER = ROOT / "certificate/check.py"


def load_checker(path):
    specification = importlib.util.spec_from_file_location(f"{path.stem}_read_by_referee", path)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


check = load_checker(CHECKER)
check_formulas = load_checker(CHECKER.with_name("check_formulas.py"))


def square():
    """u = g = (x^2 + y^2)/2 on the unit square, in contact all around.

    v interpolates u, p = grad u, and v + y = u at the boundary.
    """
    g = [[2, 0, "1/2"], [0, 2, "1/2"]]
    return {
        "format": "unilateral certificate 1",
        "problem": {
            "k": "1",
            "c": "1",
            "f": [[0, 0, "-2"], *g],
            "polygon": [["0", "0"], ["1", "0"], ["1", "1"], ["0", "1"]],
            "sides": [{"contact": g}, {"contact": g}, {"contact": g}, {"contact": g}],
        },
        "mesh": {"boundary": [[0], [0], [0], [0]], "inside": [], "triangles": [[0, 1, 2], [0, 2, 3]]},
        "v": [0, 0.5, 1, 0.5],
        "flux": [1, 1, 0, 0, 0, 0, 1, 1, 0, 0],
        "trace": [0, 0.5, 1, 0.5, 0.125, 0.625, 0.625, 0.125],
    }


def refusal(certificate):
    with pytest.raises(check.Refused) as caught:
        check.Certificate(certificate).bounds()
    return str(caught.value)


def run(*paths):
    """Exit code, output and error output of the checker, without the project's packages."""
    command = [sys.executable, "-I", "-S", CHECKER, *paths]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


def test_the_square_is_proved():
    """u - v = (x^2 - x + y^2 - y)/2, so |u - v|_1^2 = 1/6 and ||u - v||^2 = 11/360, by hand."""
    X, L = check.Certificate(square()).bounds()
    assert (1 / 6 + 11 / 360) ** 0.5 < X < 1
    assert 0 < L < 1


def test_another_format_is_refused():
    assert "format" in refusal(square() | {"format": "unilateral certificate 2"})


def test_two_conditions_on_one_side_do_not_make_up_for_a_side_without():
    certificate = square()
    g = certificate["problem"]["sides"][0]["contact"]
    certificate["problem"]["sides"] = [{"contact": g, "free": []}, {}, {"contact": g}, {"contact": g}]
    assert "one condition" in refusal(certificate)


def test_a_file_that_cannot_be_read_ends_with_2_and_no_traceback(tmp_path):
    packed = bytearray(gzip.compress(json.dumps(square()).encode()))
    packed[12:20] = bytes(8)  # the deflated data; the header stays right
    files = {
        "spoilt.json.gz": bytes(packed),
        "deep.json": b"[" * 100_000,
        "text.json": b"no json",
        "cut.json.gz": gzip.compress(json.dumps(square()).encode())[:-20],
    }
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
        code, output, errors = run(tmp_path / name)
        assert (code, output) == (2, "")
        assert "Traceback" not in errors
    (tmp_path / "right.json.gz").write_bytes(gzip.compress(json.dumps(square()).encode()))
    code, output, _ = run(tmp_path / "right.json.gz")
    assert code == 0
    assert "PROVED" in output


def test_sums_over_triangles_do_not_grow():
    """Exact sums of fractions take quadratic time: 33 s for 12 800 triangles, 2 s if rounded."""
    stated = square()
    stated["mesh"]["boundary"] = [[0, 1 / 3, 0.7], [0], [0], [0]]
    stated["mesh"]["triangles"] = [[0, 1, 5], [1, 2, 4], [2, 3, 4], [1, 4, 5]]
    stated["v"] = [0, 0, 0, 0.5, 1, 0.5]
    stated["flux"] = [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 0, 0, 1, 1]
    stated["trace"] = [2] * 12
    certificate = check.Certificate(stated)
    w = certificate.boundary_values(certificate.boundary_edges())
    D2 = certificate.sums(w)[2]
    # y = 2 - v at the boundary, so D^2 is no multiple of 1/UNITS^2 unless it is rounded
    assert check.UNITS**2 % D2.denominator == 0


SEEDS = (*range(12), 21, 97, 2073)
"""21 and 97 have b, and a large and a tiny c. The last one has a single triangle, with two free edges."""


@cache
def recompute(seed):
    return Recomputed(random_certificate(seed))


@pytest.mark.parametrize("seed", SEEDS)
def test_both_bounds_agree_with_their_definitions(seed):
    """Not below them, up to the 28 digits of this comparison, and above by less than 1e-15."""
    certificate = random_certificate(seed)
    expected = recompute(seed)
    for bound, exact in zip(check.Certificate(certificate).bounds(), (expected.X, expected.L), strict=True):
        assert exact * (1 - Decimal("1e-26")) <= decimal(bound) <= exact * (1 + Decimal("1e-15"))


def test_the_comparison_notices_a_change_of_one_number_by_1e_9():
    certificate = random_certificate(0)
    certificate["flux"][0] *= 1 + 1e-9
    changed, _ = check.Certificate(certificate).bounds()
    assert abs(decimal(changed) / recompute(0).X - 1) > Decimal("1e-15")


def test_random_certificates_have_all_that_the_definitions_compute():
    certificates = [random_certificate(seed) for seed in SEEDS]
    kinds = {kind for stated in certificates for side in stated["problem"]["sides"] for kind in side}
    assert kinds == {"contact", "free", "clamped"}
    assert {"field" in stated for stated in certificates} == {False, True}
    assert any(stated["problem"]["c"] == "0" for stated in certificates)
    assert any(len(stated["mesh"]["triangles"]) == 1 for stated in certificates)
    problems = [stated["problem"] for stated in certificates]
    ratios = [float(Fraction(problem["c"]) / Fraction(problem["k"])) for problem in problems]
    assert 0 < min(filter(None, ratios)) < 1e-25 < 1e5 < max(ratios)


def test_each_of_the_bounds_is_the_least_somewhere():
    """Of those on a triangle, of the two C, if both are there, and of the two S."""
    all_parts = [recompute(seed) for seed in SEEDS]
    assert any({False, True} <= set(all_part.is_by_parts) for all_part in all_parts)
    constants = [all_part.constants for all_part in all_parts if max(all_part.constants).is_finite()]
    assert {field < reaction for field, reaction in constants} == {False, True}
    pairs = [pair for all_part in all_parts for pair in all_part.S if max(pair).is_finite()]
    assert {with_C < with_c for with_C, with_c in pairs} == {False, True}


@pytest.mark.parametrize(
    ("text", "replacement"),
    [
        ("is_linear and ratio * d2 > 1", "False"),
        ("is_linear and ratio * d2 > 1", "ratio * d2 > 1"),
        ("C = min(constants)", "C = constants[0]"),
        ("min(pair) if c else pair[0]", "pair[1] if c else pair[0]"),
    ],
)
def test_the_comparison_notices_a_choice_that_is_not_made(text, replacement):
    """Control: some seed has another bound if the least one is not taken, or one where it is none."""
    changed = checker((text, replacement))
    changes = []
    for seed in SEEDS:
        stated = random_certificate(seed)
        pairs = zip(changed.Certificate(stated).bounds(), check.Certificate(stated).bounds(), strict=True)
        changes += [abs(bound / genuine - 1) for bound, genuine in pairs]
    assert max(changes) > 1e-9


def test_comments_in_formulas_are_refused():
    """`0 # + 100*x` is 0, and the checker prints the text as the f of the problem that it proved."""
    with sentences.raises(check_formulas.Refused):
        check_formulas.Formula("0 # + 100*x")
    assert check_formulas.Formula("0 + 100*x").degree == 1


def test_messages_say_what_would_be_right():
    without_field = square()
    without_field["problem"]["c"] = "0"
    without_field["problem"]["sides"][3] = {"clamped": without_field["problem"]["sides"][3]["contact"]}
    assert refusal(without_field) == "field: it is needed if c is 0"
    without_clamped = square()
    without_clamped["problem"]["c"] = "0"
    assert "c may be 0 if a side is clamped" in refusal(without_clamped)
    unknown = square()
    unknown["problem"]["sides"][0] = {"obstacle": []}
    assert refusal(unknown) == "sides: ['obstacle'] is not contact, free or clamped"


def test_a_second_file_is_not_passed_over(tmp_path):
    """`check.py *.json` would end with 0 although it has read the first of them only."""
    (tmp_path / "first.json").write_text(json.dumps(square()))
    (tmp_path / "second.json").write_text("no certificate")
    code, output, errors = run(tmp_path / "first.json", tmp_path / "second.json")
    assert (code, output) == (2, "")
    assert "usage" in errors
    assert run()[0] == 2
    assert run(tmp_path / "first.json")[0] == 0


def test_texts_of_any_alphabet_are_refused_on_a_terminal_of_ascii(tmp_path):
    """Python writes to such a terminal strictly: there was a traceback."""
    for place in ("k", "f", "polygon", "sides"):
        certificate = square()
        certificate["problem"][place] = {"polygon": [["\u03c0", "0"]] * 4, "sides": [{"\u03c0": []}] * 4}.get(
            place, "\u03c0"
        )
        (tmp_path / "greek.json").write_text(json.dumps(certificate))
        for program in (CHECKER, CHECKER.with_name("check_formulas.py")):
            command = [sys.executable, "-S", program, tmp_path / "greek.json"]
            environment = {"PYTHONIOENCODING": "ascii"}
            done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
            assert (done.returncode, done.stderr) == (1, "")
            assert done.stdout.startswith("REFUSED")
