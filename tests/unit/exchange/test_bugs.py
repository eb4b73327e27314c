"""A right solver and its bugs, planted one at a time: `score` names the right one, or does not know.

The solver is `author`, which reads the exported files alone. `NAMED` is what a bug is called; the tables say
what is told of it for each case, on h = 1/16 and H = 1/8 (`own`: with free sides, h = 1/8, H = 1/4):

    named    the bug, and nothing else
    either   the bug, or others that have left the same files behind
    ?        that no known bug explains it
    remark   that the solution is right, and that its load is another one
    -        nothing: the solution is right, or differs by less than what counts
    refused  that the files cannot be read
"""

import re
from functools import cache
from typing import NamedTuple

import author
import numpy as np
import pytest
from conftest import ROOT

from unilateral.arrays import Array
from unilateral.cli import main
from unilateral.discrete.condensed import CondensedProblem, solve_condensed_problem
from unilateral.errors import InputError
from unilateral.exchange.boundary_function import piecewise_constant
from unilateral.exchange.diagnosis import diagnose_solution
from unilateral.exchange.exported_folder import (
    ExportedLevel,
    ForeignSolution,
    read_exported_folder,
    read_foreign_solution,
)
from unilateral.exchange.fault import UNEXPLAINED
from unilateral.exchange.score import solve_reference
from unilateral.norms.dual import Errors
from unilateral.problems.problem import Problem

