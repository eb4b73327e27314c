"""What is too large for the memory is refused before it is made, and who takes multigrid; by hand."""

import pytest
import sentences

from unilateral.discrete import choice
from unilateral.discrete.choice import DENSE, LOCAL, MULTIGRID, PAYS, SHARP, SPARSE, bound_mb, wants_multigrid
from unilateral.errors import InputError
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import structured
from unilateral.solvers.stop import Stop

MB = 2**20


def test_a_size_is_refused_where_even_multigrid_takes_more_than_is_free(monkeypatch):
    """10^4 unknowns with h = 1/100 on the unit square; at a quarter of that memory twice the h is said."""
    needed = MULTIGRID * 10_000 / MB
    monkeypatch.setattr(choice, "available_mb", lambda: 1.001 * needed)
    choice.check_size(square(), 1 / 100)
    monkeypatch.setattr(choice, "available_mb", lambda: needed / 4)
    with sentences.raises(InputError):
        choice.check_size(square(), 1 / 100)


def test_condensing_is_refused_where_its_matrices_take_more_than_is_free(monkeypatch):
    """81 unknowns, 32 of them and 16 cells on the boundary, whose matrices are dense."""
    mesh = structured(square(), 1 / 8)
    cells = partitions.uniform(square(), 1 / 4)
    needed = (SPARSE * 81 + DENSE * (32 + 16) ** 2) / MB
    monkeypatch.setattr(choice, "available_mb", lambda: 1.001 * needed)
    choice.check_condensed(mesh, cells)
    monkeypatch.setattr(choice, "available_mb", lambda: 0.999 * needed)
    with sentences.raises(InputError):
        choice.check_condensed(mesh, cells)


def test_bounds_take_memory_for_each_unknown():
    mesh = structured(square(), 1 / 8)
    assert bound_mb(mesh, sharp=False) == LOCAL * 81 / MB
    assert bound_mb(mesh, sharp=True) == SHARP * 81 / MB


@pytest.mark.parametrize(
    ("stop", "unknowns", "wanted"),
    [
        (Stop(), PAYS, True),
        (Stop(), PAYS - 1, False),
        (Stop(rho=0.1), 1e6, False),
        (Stop(algorithm="uzawa"), 1e6, False),
        (Stop(algorithm="multigrid"), 1, True),
    ],
)
def test_multigrid_is_tried_where_it_pays_or_is_asked_for(stop, unknowns, wanted):
    assert wants_multigrid(stop, unknowns) == wanted
