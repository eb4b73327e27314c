"""The study of cost: counts against brute force, levels against runs of their own, fits against laws."""

import itertools
import math
import warnings
from functools import cache

import numpy as np
import pytest
import scipy.sparse as sp
import xarray as xr
import yaml
from conftest import ROOT, condense_structured_mesh, couple_structured_mesh, discrete, exact_errors, load
from scipy.sparse.linalg import splu

from study import operations
from study.experiments.cost import numbers as cost_numbers
from study.experiments.cost import products, trade
from study.experiments.cost.measure import measure, plan_axes, tabulate_axis
from study.experiments.cost.run import History, Variant
from unilateral.discrete.condensed import solve_condensed_problem
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import square
from unilateral.norms.dual import build_dual_norm
from unilateral.solvers import uzawa_steps as acceleration
from unilateral.solvers.stop import Stop
from unilateral.solvers.uzawa import residual_bound, uzawa

STUDY = yaml.safe_load((ROOT / "workflow/config/study.yaml").read_text())["cost"]
BASE = Variant("square", "thirds", 2.0, "uzawa", "S", "float64")
STOPS = [10.0**-k for k in range(11)]


class Counted(float):
    """A number that counts the operations it takes part in."""

    n_operations = 0

    @classmethod
    def wrap_array(cls, values):
        return np.array([cls(x) for x in values.ravel()], dtype=object).reshape(values.shape)


def _counting(name):
    def operation(self, *arguments):
        Counted.n_operations += 1
        return Counted(getattr(float, name)(self, *map(float, arguments)))

    return operation


for name in ("add", "radd", "sub", "rsub", "mul", "rmul", "truediv", "rtruediv"):
    setattr(Counted, f"__{name}__", _counting(f"__{name}__"))


def problem(case, n, ratio):
    return discrete(case, n, n / ratio)


def operations_of(work, *arguments):
    """How many operations a function takes of these numbers."""
    numbers = [Counted.wrap_array(argument) for argument in arguments]
    Counted.n_operations = 0
    work(*numbers)
    return Counted.n_operations


def counted_step(method, m, cut=True):
    """Operations of the second step of a method on m cells."""
    rng = np.random.default_rng(1)
    y = rng.random(m) + 1
    F = rng.random(m) + 1
    R = rng.random(m) + 1
    step = acceleration.STEP_METHODS[method](np.eye(m), np.zeros(m), 0.5, Counted.wrap_array(0.5 * y))
    if isinstance(step, acceleration.BarzilaiBorwein):
        step.previous_F = Counted.wrap_array(0.5 * F)
        step.reference = -math.inf if cut else math.inf
    return operations_of(step, y, F, R)


@pytest.mark.parametrize("method", ["uzawa", "nesterov", "barzilai_borwein"])
def test_operations_of_a_step_are_those_counted(method):
    """Per cell: the difference between 9 and 5 cells, for scalars are not counted.

    A step of Barzilai and Borwein that is not cut takes 13.
    """
    assert (
        counted_step(method, 9) - counted_step(method, 5) == 4 * operations.STEP_OPERATIONS_PER_CELL[method]
    )
    if method == "barzilai_borwein":
        assert counted_step(method, 9, cut=False) - counted_step(method, 5, cut=False) == 4 * 13


def brute_cholesky(a):
    for k in range(len(a)):
        a[k, k] = Counted(math.sqrt(a[k, k]))
        Counted.n_operations += 1
        for i in range(k + 1, len(a)):
            a[i, k] = a[i, k] / a[k, k]
        for j in range(k + 1, len(a)):
            for i in range(j, len(a)):
                a[i, j] = a[i, j] - a[i, k] * a[j, k]


def brute_lu(a):
    """Elimination that skips zeros."""
    for k, i in itertools.combinations(range(len(a)), 2):
        if a[i, k] != 0:
            a[i, k] = a[i, k] / a[k, k]
            for j in range(k + 1, len(a)):
                if a[k, j] != 0:
                    a[i, j] = a[i, j] - a[i, k] * a[k, j]


def brute_solve(S, x):
    for i in range(len(x)):
        for j in range(i):
            x[i] = x[i] - S[i, j] * x[j]
        x[i] = x[i] / S[i, i]


def spd(n, band):
    rng = np.random.default_rng(n)
    full = np.triu(np.tril(rng.random((n, n)), band), -band)
    return full + full.T + 2 * n * np.eye(n)


