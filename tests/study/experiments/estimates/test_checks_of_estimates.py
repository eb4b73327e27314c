"""The checks of the estimates on made-up tables, by hand; see made_up.py."""

import math
from functools import partial

import clarabel
import numpy as np
import pytest
import scipy.sparse as sp
from made_up import DIM, NAN, observes, table

from study import evidence
from study.experiments.estimates import checks as estimates
from study.experiments.scenes import checks as scenes
from study.ledger import claims
from unilateral.geometry.partition import make_uniform_partition
from unilateral.geometry.polygon import find_polygon, square
from unilateral.norms.dual import Gram


def levels(**errors):
    """Errors at H = 2h on three levels; at H = h they grow."""
    h = 0.5 ** np.arange(3)
    H = np.array([2, 1, 0.5, 0.25])
    fields = {name: np.full((2, 3, 4), NAN) for name in errors}
    for name, values in errors.items():
        fields[name][:, np.arange(3), np.arange(3)] = values
        fields[name][:, np.arange(3), np.arange(1, 4)] = [1, 10, 100]
    return table(**fields, h_over_H=h[:, None] / H, case=["rough", "thirds"])


def forms_of(lower, upper, **options):
    """What a table of the dual norm on the unit square has, one case, by diagonals of its forms."""
    cells = len(lower) - 1
    fields = {"points": np.arange(cells + 1) * 4 / cells, "polygon": "square", "oscillation": [0.0]}
    fields |= {
        "lambda_means": np.zeros((1, cells)),
        "norm_lower": np.diag(lower),
        "norm_upper": np.diag(upper),
    }
    return fields | options


def forms_of_L2(n, H, **options):
    """||.||_0 in the place of the dual norm, n cells a side, lambda = 4 s mod 1."""
    size = np.append(np.full(4 * n, 1 / n), 4 * 16 / n**2 / 12)
    means = [np.tile(4 * (np.arange(n) + 0.5) / n % 1, 4)]
    return table(**forms_of(0.5 * size, 1.5 * size, lambda_means=means) | options, case=["c"], H=H)


def abstract(E, L, c):
    """E^2 over (E + L) r + m E + c with r = 0.2, and m what oscillates, 0.1, alone.

    A finer mesh with the error 9, whose L is not known, is not judged.
    """
    fields = {"h1_error": [[[E], [9.0]]], "hm12_error_upper": [[[L], [NAN]]], "ritz_error": [[0.2, 0.2]]}
    forms = forms_of(5 * [0.0], 5 * [0.0], oscillation=[0.1], consistency=[[c]])
    return table(**forms, **fields, case=["thirds"], H=[1.0])


def runs(**changed):
    """Two runs of equal numbers, H = 1/4 and 1/16, but for those of the second that are `changed`."""
    fields = {"h1_error": 0.125, "l2_error": 1.25, "hm12_best": 0.125, "hm12_error_upper": 0.625}
    fields |= {"projection_error": 0.25, "ritz_error": 0.25, "u_norm": 1.0, "consistency": 0.046875}
    fields |= {"discrete_error": 0.1, "hm12_error_lower": 0.5}
    fields |= {"beta_0": 0.5, "beta_lower": 0.75, "beta_upper": 1.0}
    for name, value in fields.items():
        values = np.array([value, changed.get(name, value)] if "partition" in DIM[name] else [value])
        fields[name] = values.reshape((1,) * (len(DIM[name]) - 1) + values.shape)
    return table(**fields, case=["c"], H=[1 / 4, 1 / 16])


EXACT = {"l2_error": 1e-13, "projection_error": 0.0, "h1_error": 0.0, "hm12_best": 1e-14}


def one_cell_a_side(lambda_means=(0, 0, 0, 0), gap_means=(0, 0, 0, 0), **runs):
    """The unit square with a cell a side; diag(1) and diag(4) for the norm, 1/4 for lambda - Pi_H lambda.

    The numbers of the runs are those of two meshes. beta is 1 on the first one and 0 on the other.
    """
    forms = forms_of(
        [1, 1, 1, 1, 0.25], [4, 4, 4, 4, 0.25], lambda_means=[lambda_means], gap_means=[gap_means]
    )
    forms |= {name: [[[value] for value in values]] for name, values in runs.items()}
    forms |= {"beta_upper": [[1.0], [0.0]], "projection_error": [[0.25]]}
    return table(**forms, ritz_error=[[1.0, 1.0]], u_norm=[[1.0, 1.0]], case=["c"], H=[1.0])


