"""What is not known of a gap counts in the distance of v from u, and in the residual of v."""

import numpy as np
import pytest
import scipy.sparse as sp

from unilateral.fem.rounded import Rounded
from unilateral.solvers import feasible_discrete as module
from unilateral.solvers.feasible_discrete import feasible


def test_a_gap_at_the_end_of_its_doubt(monkeypatch):
    """Nothing but a gap: u = lambda = load = 0. The gap that is computed is -1, the true one is -1 - doubt.

    v is 1 + doubt there and not 1, so ||v||_1 + ||u - v||_1 is 2 (1 + doubt) ||hat||_1. That is attained
    up to rounding; with the doubt counted once it would be missed.
    """
    doubt, A = 0.25, sp.csr_array(np.array([[2.0, -1.0, 0.0], [-1.0, 3.0, -1.0], [0.0, -1.0, 2.0]]))
    monkeypatch.setattr(module, "constrained", lambda *_: Rounded(np.array([-1.0]), np.array([doubt])))
    B, zero = sp.csr_array(np.array([[0.0, 1.0, 0.0]])), np.zeros(3)
    residual, norm = feasible(A, A.sum(axis=1), zero, B, np.ones(1), np.array([1]), zero, np.zeros(1))
    dual = np.sqrt(residual.values @ np.linalg.solve(A.toarray(), residual.values))
    assert dual + norm == pytest.approx(2 * (1 + doubt) * np.sqrt(3), rel=1e-6)
    assert dual + norm >= 2 * (1 + doubt) * np.sqrt(3)