pytestmark = pytest.mark.usefixtures("shared_cases")
NAMED = {
    "mass term missing": "the mass term (u, v) is missing",
    "load missing": "the load (f, v) is missing",
    "half load": "the load (f, v) has the wrong scale",
    "lambda negative": "the multiplier has the wrong sign",
    "lambda lumped": "the multiplier is lumped",
    "wrong corner": "the cells' arc length begins at vertex 1 and runs anticlockwise",
    "one side ignored": "side 0 is ignored",
    "g negative": "g has the wrong sign",
    "Dirichlet everywhere": "the conditions hold as equations",
    "nodes shuffled": "the values of u are right, but at other nodes",
    "stopped early": "the iteration stopped too early",
    "stopped early, behind": "the iteration stopped too early",
    "f at nodes": "the load is that of f interpolated at the nodes",
    "f at nodes, lumped": "the load is that of f at the nodes with the lumped mass matrix",
    "f at centroids": "the load is that of f at the centroids",
    "load negative": "the load (f, v) has the wrong sign",
    "mass term doubled": "the mass term (u, v) has the wrong scale",
    "matrix doubled": "the matrix of (u, v)_1 has the wrong scale",
    "areas doubled": "the triangles' areas are twice the right ones",
    "u doubled": "u has the wrong scale",
    "x and y exchanged": "x and y are exchanged",
    "lambda integrated": "the multiplier's values are",
    "reactions lumped to cells": "the multiplier is nodal reactions",
    "wrong corner of g": "the cells' arc length begins at vertex 1 and runs anticlockwise",
    "wrong corner of all": "the cells' arc length begins at vertex 1 and runs anticlockwise",
    "g zero": "g is taken as 0",
    "conditions turned around": "the conditions are reversed",
    "mass term added": "there is a mass term (u, v), but c = 0",
    "clamped side left free": "u is left free on the clamped side",
    "clamped values not set": "u is 0, not u_D, on the clamped side",
    "clamped node spoilt": "u is not u_D on the clamped side",
}
NO_SCALE = "the matrix of (grad u, grad v) has the wrong scale"
ALSO = {
    "matrix doubled": [NO_SCALE],
    "areas doubled": [NO_SCALE],
    "wrong corner of g": ["side 0 is ignored"],
    "wrong corner of all": ["side 0 is ignored"],
    "wrong corner": ["the multiplier is 0 everywhere"],
    "x and y exchanged": ["the multiplier is 0 everywhere"],
    "nodes shuffled": ["u is not u_D on the clamped side"],
}
"""What is as right to say if c = 0, or on sides that are clamped.

Without a mass term, areas are a factor of the matrix. Means of g that are counted from another corner leave a
side without any. A multiplier that comes to lie on a clamped side is not looked at.
"""
CASES = ("natural", "thirds", "full_contact", "smooth", "own", "clamped", "clamped_270", "clamped_90")
CELLS = """
right                        -         -         -         -         -         -         -         -
noise                        -         -         -         -         -         -         -         -
mass term missing            named     named     named     named     named     -         -         named
load missing                 named     named     named     named     named     named     named     named
half load                    named     either    named     either    either    named     named     named
lambda negative              named     named     named     named     named     named     named     named
wrong corner                 named     named     named     either    ?         named     named     named
one side ignored             named     named     named     named     named     named     -         named
g negative                   named     named     named     named     named     named     named     named
Dirichlet everywhere         named     named     -         named     named     named     named     named
nodes shuffled               named     ?         named     ?         ?         named     ?         named
stopped early                ?         ?         ?         ?         ?         ?         ?         ?
stopped early, behind        named     named     named     named     named     named     ?         named
f at nodes                   remark    remark    remark    remark    remark    remark    remark    remark
f at nodes, lumped           remark    remark    remark    remark    remark    remark    remark    remark
f at centroids               remark    remark    remark    remark    remark    remark    remark    remark
load negative                named     named     named     named     named     named     named     named
mass term doubled            named     named     named     named     named     -         -         named
matrix doubled               named     either    named     either    either    named     named     named
areas doubled                named     named     named     named     named     named     named     named
u doubled                    named     either    named     either    either    named     named     named
x and y exchanged            named     named     named     named     refused   named     refused   named
lambda integrated            named     named     named     named     named     named     named     named
wrong corner of g            named     named     named     either    ?         ?         ?         named
wrong corner of all          named     named     named     either    ?         ?         ?         named
g zero                       named     named     named     -         named     named     named     named
conditions turned around     either    named     either    named     named     named     named     named
mass term added              -         -         -         -         -         named     named     -
clamped side left free       -         -         -         -         -         named     ?         named
clamped values not set       -         -         -         -         -         named     -         -
clamped node spoilt          -         -         -         -         -         named     named     named
"""
"""u >= g in the means over cells; a column for each of the cases."""
NODES = """
right                        -         -         -         -         -         -         -         -
noise                        -         -         -         -         -         -         -         -
mass term missing            named     -         named     named     named     -         -         named
load missing                 named     named     named     named     named     named     named     named
half load                    named     either    named     either    either    named     named     named
lambda negative              named     named     named     named     named     named     named     named
lambda lumped                named     named     named     named     named     named     named     named
wrong corner                 ?         ?         ?         ?         ?         ?         ?         named
one side ignored             named     named     named     named     named     named     -         named
g negative                   named     named     named     named     named     named     named     named
Dirichlet everywhere         named     named     -         named     named     named     named     named
nodes shuffled               named     ?         named     ?         ?         named     ?         named
stopped early                ?         ?         ?         ?         ?         ?         ?         ?
stopped early, behind        named     ?         named     named     named     named     ?         named
f at nodes                   remark    remark    remark    remark    remark    remark    remark    remark
f at nodes, lumped           remark    remark    remark    remark    remark    remark    remark    remark
f at centroids               remark    remark    remark    remark    remark    remark    remark    remark
load negative                named     named     named     named     named     named     named     named
mass term doubled            named     -         named     named     named     -         -         named
matrix doubled               named     either    named     either    either    named     named     named
areas doubled                named     named     named     named     named     named     named     named
u doubled                    named     either    named     either    either    named     named     named
x and y exchanged            named     named     named     named     refused   named     refused   named
lambda integrated            named     named     named     named     named     named     named     named
reactions lumped to cells    named     named     named     named     named     named     named     named
wrong corner of g            ?         ?         ?         ?         ?         ?         ?         ?
wrong corner of all          ?         ?         ?         ?         ?         ?         ?         ?
g zero                       named     named     named     named     -         named     named     named
conditions turned around     either    named     either    named     named     named     named     named
mass term added              -         -         -         -         -         named     named     -
clamped side left free       -         -         -         -         -         named     ?         named
clamped values not set       -         -         -         -         -         named     -         -
clamped node spoilt          -         -         -         -         -         named     named     named
"""
"""u >= g at the nodes."""


