"""||.||_{-1/2} from below: against closed forms, a cosine series, and scikit-fem's P2 on uniform meshes."""

from functools import cache
from math import gamma, pi, sqrt, tanh

import numpy as np
import pytest
import skfem
import xarray as xr
from conftest import load
from skfem.models.poisson import laplace, mass

from unilateral import dual_norm, partition
from unilateral.atoms import Singular
from unilateral.dual_norm import dual_errors, reference_space
from unilateral.norms import on_cells
from unilateral.polygon import named

ONE_ON_THE_SQUARE = sqrt(8 + 4 / tanh(0.5))  # (v, w)_1 = <1, w>: v = sum of cosh(x_i - 1/2) / sinh(1/2)


@cache
def space_of(polygon, m, name=None, per_cell=dual_norm.EDGES_PER_CELL):
    singular = load(name, polygon).flux_singular() if name else ()
    return reference_space(partition.uniform(named(polygon), 1 / m), singular, per_cell)


def projection_error(polygon, m, name, per_cell=dual_norm.EDGES_PER_CELL):
    """The lower bound of ||lambda - Pi_H lambda||_{-1/2}."""
    space, case = space_of(polygon, m, name, per_cell), load(name, polygon)
    return space.error_lower(case, on_cells(case, space.partition).lambda_means[None])[0]


def alternating(cells):
    return np.where(np.arange(cells.n_cells) % 2, -1.0, 1.0)


def uniform_p2(cells, n, mu=None, case=None):
    """||mu||_{-1/2} in P2 on squares of side 1/n, each cut in two; mu (m,) is constant on the cells.

    With a case, the norm of lambda - mu.
    """
    ticks = np.linspace(-1, 1, 2 * n + 1)[(n if cells.polygon.name == "square" else 0) :]
    mesh = skfem.MeshTri.init_tensor(ticks, ticks)
    if cells.polygon.name == "lshape":
        x, y = mesh.p[:, mesh.t].mean(axis=1)
        mesh = mesh.remove_elements(np.flatnonzero((x > 0) & (y < 0)))
    basis = skfem.Basis(mesh, skfem.ElementTriP2())
    A = laplace.assemble(basis) + mass.assemble(basis)

    @skfem.LinearForm
    def pairing(v, w):
        side, s = along(cells.polygon, w.x.reshape(2, -1).T)
        cell = np.searchsorted(cells.points, cells.polygon.starts[side] + s) - 1
        values = mu[cell] if case is None else case.boundary(side, s)[1] - mu[cell]
        return values.reshape(w.x[0].shape) * v

    right = pairing.assemble(skfem.FacetBasis(mesh, skfem.ElementTriP2(), intorder=12))
    return sqrt(right @ skfem.solve(A, right))


def along(polygon, points):
    """The sides on which the points (k, 2) lie, and their arc lengths from the sides' starts."""
    offset = points[:, None] - polygon.vertices[None]
    s = np.sum(offset * polygon.tangents, axis=2)
    inside = (s >= 0) & (s <= polygon.lengths)
    off = np.where(inside, np.abs(np.sum(offset * polygon.normals, axis=2)), np.inf)
    side = off.argmin(axis=1)
    assert off.min(axis=1).max() < 1e-12
    return side, s[np.arange(len(s)), side]


@pytest.mark.parametrize("m", [1, 2, 8, 12])
def test_the_norm_of_1_on_the_square_from_below(m):
    """The maximiser is smooth: P2 with at least 8 edges a side reaches it to 1e-6."""
    found = space_of("square", m).norm_lower(np.ones((1, 4 * m)))[0]
    assert found <= ONE_ON_THE_SQUARE * (1 + 1e-12)
    assert found >= ONE_ON_THE_SQUARE * (1 - 1e-6)


def test_the_weighted_l2_norm_is_not_this_norm():
    """Control: H^{1/2} ||1||_0 is too small by a factor of 5.8 at H = 1/8."""
    shortcut = sqrt(1 / 8) * sqrt(4)
    assert space_of("square", 8).norm_lower(np.ones((1, 32)))[0] / shortcut == pytest.approx(5.8, abs=0.05)


