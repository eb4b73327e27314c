"""The small mesh on which forces are bounded: how large it is, and where it is fine."""

import numpy as np
import pytest

from unilateral.bounds import forces
from unilateral.bounds.forces import LIGHT, MOST
from unilateral.fem.p1 import coupling
from unilateral.geometry import mesh as meshes
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import Polygon, named, square
from unilateral.geometry.structured import structured

KITE = np.array([[0, 0], [1, 0], [1, 0.7], [0, 1.3]])


def small(mesh, cells, load):
    return forces.small_mesh(mesh, cells, load)


@pytest.mark.parametrize("kind", ["structured", "unstructured"])
def test_it_does_not_grow_with_the_mesh_of_the_solution(kind, monkeypatch):
    """If that is refined, or too large to begin with."""
    polygon = named("lshape") if kind == "structured" else Polygon(KITE, "kite")
    cells, sizes = partitions.uniform(polygon, 1 / 4), []
    load = np.where(cells.side < 2, 1e3, 0.0)
    for h in (1 / 16, 1 / 64, 1 / 128):
        mesh = structured(polygon, h) if kind == "structured" else meshes.unstructured(polygon, h)
        sizes.append(small(mesh, cells, load).n_nodes)
    assert max(sizes) < 2000
    assert sizes[1] == sizes[2]


def test_a_mesh_with_a_coarse_level_needs_no_gmsh(monkeypatch):
    mesh = meshes.refine(meshes.unstructured(Polygon(KITE, "kite"), 1 / 4))
    cells = partitions.uniform(mesh.polygon, 1 / 4)
    monkeypatch.setattr(meshes, "with_boundary", None)
    found = small(mesh, cells, np.ones(cells.n_cells))
    n = mesh.coarse.n_nodes
    assert np.array_equal(found.points[:n], mesh.coarse.points)


def test_it_is_halved_at_ends_until_loads_are_light():
    """A load of 100 on the lower side up to 3/4: there, at the vertex where it begins, and nowhere else."""
    cells = partitions.uniform(square(), 1 / 4)
    load = np.where((cells.side == 0) & (cells.points[:-1] < 0.75), 100.0, 0.0)
    found = small(structured(square(), 1 / 8), cells, load)
    nodes, edges = coupling(found, cells).T @ load, np.diff(found.s)
    at = [np.flatnonzero(found.s[:-1] == s)[0] for s in (0.0, 0.75)]
    assert np.all(nodes[at] <= LIGHT)
    assert min(edges[at]) <= 2 * LIGHT / 100
    uniform = edges[found.side == 2]
    assert np.all(uniform == uniform[0])
    assert uniform[0] > 1 / 32


def test_a_light_load_or_none_leaves_it_uniform():
    cells = partitions.uniform(square(), 1 / 4)
    for load in (0.0, 0.1):
        found = small(structured(square(), 1 / 8), cells, np.full(cells.n_cells, load))
        assert found.n_nodes == 17**2


def test_edges_at_the_boundary_of_a_large_polygon_are_halved():
    """Not so those inside."""
    polygon = Polygon(30 * KITE, "large")
    found = small(meshes.unstructured(polygon, 10), partitions.uniform(polygon, 10), np.zeros(14))
    assert found.h <= 1
    assert found.diameter > 2


@pytest.mark.parametrize("n", [4, 100])
def test_many_ends_of_contact_leave_it_small(n):
    """Load on every second one of 4 n cells, and far too much of it."""
    cells = partitions.uniform(square(), 1 / n)
    load = np.where(np.arange(cells.n_cells) % 2, 1e9, 0.0)
    found = small(structured(square(), 1 / 8), cells, load)
    assert len(found.boundary) <= MOST


def test_many_sides_leave_it_small():
    angle = 2 * np.pi * np.arange(400) / 400
    polygon = Polygon(np.column_stack([np.cos(angle), np.sin(angle)]), "many")
    cells = partitions.uniform(polygon, 1.0)
    mesh = meshes.with_boundary(polygon, partitions.refine(cells, 2).points[:-1], 0.2)
    assert mesh.n_nodes > forces.LARGE
    found = small(mesh, cells, np.full(400, 1e9))
    assert len(found.boundary) <= MOST
    assert found.n_nodes < mesh.n_nodes


@pytest.mark.parametrize("place", [1e6, 1e9, 2.0**30])
def test_it_is_not_halved_where_rounding_shows(place):
    """Far from the origin, on slanted sides, and on such between dyadic places, whose nodes are exact."""
    polygon = Polygon((KITE if place != 2.0**30 else np.round(KITE)) + place, "far")
    cells = partitions.uniform(polygon, 1 / 2)
    of, space = forces.condensed(meshes.unstructured(polygon, 1 / 4), cells, np.full(cells.n_cells, 1e6))
    assert space is not None
    assert of.growth < 1 + 1e-4
