"""What the complementarity term counts in both bounds."""

import numpy as np
import pytest
from test_sharp_bounds import LINEAR_SOURCE, Manufactured, enclosed

from unilateral.bounds import feasible
from unilateral.bounds.local_bounds import local_bound
from unilateral.bounds.sharp_bounds import sharp_bound
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import structured


@pytest.mark.parametrize("bound", [local_bound, sharp_bound])
def test_the_slack_counts_twice_for_u(bound, monkeypatch):
    """R has 2 <sigma, u_h + d - g> in it, and X^2 <= R + D^2: a slack of 1/2 more adds 1 to the square for u.

    D is small here against eta, so that nothing is taken off again.
    """
    problem, mesh = Manufactured(square(), LINEAR_SOURCE), structured(square(), 1 / 4)
    cells, own, found = partitions.uniform(square(), 1 / 2), feasible.missing, []
    data = enclosed(mesh, problem), problem.enclosed(), cells
    u_h, lambda_H = problem.u(*mesh.points.T), np.full(cells.n_cells, 0.5)
    for more in np.array([[0.0], [0.5]]) / len(mesh.boundary):
        monkeypatch.setattr(feasible, "missing", lambda *a, s=more: own(*a)._replace(slack=own(*a).slack + s))
        found.append(bound(*data, u_h, lambda_H))
    assert all(each.lifting < 0.2 for each in found)
    assert (found[1].u - found[1].data) ** 2 - (found[0].u - found[0].data) ** 2 == pytest.approx(1, rel=1e-6)


@pytest.mark.parametrize("bound", [local_bound, sharp_bound])
def test_what_is_missing_counts_for_u_by_its_norm(bound, monkeypatch):
    """X^2 <= R + D^2: where D is larger, and R as before, the square for u has the difference of both D^2."""
    problem, mesh = Manufactured(square(), LINEAR_SOURCE), structured(square(), 1 / 4)
    cells, own, found = partitions.uniform(square(), 1 / 2), feasible.missing, []
    data = enclosed(mesh, problem), problem.enclosed(), cells
    u_h, lambda_H = problem.u(*mesh.points.T), np.full(cells.n_cells, 0.5)
    for more in (0.0, 0.01):
        monkeypatch.setattr(
            feasible, "missing", lambda *a, s=more: own(*a)._replace(squares=own(*a).squares + s)
        )
        found.append(bound(*data, u_h, lambda_H))
    before, after = ((each.u - each.data) ** 2 - each.lifting**2 for each in found)
    assert after == pytest.approx(before, rel=1e-6)
    assert found[1].lifting > found[0].lifting + 0.1