@pytest.mark.parametrize("m", [4, 12])
@pytest.mark.parametrize("name", ["alternating", "one cell", "random"])
def test_p0_data_on_one_side_against_the_cosine_series(m, name):
    """mu = sum a_k c_k(x) on the bottom: ||mu||^2 = sum a_k^2 coth(q_k) / q_k, q_k^2 = 1 + (k pi)^2."""
    mu = {
        "alternating": (-1.0) ** np.arange(m),
        "one cell": (np.arange(m) == 1).astype(float),
        "random": np.random.default_rng(1).standard_normal(m),
    }[name]
    k = np.arange(1, 20001)
    ends = np.sin(pi * np.outer(k, np.arange(m + 1) / m)) / (pi * k[:, None])
    a = np.concatenate([[mu.mean()], sqrt(2) * np.diff(ends, axis=1) @ mu])
    q = np.sqrt(1 + (pi * np.arange(len(a))) ** 2)
    exact = sqrt(np.sum(a**2 / (q * np.tanh(q))))
    found = space_of("square", m).norm_lower(np.concatenate([mu, np.zeros(3 * m)])[None])[0]
    assert 0.99 * exact <= found <= exact * (1 + 1e-6)  # the series' tail is below (m / 20000)^2


def test_the_norm_is_homogeneous_and_takes_many_at_once():
    mu = np.random.default_rng(0).standard_normal((3, 16))
    space = space_of("square", 4)
    found = space.norm_lower(mu)
    assert found.shape == (3,)
    np.testing.assert_allclose(space.norm_lower(-2.5 * mu), 2.5 * found, rtol=1e-12)
    np.testing.assert_allclose([space.norm_lower(each[None])[0] for each in mu], found, rtol=1e-12)
    assert space.norm_lower(np.zeros((1, 16)))[0] == 0


@pytest.mark.parametrize(
    ("cells", "n"),
    [
        (partition.uniform(named("square"), 1 / 8), 64),
        (partition.shifted(named("square"), 1 / 4, 0.5), 64),
        (partition.uniform(named("lshape"), 1 / 4), 32),
        (partition.uniform(named("square"), 1 / 12), 96),
    ],
    ids=["square", "shifted", "lshape", "not dyadic"],
)
def test_alternating_data_against_uniform_p2(cells, n):
    """The uniform meshes have 8 edges to a cell of length H everywhere; both resolve the norm to 1 %."""
    mu = alternating(cells)
    found = reference_space(cells).norm_lower(mu[None])[0]
    assert found == pytest.approx(uniform_p2(cells, n, mu), rel=0.01)


@pytest.mark.parametrize(("polygon", "m", "n"), [("square", 4, 96), ("lshape", 4, 64)])
def test_an_error_against_a_finer_uniform_p2(polygon, m, n):
    """lambda - Pi_H lambda of a case without singular points: from below, within 1 %."""
    case, cells = load("full_contact", polygon), partition.uniform(named(polygon), 1 / m)
    fine = uniform_p2(cells, n, on_cells(case, cells).lambda_means, case)
    found = projection_error(polygon, m, "full_contact")
    assert 0.99 * fine <= found <= fine


@pytest.mark.parametrize(
    ("polygon", "name"),
    [*(("square", name) for name in ("natural", "thirds", "smooth", "full_contact")), ("lshape", "thirds")],
)
def test_twice_the_edges_change_an_error_by_less_than_1_percent(polygon, name):
    coarse, fine = (projection_error(polygon, 16, name, edges) for edges in (8, 16))
    assert 0.99 * fine <= coarse <= fine


def test_two_edges_per_cell_would_not_do():
    """Control: the criterion above sees an unresolved norm."""
    coarse, fine = (projection_error("square", 16, "full_contact", edges) for edges in (1, 16))
    assert coarse < 0.95 * fine


def test_the_pairing_with_lambda_is_exact():
    """The shape functions sum to 1. natural: int lambda = int Delta u = 16; thirds: Euler's beta."""
    moment = gamma(3 / 4) * gamma(5) / gamma(3 / 4 + 5) / 2 * (1 / 4) ** 1.5
    for name, integral in (("natural", 16.0), ("thirds", moment)):
        total = space_of("square", 16, name)._flux_load(load(name)).sum()
        assert total == pytest.approx(integral, rel=1e-12)


