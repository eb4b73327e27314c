"""A mesh of one's own as the coarsest one of a search: it is refined, and the accuracy is certified."""

import numpy as np
import pytest
import sentences

import unilateral as ul
from unilateral.adaptive.goal import Goal
from unilateral.adaptive.loop import make_first_mesh
from unilateral.errors import InputError
from unilateral.geometry.files import write_mesh
from unilateral.geometry.mesh import make_unstructured_mesh
from unilateral.geometry.polygon import Polygon, square

OWN = make_unstructured_mesh(square(), 1 / 3)
HALF = ul.mesh([(0, 0), (1, 0), (0, 1)], [(0, 1, 2)])
GOAL = Goal(accuracy=0.1)


def places(points):
    return {*map(tuple, points.tolist())}


def test_the_cells_of_the_first_mesh_are_the_edges_of_the_own_one():
    """Of a fan of triangles with edges of many lengths, too; each cell has its midpoint as a node."""
    rng = np.random.default_rng(5)
    t = np.sort(rng.uniform(0, 1, 5))
    ring = [(0, 0), *((x, 0) for x in t), (1, 0), (1, 1), *((0.6, 1), (0.1, 1)), (0, 1)]
    n = len(ring)
    fan = ul.mesh([*ring, (0.5, 0.4)], [(i, (i + 1) % n, n) for i in range(n)])
    for mesh in (OWN, fan):
        first = make_first_mesh(mesh.polygon, GOAL, mesh)
        np.testing.assert_allclose(first.partition.points, mesh.s, rtol=0, atol=1e-15)
        np.testing.assert_array_equal(np.bincount(first.cell), 2)
        assert first.mesh.n_nodes == len(places(first.mesh.points) | places(mesh.points))


@pytest.mark.parametrize(("norm", "accuracy"), [("h1", 0.02), ("hm12", 0.002)])
def test_an_own_mesh_is_refined_to_a_certified_accuracy(norm, accuracy):
    """For a known solution the bound is above the error; all nodes of the own mesh stay."""
    case = ul.case("natural")
    s = ul.solve(case, mesh=OWN, accuracy=accuracy, norm=norm)
    assert s.certified
    assert places(OWN.points) <= places(s.mesh.points)
    assert len(s.search.levels) > 1
    assert s.search.levels[0].unknowns == 2 * OWN.n_nodes + len(OWN.triangles) - 1
    assert s.errors.h1 <= s.bounds.u
    assert s.errors.hm12_upper <= s.sharp_bounds.multiplier


def test_rounded_nodes_are_moved_onto_the_sides_of_the_problem():
    turn = np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    polygon = Polygon(square().vertices @ turn, "turned")
    mesh = ul.mesh(np.round(OWN.points @ turn, 9), OWN.triangles, polygon=polygon)
    s = ul.solve(ul.Problem(polygon, "3*x - 2", "-y/4"), mesh=mesh, accuracy=0.1)
    assert s.certified
    np.testing.assert_array_equal(s.mesh.polygon.vertices, polygon.vertices)


@pytest.mark.parametrize(
    "options",
    [
        {"max_unknowns": 40},
        {"h": 1 / 8},
        {"H": 1 / 8},
        {"mesh": ul.mesh([(0, 0), (1, 0), (0, 1)], [(0, 1, 2)])},
    ],
    ids=lambda options: next(iter(options)),
)
def test_what_does_not_fit_is_refused(options):
    with sentences.raises(InputError):
        ul.solve(**{"problem": ul.case("natural"), "mesh": OWN, "accuracy": 0.1} | options)


def test_a_plan_can_be_made_from_an_own_mesh():
    s = ul.solve(ul.case("natural"), mesh=OWN, accuracy=1e-3, dry_run=True)
    assert s.search.plan.unknowns > 1000


def test_the_command_refines_the_mesh_of_a_file(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_mesh(OWN, "own.msh")
    code, out, err = run("solve", "natural", "--mesh", "own.msh", "--accuracy", "0.1")
    assert (code, err) == (0, "")
    assert "  certified: ||u - u_h||_1 <= " in out
    assert run("solve", "natural", "--mesh", "own.msh", "--H", "1/2")[0] == 0
