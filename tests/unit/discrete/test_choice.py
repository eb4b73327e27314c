"""What is too large for the memory is refused before it is made, and who takes multigrid; by hand."""

import pytest
import sentences

from unilateral.discrete import choice
from unilateral.discrete.choice import (
    CHEAP_BOUND_BYTES,
    DENSE_ENTRY_BYTES,
    MIN_MULTIGRID_UNKNOWNS,
    MULTIGRID_BYTES,
    SHARP_BOUND_BYTES,
    SPARSE_BYTES,
    bound_memory_mb,
    wants_multigrid,
)
from unilateral.errors import InputError
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.solvers.stop import Stop

MB = 2**20


def test_a_size_is_refused_where_even_multigrid_takes_more_than_is_free(monkeypatch):
    """10^4 unknowns with h = 1/100 on the unit square; at a quarter of that memory twice the h is said."""
    needed = MULTIGRID_BYTES * 10_000 / MB
    monkeypatch.setattr(choice, "available_mb", lambda: 1.001 * needed)
    choice.check_mesh_memory(square(), 1 / 100)
    monkeypatch.setattr(choice, "available_mb", lambda: needed / 4)
    with sentences.raises(InputError):
        choice.check_mesh_memory(square(), 1 / 100)


def test_condensing_is_refused_where_its_matrices_take_more_than_is_free(monkeypatch):
    """81 unknowns, 32 of them and 16 cells on the boundary, whose matrices are dense."""
    mesh = make_structured_mesh(square(), 1 / 8)
    cells = partitions.make_uniform_partition(square(), 1 / 4)
    needed = (SPARSE_BYTES * 81 + DENSE_ENTRY_BYTES * (32 + 16) ** 2) / MB
    monkeypatch.setattr(choice, "available_mb", lambda: 1.001 * needed)
    choice.check_condensing_memory(mesh, cells)
    monkeypatch.setattr(choice, "available_mb", lambda: 0.999 * needed)
    with sentences.raises(InputError):
        choice.check_condensing_memory(mesh, cells)


def test_bounds_take_memory_for_each_unknown():
    mesh = make_structured_mesh(square(), 1 / 8)
    assert bound_memory_mb(mesh, sharp=False) == CHEAP_BOUND_BYTES * 81 / MB
    assert bound_memory_mb(mesh, sharp=True) == SHARP_BOUND_BYTES * 81 / MB


@pytest.mark.parametrize(
    ("stop", "unknowns", "expected"),
    [
        (Stop(), MIN_MULTIGRID_UNKNOWNS, True),
        (Stop(), MIN_MULTIGRID_UNKNOWNS - 1, False),
        (Stop(rho=0.1), 1e6, False),
        (Stop(algorithm="uzawa"), 1e6, False),
        (Stop(algorithm="multigrid"), 1, True),
    ],
)
def test_multigrid_is_tried_where_it_pays_or_is_asked_for(stop, unknowns, expected):
    assert wants_multigrid(stop, unknowns) == expected
