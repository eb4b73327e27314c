"""A right solver and its bugs, planted one at a time: `score` names the right one, or says that it does not know.

The solver is `author`, which reads the exported files alone. `NAMED` is what a bug is called; the tables say
what is told of it for each case, on h = 1/16 and H = 1/8 (`own`: with free sides, h = 1/8, H = 1/4):

    named    the bug, and nothing else
    either   the bug, or others that have left the same files behind
    ?        that no bug that is known explains it
    remark   that the solution is right, and that its load is another one
    -        nothing: the solution is right, or differs by less than what counts
    refused  that the files cannot be read
"""

import author
import pytest
from conftest import ROOT

from unilateral.cli import main
from unilateral.errors import InputError
from unilateral.exchange.read import Foreign, exported, foreign
from unilateral.exchange.faults import judged
from unilateral.exchange.score import score

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
    "g zero": "g is taken for 0",
    "conditions turned around": "the conditions are turned around",
}
CASES = ("natural", "thirds", "full_contact", "smooth", "own")
UNKNOWN = "no bug that is known explains it"


def outcome(bug, found):
    """One of the words above, or the fault that is none of them."""
    if not found.faults:
        assert len(found.remarks) <= 1
        return "remark" if found.remarks and found.remarks[0].startswith(NAMED[bug]) else "".join(found.remarks) or "-"
    told = [what_of(bug, fault.what) for fault in found.faults]
    return next((each for each in told if each not in ("named", "either", "?")), None) or min(
        told, key=["?", "either", "named"].index
    )


def what_of(bug, what):
    if UNKNOWN in what:
        return "?"
    options = what.split("; or ")
    if not any(each.startswith(NAMED[bug]) for each in options):
        return f"wrong: {what}"
    return "named" if len(options) == 1 else "either"