def make_L2_estimate(*l2):
    """With C = 1/4^(1/2), from the larger form, and H = 1: 0.75 = 0.25 + C (0.5 + 0.25^(1/2))."""
    return one_cell_a_side(l2_error=l2, hm12_error_lower=[0.5, 0.5])


def quasi_optimal(lambda_means, gap_means, square):
    """The other mesh, with beta = 0 and the error 99, is not judged."""
    return one_cell_a_side(lambda_means, gap_means, h1_error=[math.sqrt(square), 99.0])


def projection(coarsest):
    parameters = {"scenes": ["a"], "expected": {"c": 0.75, "e": 9}, "tolerance": 0.1}
    return partial(estimates.projection, coarsest=coarsest, **parameters)


def norm_of_1(lower, upper):
    """Diagonal forms in which 1 on four cells has that multiple of the norm, by e^s in place of coth."""
    quarter = 2 + (math.e + 1) / (math.e - 1)
    return table(**forms_of(5 * [lower**2 * quarter], 5 * [upper**2 * quarter]))


def gap(lower, upper):
    """Beside the bounds 1 and 1.03125."""
    pair = {"hm12_error_lower": [[[1.0, lower]]], "hm12_error_upper": [[[1.03125, upper]]]}
    return table(**pair, u_norm=[[1.0]])


def lemma_1(**changed):
    """m = 1, k = min(0.5/0.5, 9/0.5) = 1, c = 1/4: D^2 = D + (1 + D) + 1/4 at D = 5/2.

    With k = 0.25/0.5 and c = 1/2 it is at 2. beta counts from above.
    """
    fields = {"discrete_error": 2.5, "ritz_means": 9.0, "beta_lower": 0.4, "beta_upper": 0.5, "beta_0": 0.5}
    fields |= {"ritz_error": 0.5, "u_norm": 1.0, "consistency": 0.25} | changed
    values = {name: np.full((1,) * len(DIM[name]), value) for name, value in fields.items()}
    return table(**forms_of([0, 0, 0, 0, 1.0], 5 * [9.0], **values), case=["c"], H=[1.0])


INDICES = dict.fromkeys(claims.find_claim("F.total").parameters["value"], ("mesh", [2.0, NAN]))

EXACTNESS = partial(scenes.exactness, scenes=["a"], orders={"natural": 1.5, "violates_jj": 1}, tolerance=0.2)


def becoming_exact(**excess):
    """The sharp bounds over the errors, less 1, of cases on four meshes."""
    index = 1 + np.array([*excess.values()])
    return table(total_index_u=(("case", "mesh"), index), h=("mesh", 0.5 ** np.arange(4)), case=[*excess])


