"""Controls in parts: between the true results and the spoilt ones, and the least part that is seen."""

import numpy as np
import pytest
import xarray as xr

from study.ledger import claims, controls
from study.ledger.results import Results

OBSERVED = 2.0
REQUIRED = 1.0


def made_up(at_least=True):
    """2, of which at least 1 is required; beside it 5."""
    table = xr.Dataset({"number": ("row", [OBSERVED, 3.0]), "other": ("row", [5.0, 5.0])})
    results = Results("", {"t": table, "none": table * 0})
    entry = dict.fromkeys(("section", "title", "statement", "where", "verdict"), "x")
    entry |= {"id": "x", "check": "ledger.worst", "source": "derived: x", "reads": ["t"]}
    bound = {"at_least" if at_least else "at_most": REQUIRED}
    parameters = {"table": "t", "value": "number", "quantity": "a number", **bound}
    return results, {**entry, "parameters": parameters}


def sees(**control):
    results, entry = made_up()
    claim = claims.read_claim({**entry, "control": {"what": "x", "tables": ["t"], **control}})
    return claims.judge_claim(results, claim).sees


@pytest.mark.parametrize(
    ("control", "calls"),
    [
        ({"variable": "number", "factor": 0.1}, "× 0.50"),
        ({"variable": "number", "factor": 0.4, "at": {"row": 0}}, "× 0.50"),
        ({"variable": "number", "factor": 0.1, "at": {"row": 1}}, "× 0.33"),
        ({"variable": "number", "value": -8.0}, "10 % of the control"),
        ({"variable": "number", "value": -np.inf}, "below 0.0001 % of the control"),
        ({"variable": "number", "value": 0.995}, "all of the control"),
        ({"by": "none"}, "50 % of the control"),
        ({"by": "none", "rounding": True}, "below 100 % of the control"),
        ({"variable": "number", "value": -48.0, "rounding": True}, "below 10 % of the control"),
        ({"variable": "number", "value": 0.995, "rounding": True}, "all of the control"),
    ],
)
def test_a_claim_sees_a_change_from_its_least_part_on(control, calls):
    """2 and 3 against 1: it fails where 2 is halved, 3 is a third, or 2 + x (-8 - 2) is 1."""
    assert sees(**control) == calls


def test_a_claim_that_does_not_hold_sees_nothing():
    results, entry = made_up(at_least=False)
    claim = claims.read_claim({**entry, "control": {"what": "x", "tables": ["t"]}})
    judgement = claims.judge_claim(results, claim)
    assert (judgement.holds, judgement.sees) == (False, None)


def test_the_scenes_that_are_not_spoilt_are_not_looked_at():
    """A check on two scenes fails where one does; a wrong number in the other one would not change that."""
    table = made_up()[0]["t"]
    results = Results("", {"a/t": table, "b/t": table})
    entry = made_up()[1]
    entry["parameters"] |= {"table": "{scene}/t", "scenes": ["a", "b"]}
    control = {"what": "x", "tables": ["a/t"], "variable": "number", "factor": 0.1}
    claim = claims.read_claim({**entry, "reads": ["{scene}/t"], "control": control})
    assert claims.judge_claim(results, claim).sees == "× 0.50"
    asked = claims._restrict_to_control(claim).parameters["scenes"]
    assert asked == ["a"]


def test_shares_of_a_control_are_between_the_true_results_and_the_spoilt_ones():
    """What is not changed is kept to the last bit, NaN included."""
    table = xr.Dataset({"number": ("row", [0.1, np.nan, 4.0])})
    values_by_share = {}
    for share in (0.25, 1.0):
        control = {"tables": ["t"], "variable": "number", "value": 8.0, "at": {"row": 2}}
        values_by_share[share] = controls.spoil_results(Results("", {"t": table}), control, share)["t"][
            "number"
        ].values
    np.testing.assert_array_equal(values_by_share[0.25], [0.1, np.nan, 5.0])
    np.testing.assert_array_equal(values_by_share[1.0], [0.1, np.nan, 8.0])
    assert table["number"].values[2] == 4.0


@pytest.mark.parametrize("minimum", [3e-6, 0.017, 0.9])
def test_the_share_is_found_to_one_per_cent_in_few_tries(minimum):
    """By counting: log2(ln 1e6 / ln 1.01) = 10.4, and the first one."""
    tried = []

    def fails(share):
        tried.append(share)
        return share >= minimum

    assert controls.find_smallest_share(fails) == pytest.approx(minimum, rel=0.015)
    assert len(tried) <= 12
