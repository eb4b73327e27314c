"""The claims about other methods' multipliers, and what documents show, on made-up tables, by hand."""

import numpy as np
import pytest
import xarray as xr
from made_up import observes

from study.experiments.multipliers import numbers

H = 2.0 ** -np.arange(3, 9)
SCHEMES = [
    "P0, H = 2h",
    "nodal reactions",
    "stabilised, H = h",
    "P0, H = 2h, linear",
    "nodal reactions, linear",
]


def make_errors(orders=None, bound=0.0, **changed):
    """Errors (1 + place of the method) h^order, 3/2 if no other one is given, of three cases."""
    fields = {}
    cases = ["natural", "thirds", "smooth"]
    exponents = np.full((len(cases), len(SCHEMES)), 1.5)
    for (case, scheme), order in (orders or {}).items():
        exponents[cases.index(case), SCHEMES.index(scheme)] = order
    errors = np.arange(1, 1 + len(SCHEMES))[:, None] * H ** exponents[..., None]
    dims = ("case", "scheme", "mesh")
    names = ("hm12_error_lower", "hm12_error_upper", "l2_error")
    fields = dict.fromkeys(names, errors) | {"algebraic_bound": bound * errors} | changed
    counts = np.add.outer(np.arange(len(SCHEMES)), 1 / H)
    return xr.Dataset(
        {name: (dims, values) for name, values in fields.items()} | {"multipliers": (dims[1:], counts)},
        coords={"case": cases, "scheme": SCHEMES, "h": ("mesh", H)},
    )


NODAL = "nodal reactions"
ROWS = [
    ("L.order", make_errors(), (1.5, True)),
    ("L.order", make_errors({("smooth", NODAL): 1.3}), (1.3, False)),
    ("L.order", make_errors({("thirds", SCHEMES[0]): 1.39}), (1.39, False)),
    ("L.order", make_errors({("natural", NODAL): 1, ("thirds", "stabilised, H = h"): 1}), (1.5, True)),
    ("L.order", make_errors(l2_error=np.ones((3, 5, 6))), (1.5, True)),
    ("L.order", make_errors(bound=0.02), (0.02, False)),
    ("L.vertex", make_errors({("natural", NODAL): 1}), (0, True)),
    ("L.vertex", make_errors({("natural", NODAL): 1.25}), (0.25, False)),
    ("L.vertex", make_errors({("natural", NODAL): 0.8}), (0.2, False)),
]


@pytest.mark.parametrize(("check", "data", "expected"), ROWS)
def test_what_a_check_observes_is_what_is_found_by_hand(check, data, expected):
    observes(check, {"multipliers/errors": data}, expected)


def test_the_coarsest_errors_do_not_count():
    """Ones there leave all pairs from 1/16 on as they are. Control: on the second mesh they do count."""
    for place, expected in ((0, (1.5, True)), (1, (0, False))):
        data = make_errors()
        for name in ("hm12_error_lower", "hm12_error_upper"):
            data[name] = data[name].copy()
            data[name][{"mesh": place}] = data[name].isel(mesh=place + 2)
        observes("L.order", {"multipliers/errors": data}, expected)


def test_documents_show_rates_over_two_halvings_and_relative_errors():
    """The method with the place k has k times the error of the first one, and 256 + k - 1 multipliers."""
    results = {"multipliers/errors": make_errors()}
    displayed = numbers.blocks(results, {})["multipliers"]
    assert len(displayed) == 15
    assert displayed.iloc[6].tolist() == ["`thirds`", NODAL, "257", "1.50", "2.00", "1.50", "2.00"]
    named = numbers.numbers(results, {"multipliers": {"stabilisation": "1/10"}})["multipliers"]
    assert named["gamma"] == "1/10"
    places = {"nodal": 2, "stabilised": 3, "linear": 4, "nodal_linear": 5}
    for name, place in places.items():
        assert named[name] == pytest.approx({"continuous": place, "jump": place})
    # three times the error of the first one, on a mesh of twice the size
    assert named["same_number"] == pytest.approx({"least": 3 * 2**1.5, "largest": 3 * 2**1.5})


def test_the_largest_error_of_the_continuous_cases_is_named():
    """One order less multiplies the finest error, at h = 1/256, by 256; half of one that at 1/128."""
    orders = {("smooth", NODAL): 0.5, ("natural", NODAL): 2.5, ("thirds", "stabilised, H = h"): 1}
    results = {"multipliers/errors": make_errors(orders)}
    named = numbers.numbers(results, {"multipliers": {"stabilisation": "1/10"}})["multipliers"]
    assert named["nodal"] == pytest.approx({"continuous": 2 * 256, "jump": 2 / 256})
    assert named["same_number"] == pytest.approx({"least": 3 * 2**1.5, "largest": 3 * 256**1.5 / 128})
