"""Conjugate gradients whose matrix rounding has spoilt."""

import numpy as np
import scipy.sparse as sp

from unilateral.fem import linear_systems


def test_a_step_whose_curvature_is_hidden_is_none():
    """Where p . A p is not above 0."""
    run = linear_systems.Descent(sp.csr_array(-np.eye(2)), np.ones(2), np.zeros(2), np.copy)
    assert (run.step(), run.rz) == (0.0, 0.0)
    assert run.x.tolist() == [0, 0]