def table(method):
    """Words by bug and case."""
    rows = [
        re.split(r"\s{2,}", line) for line in {"cells": CELLS, "nodes": NODES}[method].strip().split("\n")
    ]
    return {bug: dict(zip(CASES, words, strict=True)) for bug, *words in rows}


class SolvedLevel(NamedTuple):
    """A level of a case as this project and an author see it; `own_errors` are this project's errors."""

    case: Problem
    level: ExportedLevel
    discrete: CondensedProblem
    u_h: Array
    own_errors: Errors
    author: author.Level

    def diagnose(self, folder, bug, method):
        """What is told of the files that an author writes into a folder."""
        u, cells = author.solve_level(self.author, bug, method)
        files = [folder / name for name in ("u.csv", "cells.csv")]
        for file, columns in zip(files, (u, cells), strict=True):
            if columns is not None:
                columns.to_csv(file, index=False)
        foreign_solution = read_foreign_solution(
            [self.level], str(files[0]), None if cells is None else str(files[1])
        )
        return diagnose_solution(self.case, foreign_solution, self.discrete, self.own_errors, self.u_h)


@pytest.fixture(scope="module")
def exported_cases(tmp_path_factory):
    """Each case, exported and solved once."""

    @cache
    def export_case(name):
        folder = tmp_path_factory.mktemp(name) / "exported"
        options = ["--h", "1/16", "--H", "1/8"]
        if name == "own":
            polygon = folder.parent / "own.yaml"
            polygon.write_text("polygon: [[0, 0], [2, 0], [1/2, 3/2], [-1, 1]]\n")
            options = ["--polygon", str(polygon), "--free-sides", "2,3", "--h", "1/8", "--H", "1/4"]
        assert main(["export", "thirds" if name == "own" else name, *options, "--out", str(folder)]) == 0
        case, (level,) = read_exported_folder(folder)
        original = solve_reference(case, level)
        return SolvedLevel(
            case, level, original.discrete, original.u_h, original.errors, author.read(folder, level.name)
        )

    return export_case


def outcome(bug, computed):
    """One of the words above, or the sentence that none of them is for."""
    names = [NAMED[bug], *ALSO.get(bug, [])] if bug in NAMED else []
    if not computed.faults:
        remarks = ["remark" if any(map(remark.startswith, names)) else remark for remark in computed.remarks]
        return ", ".join(remarks) or "-"
    words = {_word(names, fault.description) for fault in computed.faults}
    known_words = [word for word in ("?", "either", "named") if word in words]
    return known_words[0] if len(known_words) == len(words) else str(words)


def name_diagnosis(example, folder, bug, method):
    """The word for what is told of a bug."""
    try:
        return outcome(bug, example.diagnose(folder, bug, method))
    except InputError as error:
        return "refused" if "another mesh" in str(error) else str(error)


def _word(names, subject):
    if UNEXPLAINED in subject:
        return "?"
    options = subject.split("; or ")
    if not any(option.startswith(name) for option in options for name in names):
        return subject
    return "named" if len(options) == 1 else "either"


@pytest.mark.parametrize("method", author.METHODS)
@pytest.mark.parametrize("name", CASES)
def test_a_bug_is_named_or_not_known(exported_cases, tmp_path, name, method):
    """No bug is taken for another one, and nothing is said against a right solution."""
    expected = {bug: words[name] for bug, words in table(method).items()}
    assert {bug: name_diagnosis(exported_cases(name), tmp_path, bug, method) for bug in expected} == expected
    assert expected.keys() >= NAMED.keys() - {"lambda lumped", "reactions lumped to cells"}


@pytest.mark.parametrize("method", author.METHODS)
def test_what_is_not_named_says_what_it_may_be(exported_cases, tmp_path, method):
    """An iteration that stopped early is a right solution for another g, so that nobody can tell."""
    (fault,) = exported_cases("natural").diagnose(tmp_path, "stopped early", method).faults
    assert "the iteration stopped too early, or g or the contact conditions differ" in fault.description


def test_every_name_is_in_the_documents():
    """The table of bugs says what they are called."""
    text = (ROOT / "docs/own-solver.md").read_text()
    assert [name for name in (*NAMED.values(), NO_SCALE) if name not in text] == []