@pytest.mark.parametrize(
    ("cells", "name"),
    [
        (partition.uniform(named("square"), 1 / 12), "natural"),
        (partition.shifted(named("square"), 1 / 4, 0.3), "thirds"),
        (partition.uniform(named("lshape"), 1 / 4), "thirds"),
    ],
    ids=["not dyadic", "shifted", "lshape"],
)
def test_the_boundary_edges_are_nested_in_the_cells_and_graded_to_singular_points(cells, name):
    singular = load(name, cells.polygon.name).flux_singular()
    space = reference_space(cells, singular)
    s, edges = space.mesh.s, np.diff(space.mesh.s)
    assert np.isin(cells.points, s).all()
    assert edges.max() <= cells.H / 8 * (1 + 1e-12)
    assert np.all((cells.points[space.cell] <= s[:-1]) & (s[1:] <= cells.points[space.cell + 1]))
    for point in singular:
        distance = np.abs(s - cells.polygon.starts[point.side] - point.t * cells.polygon.lengths[point.side])
        at = int(distance.argmin())
        assert distance[at] <= 1e-15
        assert max(edges[at], edges[at - 1]) <= cells.H / 8 / 2**8 * (1 + 1e-9)


def runs(cells, names, discrete):
    """What `dual_errors` reads of a scene's table: lambda_H = 0, padded by NaN to 100 cells."""
    lambda_H = np.full((len(names), 2, 1, 100), np.nan)
    lambda_H[..., : cells.n_cells] = 0.0
    run = ("case", "mesh", "partition")
    return xr.Dataset(
        {
            "hm12_discrete": (run, np.reshape(discrete, (len(names), 2, 1))),
            "lambda_H": ((*run, "cell"), lambda_H),
        },
        coords={"case": names, "h": ("mesh", [0.5, 0.25]), "H": ("partition", [cells.H])},
    )


def test_errors_of_a_table_only_where_lambda_is_judged():
    cells, names = partition.uniform(named("square"), 1 / 4), ["full_contact", "no_contact"]
    table = runs(cells, names, [[np.nan, 1e-9], [0.0, 0.0]])
    found = dual_errors(table, [load(name) for name in names], cells)["hm12_error_lower"].values[..., 0]
    assert np.array_equal(np.isnan(found), [[True, False], [False, False]])
    expected = space_of("square", 4).error_lower(load("full_contact"), np.zeros((1, 16)))[0]
    assert found[0, 1] == pytest.approx(expected, rel=1e-12)
    assert np.all(np.abs(found[1]) <= 1e-12)


def test_the_discrete_norm_is_a_lower_bound_too():
    """V_h is conforming; where it resolves mu better than the reference space its supremum is taken."""
    cells = partition.uniform(named("square"), 1 / 4)
    found = dual_errors(runs(cells, ["full_contact"], [10.0, 0.0]), [load("full_contact")], cells)
    assert found["hm12_error_lower"].values[0, 0, 0] == 10.0
    assert 0 < found["hm12_error_lower"].values[0, 1, 0] < 10.0


def test_a_singular_point_at_a_vertex_is_graded_to_from_both_sides():
    cells = partition.uniform(named("square"), 1 / 4)
    for point in (Singular(1, 0.0, 2), Singular(0, 1.0, 2), Singular(3, 1.0, 2)):
        s = reference_space(cells, [point]).mesh.s
        at = cells.polygon.arc_length(point.side, point.t) % 4
        away = np.sort(np.abs((s[:-1] - at + 2) % 4 - 2))
        np.testing.assert_allclose(away[:3], [0, 1 / 32 / 256, 1 / 32 / 256], atol=1e-14)


def test_the_upper_bound_is_not_known_here():
    cells = partition.uniform(named("square"), 1 / 4)
    found = dual_errors(runs(cells, ["no_contact"], [1.0, 1.0]), [load("no_contact")], cells)
    assert np.isnan(found["hm12_error_upper"]).all()


def test_no_reference_mesh_is_made_where_nothing_is_judged(monkeypatch):
    monkeypatch.setattr(dual_norm, "reference_space", lambda *_: pytest.fail("a mesh was made"))
    cells = partition.uniform(named("square"), 1 / 4)
    found = dual_errors(runs(cells, ["no_contact"], [np.nan, np.nan]), [load("no_contact")], cells)
    assert np.isnan(found["hm12_error_lower"]).all()