@pytest.mark.parametrize("n", [1, 2, 7])
def test_operations_of_dense_algebra_are_those_counted_by_brute_force(n):
    assert operations_of(brute_cholesky, spd(n, n)) == operations.count_cholesky(n)
    assert operations_of(np.matmul, spd(n, n), np.ones(n)) == operations.count_product_by_S(n)
    assert operations_of(brute_solve, spd(n, n), np.ones(n)) == operations.count_triangular_solve(n)


@pytest.mark.parametrize(("n", "band"), [(6, 6), (8, 1), (9, 3)])
def test_operations_of_sparse_factors_are_those_counted_by_brute_force(n, band):
    options = {"permc_spec": "NATURAL", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    factors = operations.count_factors(splu(sp.csc_array(spd(n, band)), **options))
    a = spd(n, band)
    assert factors.factorise == operations_of(brute_lu, a)
    brute_lu(a)
    assert factors.nonzeros == np.count_nonzero(a) + n
    below = np.count_nonzero(np.tril(a, -1))
    above = np.count_nonzero(np.triu(a, 1))
    assert factors.solve == 2 * below + 2 * above + n


@pytest.mark.parametrize(
    ("algebra", "precision", "minimum", "maximum"),
    [
        ("A", "float64", 0, 1e-12),
        ("A_3", "float64", 0, 1e-12),
        ("S", "float64", 0, 0),
        ("S", "float32", 1e-9, 1e-6),
        ("S", "refined", 0, 0),
    ],
)
def test_every_way_to_S_y_gives_it(algebra, precision, minimum, maximum):
    spaces = couple_structured_mesh("square", 16, 8)
    y = np.random.default_rng(2).random(len(spaces.operator.H_i))
    exact = spaces.operator.S @ y
    out = np.empty_like(y)
    products.make_product(algebra, precision, spaces, condense_structured_mesh("square", 16))(y, out)
    assert minimum <= np.abs(out - exact).max() / np.abs(exact).max() <= maximum


def test_refinement_errs_like_the_increment():
    """Single precision of an increment of 1e-6 leaves 1e-6 of its error."""
    operator = couple_structured_mesh("square", 16, 8).operator
    apply = products.make_refined_product(operator)
    y = np.random.default_rng(3).random(len(operator.H_i))
    out = np.empty_like(y)
    for count in range(products.PRODUCTS_PER_REFRESH + 1):
        z = y * (1 + 1e-6 * (count % products.PRODUCTS_PER_REFRESH > 0))
        apply(z, out)
        if count % products.PRODUCTS_PER_REFRESH == 0:
            np.testing.assert_array_equal(out, operator.S @ y)
        else:
            assert np.abs(out - operator.S @ z).max() < 1e-12 * np.abs(out).max()


@pytest.mark.parametrize("method", acceleration.STEP_METHODS)
@pytest.mark.parametrize("case", ["natural", "thirds"])
def test_levels_read_off_are_those_of_runs_of_their_own(case, method):
    discrete = problem(case, 16, 2)
    operator = discrete.spaces.operator
    offset = discrete.offset
    tolerances = [0.01 * stop for stop in STOPS]
    rho = acceleration.STEP_METHODS[method].rho_factor / operator.lambda_max
    history = History(operator, offset, method, rho, tolerances)
    apply = products.make_product_by_S(operator)
    uzawa(operator, offset, tolerances[-1], rho, method=method, apply=apply, observe=history)
    assert len(history.reached_levels) == len(tolerances)
    for tolerance, reached_level in zip(tolerances, history.reached_levels, strict=True):
        single_uzawa = uzawa(operator, offset, tolerance, rho, method=method, apply=apply)
        assert (reached_level.steps, reached_level.applications) == (
            single_uzawa.iterations,
            single_uzawa.operator_applications,
        )
        np.testing.assert_array_equal(reached_level.lambda_H, single_uzawa.lambda_H)
        assert reached_level.bound == single_uzawa.bound <= tolerance


def steps_with_rounding(method, seed):
    """To each level, every product S y changed by two units in its last place, at random."""
    discrete = problem("thirds", 32, 2)
    rng = np.random.default_rng(seed)
    operator = discrete.spaces.operator
    offset = discrete.offset
    signs = np.array([-4e-16, 4e-16])

    def apply(y, out):
        out[:] = (operator.S @ y) * (1 + rng.choice(signs, len(y)))

    tolerances = [0.2 * stop for stop in STOPS]
    rho = acceleration.STEP_METHODS[method].rho_factor / operator.lambda_max
    history = History(operator, offset, method, rho, tolerances)
    uzawa(operator, offset, tolerances[-1], rho, method=method, apply=apply, observe=history)
    return [reached_level.steps for reached_level in history.reached_levels]


@pytest.mark.parametrize("method", acceleration.STEP_METHODS)
def test_steps_that_are_shown_do_not_change_with_rounding(method):
    """Those of Barzilai and Borwein to 1e-10 do, and are not shown."""
    first = steps_with_rounding(method, 0)
    rounded_runs = [steps_with_rounding(method, seed) for seed in range(1, 6)]
    displayed = STOPS.index(trade.COMPARED_LEVEL) + 1
    assert len(first) == len(STOPS)
    assert all(steps[:displayed] == first[:displayed] for steps in rounded_runs)
    changes = any(steps != first for steps in rounded_runs)
    assert changes == (method == "barzilai_borwein")


def test_in_single_precision_no_level_is_claimed_that_is_not_met():
    """The loop's own bound, of its rounded products, ends below the last tolerance; the true one does not."""
    discrete = problem("natural", 16, 2)
    operator = discrete.spaces.operator
    offset = discrete.offset
    rho = 1.9 / operator.lambda_max
    history = History(operator, offset, "uzawa", rho, [1e-4, 1e-12])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        result = uzawa(
            operator,
            offset,
            1e-12,
            rho,
            max_steps=4000,
            apply=products.make_single_product(operator),
            observe=history,
        )
    assert len(history.reached_levels) == 1
    assert history.reached_levels[0].bound <= 1e-4
    assert residual_bound(operator, offset, result.lambda_H, rho) > 1e-9


def test_an_axis_has_all_combinations_of_its_values_the_base_first():
    """By hand: two fields of three and two values; others are the base's."""
    values_of_axis = {"algorithm": ["safe", "newton"], "H_over_h": ["3/2"]}
    (axis,) = plan_axes({"base": STUDY["base"], "axes": {"both": values_of_axis}})
    assert axis.values == {"algorithm": ["uzawa", "safe", "newton"], "H_over_h": [2.0, 1.5]}
    expected = [
        BASE._replace(algorithm=name, H_over_h=ratio)
        for name in ("uzawa", "safe", "newton")
        for ratio in (2.0, 1.5)
    ]
    assert axis.variants == expected


SIZES = [1 / 8, 1 / 4]
LIMITS = {"stops": STOPS, "max_steps": 100_000, "costly_steps": 50}


@cache
def measure_cost():
    """The tables along algorithms, and along ways to S y, on one mesh; by hand, few of the study's runs."""
    axes = plan_axes(
        {
            "base": STUDY["base"],
            "axes": {
                "algorithm": {**STUDY["axes"]["algorithm"], "H_over_h": [4]},
                "algebra": STUDY["axes"]["algebra"],
            },
        }
    )
    gram = build_dual_norm(partitions.make_uniform_partition(square(), 1 / 8), [load("thirds")]).gram(
        [load("thirds")]
    )
    variants = list(dict.fromkeys(variant for axis in axes for variant in axis.variants))
    rows = measure(
        condense_structured_mesh("square", 16).mesh, [load("thirds")], gram, variants, SIZES, LIMITS
    )
    return [tabulate_axis(axis, rows, SIZES, STOPS) for axis in axes]


def test_the_last_level_has_the_errors_of_the_solution():
    """`solve_condensed_problem` measures by other means: from the solution's u_h and lambda_H."""
    table = measure_cost()[0]
    single_problem = problem("thirds", 16, 2)
    errors = exact_errors(single_problem, solve_condensed_problem(single_problem, Stop(tolerance=1e-13)))
    for algorithm in table["algorithm"].values:
        row = table.sel(algorithm=algorithm, H_over_h=2, H=1 / 8, stop=1e-10)
        assert float(row["h1_error"]) == pytest.approx(errors.h1, rel=1e-9)
        assert float(row["l2_error"]) == pytest.approx(errors.l2, rel=1e-8)
        assert errors.hm12_discrete <= float(row["hm12_error_lower"]) * (1 + 1e-9)
        assert float(row["hm12_error_lower"]) <= float(row["hm12_error_upper"])


def test_ways_to_S_y_take_the_same_steps_and_their_own_operations():
    algebra = measure_cost()[1].sel(H=1 / 8)
    steps = algebra["steps"]
    for name in ("A", "A_3"):
        met = np.isfinite(steps.sel(algebra=name))
        assert 0 < met.sum() < len(STOPS)
        assert (steps.sel(algebra=name) == steps.sel(algebra="S"))[met].all()
    per_step = algebra["step_operations"]
    assert (
        float(per_step.sel(algebra="S"))
        < float(per_step.sel(algebra="A_3"))
        < float(per_step.sel(algebra="A"))
    )


def test_what_is_not_measured_is_missing():
    """With cells of two edges H = 1/4 is not on this mesh, nor is H = 1/8 with cells of four."""
    runs = np.isfinite(measure_cost()[0]["h"].sel(algorithm="uzawa"))
    np.testing.assert_array_equal(runs.sel(H_over_h=[2, 4], H=SIZES), [[True, False], [False, True]])


def test_operations_are_the_sum_of_their_parts():
    """Of plain Uzawa: steps + 1 residuals, steps updates, and a product for every other application."""
    table = measure_cost()[0].sel(algorithm="uzawa", H_over_h=2, H=1 / 8)
    m = int(table["multipliers"])
    once = float(table["setup_operations"])
    steps = table["steps"].values
    product = m * (2 * m - 1)
    checks = table["operator_applications"].values - steps - 1
    components = (steps + 1) * (product + 4 * m) + steps * m + checks * (product + 2 * m)
    np.testing.assert_array_equal(table["operations"].values, once + components)


def make_laws(sizes):
    """Steps digits / H by Uzawa's, digits / H^(1/2) by Nesterov's."""
    H = 2.0 ** -np.arange(2, 2 + sizes)
    digits = -np.log10(STOPS)
    plain = digits / H[:, None] ** 1.0
    fast = digits / H[:, None] ** 0.5
    coords = {"algorithm": ["uzawa", "nesterov"], "H_over_h": [2.0], "H": H, "stop": STOPS}
    return xr.Dataset({"steps": (tuple(coords), np.stack([plain, fast])[:, None])}, coords=coords)


def test_growth_exponents_are_those_of_made_up_laws():
    """From H = 1/16 on; two sizes, of five, are too few."""
    growth_exponents = [
        trade.growth_exponent(make_laws(6), name, 2, 1 / 16) for name in ("uzawa", "nesterov")
    ]
    assert growth_exponents == pytest.approx([1, 0.5], abs=1e-12)
    assert math.isnan(trade.growth_exponent(make_laws(4), "uzawa", 2, 1 / 16))


def test_front_leaves_out_what_is_beaten():
    work = np.array([1.0, 2.0, 3.0, 4.0, 2.5, np.nan])
    error = np.array([1.0, 0.5, 0.6, 0.499, np.nan, 0.1])
    assert trade.pareto_front(work, error).tolist() == [0, 1]


def test_half_of_an_error_at_second_order_of_work_costs_its_square_root():
    work = np.array([1.0, 10.0, 100.0, np.nan])
    assert trade.halving_factor(work, np.append(work[:3] ** -2, 1.0)) == pytest.approx(
        math.sqrt(2), rel=1e-12
    )


def make_errors(errors):
    """A case whose discrete error is 1."""
    coords = {"case": ["one"], "H": [1 / 16], "stop": STOPS[: len(errors)]}
    variables = {
        "h1_error": (tuple(coords), np.reshape(errors, (1, 1, -1))),
        "h1_discrete": (("case", "H"), [[1.0]]),
    }
    return xr.Dataset(variables, coords=coords)


@pytest.mark.parametrize(
    ("errors", "stop"),
    [
        ([3, 1.2, 1.05, 1.0], 1e-2),
        ([9, 1.0, 2.0, 1.0], 1e-3),
        ([1, 1, 1, 1], 1e-1),
        ([1, 1, 1, 1.2], math.nan),
    ],
)
def test_the_level_that_is_enough_has_no_worse_one_below(errors, stop):
    assert trade.sufficient_stop(make_errors(errors), "h1", 1 / 16) == pytest.approx(stop, nan_ok=True)


def make_ratios(factors):
    """Errors h times a factor of each H/h, with a set-up of h^-3: at the same work as far apart as these."""
    ratios = np.array([2.0, 3.0, 4.0])
    H = 2.0 ** -np.arange(3, 7)
    coords = {"H_over_h": ratios, "H": H, "stop": [1.0]}
    h = H / ratios[:, None]
    error = h[..., None] * np.reshape(factors, (3, 1, 1))
    variables = {"h1_error": (tuple(coords), error), "h1_discrete": (("H_over_h", "H"), error[..., 0])}
    mesh_fields = {"h": h, "u_norm": np.ones_like(h), "setup_operations": h**-3}
    variables |= {name: (("H_over_h", "H"), values) for name, values in mesh_fields.items()}
    variables["operations"] = (tuple(coords), 3 * h[..., None] ** -3)
    return xr.Dataset(variables, coords=coords)


@pytest.mark.parametrize("factors", [[1, 1.04, 1.06], [1.2, 1.1, 1], [1, 1, 1]])
def test_ratios_are_as_good_as_their_errors_at_the_same_work(factors):
    table = make_ratios(factors)
    losses = trade.losses_by_ratio(table["h1_discrete"], table["setup_operations"])
    assert list(losses.values()) == pytest.approx(np.array(factors) / min(factors))


def test_ratios_with_too_few_sizes_take_no_part():
    table = make_ratios([1.2, 1.1, 1])
    table["setup_operations"][{"H_over_h": 2, "H": 2}] = np.nan
    losses = trade.losses_by_ratio(table["h1_discrete"], table["setup_operations"])
    assert losses == pytest.approx({2.0: 1.2 / 1.1, 3.0: 1.0})


def test_the_price_is_that_of_the_finest_mesh_and_of_a_half():
    """Error h and work 3 h^-3, a third of it the set-up's: half of the error costs 8 times the work."""
    price = trade.price_at_level(make_ratios([1, 1, 1]).sel(H_over_h=2), "h1", 1.0, 1 / 8)
    assert price == pytest.approx((1.0, 1 / 128, 1 / 128, 3 * 128**3, 3, 8))


def test_forming_S_pays_after_its_cost_over_what_a_step_saves():
    """Set-up 1000 + the spectrum of 3 cells against 100, steps of 10 against 40: (1000 - 100) / 30."""
    coords = {"algebra": ["S", "A"], "H": [0.5]}
    values = {
        "setup_operations": [[1000.0 + operations.count_spectrum(3)], [100.0]],
        "step_operations": [[10.0], [40.0]],
        "multipliers": [[3.0], [3.0]],
    }
    table = xr.Dataset({name: (tuple(coords), value) for name, value in values.items()}, coords=coords)
    assert trade.break_even_steps(table) == pytest.approx([30])


def test_a_run_by_A_is_its_set_up_and_its_steps():
    """Set-up 100 and 9 steps, 10 residuals of 40, against 700 less the spectrum of 3 cells and 10 of 30."""
    dims = ("algorithm", "H_over_h", "H", "stop")
    coords = dict(zip(dims, (["uzawa"], [2.0], [0.5], [0.1]), strict=True))
    values = {"steps": 9.0, "setup_operations": 700.0 + operations.count_spectrum(3), "step_operations": 30.0}
    values["multipliers"] = 3.0
    crossed = xr.Dataset({name: (dims, np.full((1, 1, 1, 1), x)) for name, x in values.items()}, coords)
    A_operations = {"setup_operations": 100.0, "step_operations": 40.0}
    algebra = xr.Dataset(
        {name: (("algebra", "H"), [[x]]) for name, x in A_operations.items()}, {"algebra": ["A"], "H": [0.5]}
    )
    assert trade.work_of_A_over_S(algebra, crossed, "uzawa", 2.0).item() == 0.5


def test_the_best_ratio_is_the_one_of_the_least_loss_and_not_the_smallest_one():
    """By hand; at 1.5 one case loses 40 %."""
    spans = {1.5: (1.0, 1.4), 2.0: (1.05, 1.2), 4.0: (1.0, 1.3)}
    assert cost_numbers.best_ratio(spans) == 2.0
    assert cost_numbers.best_ratio({**spans, 1.5: (1.0, 1.0)}) == 1.5