ROWS = [
    # A negative consistency term is none, and 1e-12 is allowed.
    ("4.16a", table(consistency_elsewhere=[[1e-16, -0.5], [0.25, 0]], case=["c", "d"]), (0.5, False)),
    ("4.16a", table(consistency_elsewhere=[[1e-16, -0.9e-12]], case=["c"]), (0.9e-12, True)),
    ("4.16a", table(consistency_elsewhere=[[0, NAN]], case=["c"]), "is not known of square, c; uns"),
    # Errors have to fall on every level, in both norms.
    ("R4.1b", levels(h1_error=[4, 2, 1], hm12_error_lower=[8, 2, 1.5]), 0.75),
    ("R4.1b", levels(h1_error=[4, 5, 1], hm12_error_lower=[8, 2, 1]), (1.25, False)),
    ("R4.1b", levels(h1_error=[4, 2, 1], hm12_error_lower=[1, 2, 1]), (2, False)),
    # A decrease is from the lower bound, at least 8, to the upper one, at most 2.
    ("1.2h", levels(hm12_error_lower=[8, 1, 1], hm12_error_upper=[9, 1, 2]), 0.25),
    # lambda - Pi_H lambda, of slope 4, has the norm 4 * 2H/12^(1/2) for H <= 1/4, and no other for larger H.
    # So rates are 1 and 0, less the expected 3/4. On H = 1/32 there is no form.
    (projection(1.0), forms_of_L2(16, 0.5 ** np.arange(6)), pytest.approx(-0.75)),
    (projection(0.25), forms_of_L2(16, 0.5 ** np.arange(6)), pytest.approx(0.25)),
    # 1 over 2 * 0.2 + 0.1 + 0.5, and with another number.
    ("4.5", abstract(1.0, 1.0, 0.5), 1.0),
    ("4.5", abstract(1.0, 0.0, 0.5), 1.25),
    ("4.5", abstract(1.0, 1.0, 0.0), 2.0),
    ("4.5", abstract(2.0, 1.0, 0.5), 4 / 1.3),
    # 1.25 = 1/4 + (1/8 + 1/8)/(1/2 * (1/4)^(1/2)); with H = 1/16 the right side is 2.25. Where beta_0 is 0,
    # and where the error is, to round-off, there is nothing to judge.
    ("4.7b", runs(), 1.0),
    ("4.7b", runs(l2_error=3.375), 1.5),
    ("4.7b", runs(l2_error=9.0, beta_0=0.0), 1.0),
    ("4.7b", runs(**EXACT), 1.0),
    # Nor is there where the error is not known.
    ("4.7", make_L2_estimate(0.75, NAN), 1.0),
    ("4.7", make_L2_estimate(0.75, 1.5), 2.0),
    ("4.7", make_L2_estimate(0.75, 1e-13), 1.0),
    # c = 1 + 3/1 before 1 + 1/4 + inf (2 - mu)^2 + mu w: mu is 3/2 for w = 1, and 0, not -2, for w = 8. So
    # that is 2 + 1 and 4.25 + 1; with complementary means mu = Pi_H lambda leaves 1/4 + 1. Infima of both
    # terms apart would be 0 in each case.
    ("4.10", quasi_optimal([2.0, 0.0, 0.0, 0.0], [1.0, 3.0, 3.0, 3.0], 12.0), pytest.approx(1.0)),
    ("4.10", quasi_optimal([2.0, 0.0, 0.0, 0.0], [8.0, 3.0, 3.0, 3.0], 21.0), pytest.approx(1.0)),
    ("4.10", quasi_optimal([0.0, 0.0, 2.0, 1.0], [1.0, 3.0, 0.0, 0.0], 2.5), pytest.approx(0.5)),
    (
        partial(estimates.quasi_optimality, scenes=["a"], max_cells=3),
        quasi_optimal([0.0, 0.0, 2.0, 1.0], [1.0, 3.0, 0.0, 0.0], 2.5),
        "there is nothing",
    ),
    # 0.625 over (1 + 1/beta)/8 + 1/(8 beta) with beta = 1, and the worst run.
    ("4.6", runs(hm12_error_upper=0.625), 5 / 3),
    ("4.6", runs(hm12_error_upper=0.75), 2.0),
    ("4.6", runs(hm12_error_upper=0.1), 5 / 3),
    # Bounds of the norm of 1 enclose it and are close.
    ("3.5", norm_of_1(1.0, 1.0), 0.0),
    ("3.5", norm_of_1(0.8, 1.2), (0.5, False)),
    ("3.5", norm_of_1(1.25, 1.25), (0.25, False)),
    ("3.5", norm_of_1(0.75, 0.75), (0.25, False)),
    # Bounds that cross have no gap. Errors that are 0 to round-off, or not known, have none that counts.
    ("F.norm", gap(1.0, 1.046875), (0.046875, True)),
    ("F.norm", gap(1.0, 0.75), (-0.25, False)),
    ("F.norm", gap(1e-14, 1e-13), (0.03125, True)),
    ("F.norm", gap(1e-10, 2e-10), (1.0, False)),
    ("F.norm", gap(NAN, NAN), (0.03125, True)),
    # Where beta or D is 0 Lemma 1 is not judged.
    ("T.D", lemma_1(), 1.0),
    ("T.D", lemma_1(ritz_means=0.25, consistency=0.5), 1.25),
    ("T.D", lemma_1(discrete_error=5.0), 2.0),
    ("T.D", lemma_1(beta_lower=0.0), "nothing of which"),
    ("T.D", lemma_1(discrete_error=0.0), "nothing of which"),
    # Every bound over the error counts, where it is known.
    ("F.total", table(**INDICES), (2.0, True)),
    ("F.total", table(**INDICES | {"total_index_lambda": ("mesh", [0.5, NAN])}), (0.5, False)),
    # index - 1 falls like h^2 and h on the last two halvings; h^0.8 is required of natural, and of
    # violates_jj that it falls.
    (EXACTNESS, becoming_exact(natural=[9.0, 1.0, 8.0, 1 / 16], violates_jj=[9.0, 1.0, 8.0, 1 / 4]), 4.0),
    (EXACTNESS, becoming_exact(natural=[9.0, 1.0, 8.0, 1 / 4], violates_jj=[9.0, 1.0, 8.0, 1 / 4]), 0.0),
    (
        EXACTNESS,
        becoming_exact(natural=[9.0, 1.0, 8.0, 1 / 4], violates_jj=[9.0, 1.0, 8.0, 4.0]),
        (-6.0, False),
    ),
    (EXACTNESS, becoming_exact(natural=[9.0, 1.0, 8.0, 1 / 2]), (-2.5, False)),
    (EXACTNESS, becoming_exact(natural=[9.0, 1.0, 8.0, 1 / 4]), "^violates_jj is in no scene$"),
]


