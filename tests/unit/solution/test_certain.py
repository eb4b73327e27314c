"""What users see of certain contact: words, records, columns and forces."""

import copy
import pickle

import meshio
import numpy as np
import pytest
from sentences import recorder

import unilateral as ul
from unilateral.bounds.certain_contact import CertainArc, Verdict
from unilateral.geometry.partition import make_uniform_partition
from unilateral.geometry.polygon import Polygon
from unilateral.solution.contact import Contact, describe_certain_arcs

SEAL = "examples/seal.yaml"
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]


@pytest.fixture(scope="module")
def seal():
    return ul.solve(ul.load(SEAL), h=0.6 / 32, H=0.6 / 16)


def make_arcs(*pieces):
    """Arcs of side 0 from pairs of an end and a verdict."""
    ends = [0.0, *(end for end, _ in pieces)]
    return [
        CertainArc(0, start, end, verdict) for start, (end, verdict) in zip(ends[:-1], pieces, strict=True)
    ]


def test_what_is_said_of_a_side():
    """Arcs that touch in a row are told together; more than four of a kind are counted."""
    touches, free, undecided = Verdict
    for pieces in (
        [(1.0, free)],
        [(1.0, undecided)],
        [(0.25, touches), (0.5, touches), (0.75, undecided), (1.0, free)],
        [(i / 12, touches if i % 2 else free) for i in range(1, 13)],
    ):
        recorder.check(describe_certain_arcs(make_arcs(*pieces)))


def test_cells_and_records_say_the_same(seal, tmp_path):
    """1 where an arc that touches meets a cell, -1 where a cell lies in a free arc, in all files."""
    certain = seal.contact.certain
    values = seal.contact.certain_cells
    assert {-1, 0, 1} == set(values.tolist())
    middle = 0.5 * (seal.partition.points[1:] + seal.partition.points[:-1])
    for arc in certain:
        inside = (middle > arc.start) & (middle < arc.end) & (seal.partition.side == arc.side)
        if arc.verdict is Verdict.TOUCHES:
            assert np.all(values[inside] == 1)
        elif arc.verdict is Verdict.FREE:
            assert np.all(values[inside][1:-1] == -1)
    assert np.all(values[seal.partition.side != 0] == 0)
    assert seal.cells()["certain"].tolist() == values.tolist()
    seal.save(tmp_path / "seal.vtu")
    assert {-1, 0, 1} <= set(np.unique(meshio.read(tmp_path / "seal.vtu").cell_data["certain_contact"][1]))
    assert seal.certificate()["contact"]["certain"] == [arc._asdict() for arc in certain]


def test_it_is_copied_and_pickled(seal):
    assert pickle.loads(pickle.dumps(seal)).contact.certain == seal.contact.certain
    assert copy.deepcopy(seal).contact.certain == seal.contact.certain


def test_nothing_is_certain_where_no_bounds_are_known(seal, monkeypatch):
    """As where bounds contradict each other."""
    monkeypatch.setattr("unilateral.solution.contact.has_consistent_bounds", lambda _: False)
    arc = CertainArc(0, 0.0, 0.6, Verdict.UNDECIDED)
    assert Contact(seal.partition, seal.multiplier).certain == []
    assert copy.copy(seal).__class__(seal.problem, seal.solved).contact.certain == [arc]


def test_a_side_that_does_not_touch_by_the_data_has_no_force():
    """f = 1 and c = 1: u >= 1, so g = 0.5 is not touched; and the whole force is known better."""
    problem = ul.Problem(SQUARE, 1, [0.5, "0.5 + 4*y*(1 - y)", 0.5, 0.5])
    assert problem.idle_sides() == (0, 2, 3)
    s = ul.solve(problem, h=1 / 8, H=1 / 4)
    free = [arc for arc in s.contact.certain if arc.side != 1]
    assert free == [CertainArc(side, 0.0, 1.0, Verdict.FREE) for side in (0, 2, 3)]
    forces = s.forces()
    assert forces.sides[0] == forces.sides[2] == forces.sides[3] == (0.0, 0.0, 0.0)
    assert s.force(sides=[2]) == (0.0, 0.0, 0.0)
    assert forces.sides[1].lower <= forces.whole.value <= forces.sides[1].upper


def test_a_free_side_is_in_no_arc():
    """Nor is a clamped one."""
    polygon = Polygon(SQUARE)
    assert Contact(make_uniform_partition(polygon, 0.5), np.zeros(8)).certain_cells.tolist() == [0] * 8
    problem = ul.Problem(SQUARE, -1, [0, None, None, None], free_sides=(1, 3), c=0, u={2: 1})
    assert {arc.side for arc in ul.solve(problem, h=1 / 8, H=1 / 4).contact.certain} == {0}
