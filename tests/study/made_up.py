"""Tables that are made up to test the checks of the ledger, and what a check observes of one.

The controls of the ledger spoil the study's own tables; here numbers are so few that the finding is known. In
the tests of an experiment's checks a row has a check, the table that stands for all those it asks for, and
what it observes: a number and perhaps whether it holds, or the reason why it does not judge. A check is a
claim's, with the parameters that are declared there, or a function with other ones. That a bad number fails
is what the controls show; there something is left out, weighed or not judged, too.
"""

import math
from collections import defaultdict

import numpy as np
import pytest
import xarray as xr

from study.evidence import Unjudged
from study.ledger import claims

NAN = math.nan
INF = math.inf
DIMS = {
    "case mesh partition": "h1_error l2_error hm12_best hm12_error_lower hm12_error_upper discrete_error "
    "ritz_means iterations tolerance",
    "case mesh": "ritz_error u_norm interpolation_error ritz_boundary_error",
    "case partition": "projection_error consistency consistency_elsewhere",
    "mesh partition": "h_over_H beta_lower beta_upper beta_0 beta_fortin beta_0_cellwise beta_0_certified "
    "lambda_min lambda_max cell_over_edge edges_per_cell smallest_angle delta alpha_1 pairing",
    "case": "saddle_in_v saddle_in_mu multiplier_factor diagonal oscillation flux_order gap_order",
    "mesh": "with_A with_A_3 h",
    "partition": "H",
    "case cell": "lambda_means gap_means",
    "functional functional_too": "norm_lower norm_upper",
    "point": "axis_of value outcome tool true_error guaranteed allowance measured predicted points",
    "axis": "predicted_limit measured_limit predicted_tool_limit measured_tool_limit",
    "level alpha gamma position": "held",
}
DIM = {name: dims.split() for dims, names in DIMS.items() for name in names.split()}
"""The dimensions of variables, by their names in the study's tables."""


def table(**variables):
    """One table by whatever name a check asks for; of other dimensions than in DIM values are a pair."""
    fields = {
        name: variable
        if isinstance(variable, tuple)
        else (DIM.get(name, [name] if np.ndim(variable) else []), variable)
        for name, variable in variables.items()
    }
    coords = xr.Dataset(fields).set_coords({"h", "H", "h_over_H"} & fields.keys())
    return defaultdict(lambda: coords)


def observes(check, data, expected):
    """Assert what a check, or a claim's, observes: a number and perhaps whether it holds; or the reason."""
    measure = claims.find_claim(check).measure if isinstance(check, str) else check
    if isinstance(expected, str):
        with pytest.raises(Unjudged, match=expected):
            measure(data)
        return
    number, *holds = expected if isinstance(expected, tuple) else (expected,)
    evidence = measure(data)
    assert evidence.observed == pytest.approx(number, abs=2e-14)
    assert holds in ([], [evidence.holds])
