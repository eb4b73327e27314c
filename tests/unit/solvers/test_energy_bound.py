"""The energy bound where means of u(mu) lie below g: the constant that lifts them counts with its norm."""

import numpy as np
import pytest
from conftest import coupled

from unilateral.solvers.active_set import active_set
from unilateral.solvers.uzawa import energy_bound


@pytest.mark.parametrize("polygon", ["square", "lshape"])
@pytest.mark.parametrize("a", [1.0, 1e-3])
def test_a_lift_by_a_constant_has_the_norm_of_that(polygon, a):
    """f = 0, g = a and mu = 0: u(mu) = 0, v = a, and the bound is a |Omega|^{1/2}; the true error is not 0.

    That is ||lambda_H||_{-1/2,h}. v = a is feasible, so that it is not larger.
    """
    operator = coupled(polygon, 8, 4).operator
    offset, area = np.full(len(operator.H_i), -a), {"square": 1.0, "lshape": 3.0}[polygon]
    found = energy_bound(operator, offset, np.zeros(len(offset)))
    assert found == pytest.approx(a * np.sqrt(area), rel=1e-12)
    lambda_H = active_set(operator, offset, 1e-8).lambda_H
    assert 0.5 * found < np.sqrt(lambda_H @ operator.D @ lambda_H) <= found