def diagnose_values(example, u, multiplier):
    """The diagnosis of nodal values and a multiplier, or None, on the level of an exported case."""
    return diagnose_solution(
        example.case,
        ForeignSolution("", example.level, u, multiplier, ""),
        example.discrete,
        example.own_errors,
        example.u_h,
    )


def test_no_bug_is_named_by_chance(exported_cases):
    """Random residuals of any size are explained by none; noise below what counts is no fault.

    Nor does any explain u + c beside the right multiplier, or u = 0: no matrix or load of the table has them.
    """
    example = exported_cases("natural")
    random = np.random.default_rng(3)
    for size in (1e-12, 1e-6, 1e-3, 1.0):
        u = example.u_h + size * random.standard_normal(len(example.u_h))
        diagnosis = diagnose_values(example, u, None)
        assert all(not fault.is_explained for fault in diagnosis.faults)
        assert bool(diagnosis.faults) == (size >= 1e-3)
        assert diagnosis.remarks == []
    right = piecewise_constant(example.level.partition, solve_condensed_problem(example.discrete).lambda_H)
    for u in (example.u_h + 0.3, example.u_h + 1, example.u_h - 0.5, 0 * example.u_h):
        diagnosis = diagnose_values(example, u, right)
        assert [fault.is_explained for fault in diagnosis.faults] == [False]


def test_without_a_multiplier_another_bug_may_have_left_the_same_inside(exported_cases):
    """As docs/own-solver.md says of u + 1: Delta u is 16, so that -(1 + 1/16) Delta u + u + 1 = f.

    The printed factor may be off by the discretisation error of u_h, which is of order h^2 inside.
    """
    example = exported_cases("natural")
    diagnosis = diagnose_values(example, example.u_h + 1, None)
    (fault,) = diagnosis.faults
    assert fault.description == "the stiffness term (grad u, grad v) has the wrong scale"
    assert float(fault.detail.split()[0]) == pytest.approx(1 + 1 / 16, abs=1 / 16**2)


def test_two_bugs_at_once_are_both_named_if_they_explain_all(exported_cases, tmp_path):
    """One inside and one of the multiplier; with one that nobody knows in its place neither is."""
    example = exported_cases("natural")
    u, cells = author.solve_level(example.author, "mass term missing")
    level = example.level
    for multiplier, explained in ((-cells.multiplier, [True, True]), (cells.multiplier + 1, [False])):
        mu = piecewise_constant(level.partition, multiplier.to_numpy())
        diagnosis = diagnose_values(example, u.u.to_numpy(), mu)
        assert [fault.is_explained for fault in diagnosis.faults] == explained


def test_a_fault_of_all_levels_is_told_once(tmp_path, capsys):
    """With the place where u is farthest below g: the exact u is g for x > 1/2, where the side is ignored."""
    folder = str(tmp_path / "natural")
    assert main(["export", "natural", "--h", "1/16", "--H", "1/8", "--levels", "2", "--out", folder]) == 0
    out = {}
    for bug in ("", "mass term missing", "one side ignored"):
        words = []
        for level in ("level_0", "level_1"):
            u, cells = author.solve_level(author.read(folder, level), bug)
            u.to_csv(tmp_path / f"{level}.csv", index=False)
            cells.to_csv(tmp_path / f"{level}_cells.csv", index=False)
            words += [str(tmp_path / f"{level}.csv"), "--multiplier", str(tmp_path / f"{level}_cells.csv")]
        capsys.readouterr()
        assert main(["score", folder, *words]) == bool(bug)
        out[bug] = capsys.readouterr().out
    assert "solutions: " not in out[""]
    assert out["mass term missing"].count("mass term (u, v) is missing") == 1
    assert "all 2 solutions: the mass term (u, v) is missing: " in out["mass term missing"]
    assert "all 2 solutions: side 0 is ignored: " in out["one side ignored"]
    matches = re.findall(
        r"level_1, over the cells: min mean\(u - g\) = (\S+) at \((\S+), (\S+)\) on side (\d)",
        out["one side ignored"],
    )
    ((minimum, x, y, side),) = matches
    assert float(minimum) < -0.1
    assert (float(x) > 0.5, float(y), side) == (True, 0, "0")