@pytest.mark.parametrize(("check", "data", "expected"), ROWS)
def test_what_a_check_observes_is_what_is_found_by_hand(check, data, expected):
    observes(check, data, expected)


def test_forms_are_known_on_the_partitions_that_they_refine():
    known_norm_forms = evidence.dual_norm_forms(forms_of_L2(4, [1, 1 / 4, 1 / 8]), "a")
    assert [cells.n_cells for cells, _ in known_norm_forms] == [4, 16]
    assert {cells.polygon.name for cells, _ in known_norm_forms} == {square().name}
    lshape = forms_of_L2(4, [1], points=np.arange(17) / 2, polygon="lshape")
    assert [cells.polygon.name for cells, _ in evidence.dual_norm_forms(lshape, "a")] == [
        find_polygon("lshape").name
    ]


def test_the_infimum_over_multipliers_is_a_quadratic_programme():
    """Against Clarabel, another method, with a form that is not diagonal and random data."""
    rng = np.random.default_rng(0)
    half = rng.standard_normal((17, 17))
    form = half.T @ half
    w = rng.random(16)
    means = rng.random((1, 16))
    forms = forms_of(17 * [1.0], 17 * [1.0], lambda_means=means, gap_means=[w], norm_lower=form)
    dual = table(**forms)["dual_norm"]
    gram = Gram.from_table(dual)
    cells = make_uniform_partition(square(), 1 / 4)
    P = 2 * form[:16, :16]
    q = -2 * (form[:16, :16] @ means[0] + form[:16, 16]) + w / 4
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    cone = [clarabel.NonnegativeConeT(16)]
    upper = sp.csc_matrix(np.triu(P))
    minus = sp.csc_matrix(-np.eye(16))
    mu = clarabel.DefaultSolver(upper, q, minus, np.zeros(16), cone, settings).solve().x
    x = np.append(means[0] - np.array(mu), 1.0)
    assert estimates.infima_over_multipliers(dual, cells, gram)[0] == pytest.approx(
        x @ form @ x + w @ mu / 4, rel=1e-7
    )


def test_the_inverse_estimate_has_its_known_constant_in_a_multiple_of_L2():
    """In ||.||_0/2^(1/2), from below, C = (2H)^(1/2): 2^(1/2) for H = 1, times 1/4, and 2^(-1/2), times 1.

    H = 1/4 is with h = 1/8 as with 1/16, of which only the first counts; H = 1/2 is on no mesh with H = 2h.
    """
    ratios = [[1 / 2, 1.0, 2.0], [1 / 8, 1 / 4, 1 / 2], [1 / 16, 1 / 8, 1 / 4]]
    beta_0 = [[0.25, 9, 9], [9, 9, 1.0], [9, 9, 9]]
    inverse_estimate = estimates.inverse_estimate(
        forms_of_L2(4, [1, 1 / 2, 1 / 4], h_over_H=ratios, beta_0=beta_0), ["a"], 2
    )
    assert inverse_estimate.observed == pytest.approx(math.sqrt(0.5))
    assert [line.strip() for line in inverse_estimate.lines] == [
        f"a, H = {H:g}: C = {math.sqrt(2 * H):.4g}" for H in (1, 0.25)
    ]
