"""f, g and q as values at nodes, of arrays or functions, alone and beside formulas: bounds and refusals."""

import re
from fractions import Fraction

import numpy as np
import pytest
import sentences

import unilateral as ul
from unilateral.fem.p1 import energy_norm
from unilateral.formulas.taylor import affine_model, monomial_basis
from unilateral.problems.nodal import NodalTrace

KITE = [(0, 0), (1.1, -0.3), (1.4, 1.2), (0.2, 0.8)]
TWO = [(0, 1, 2), (0, 2, 3)]
COEFFICIENTS = [{}, {"k": 3, "c": "1/7"}]
EXACTLY = ul.Stop(tolerance=1e-10)
MESH = ul.mesh(KITE, TWO, halvings=3)
X, Y = MESH.points.T


def solve_exactly(f, g, mesh=MESH, **options):
    return ul.solve(ul.Problem(mesh, f, g, **options), H=0.3, stop=EXACTLY)


@pytest.mark.parametrize("data", COEFFICIENTS)
def test_arrays_give_the_solution_of_their_formulas(data):
    """Of linear ones, which the arrays hold exactly. Each in place of each, everywhere or on sides."""
    free = {"free_sides": [2], **data}
    expected = solve_exactly("3*x - 2", "-y/4", q="x", **free)
    ways = [
        (3 * X - 2, -Y / 4, X),
        (3 * X - 2, "-y/4", "x"),
        ("3*x - 2", -Y / 4, "x"),
        ("3*x - 2", ["-y/4", -Y / 4, None, "-y/4"], [None, None, X, None]),
        (lambda x, y: 3 * x - 2, -Y / 4, X),
        (3 * X - 2, lambda x, y: -y / 4, X),
        (3 * X - 2, [-Y / 4, "-y/4", None, lambda x, y: -y / 4], lambda x, y: x),
    ]
    for f, g, q in ways:
        s = solve_exactly(f, g, q=q, **free)
        np.testing.assert_allclose(s.u, expected.u, rtol=0, atol=1e-11)
        assert s.bounds.u == pytest.approx(expected.bounds.u, rel=1e-8)
        assert s.bounds.multiplier == pytest.approx(expected.bounds.multiplier, rel=1e-8)
        assert s.bounds.unknown < 1e-10


def wave(x, y):
    return 6 * np.sin(7 * x) - 4 * np.exp(y) * (x > 0.5)


def bowl(x, y):
    return 0.1 * (x - 0.7) ** 2 - 0.3 * np.cos(5 * y) / 7


@pytest.mark.parametrize("units", COEFFICIENTS)
@pytest.mark.parametrize("way", ["made of the mesh", "solved on the mesh", "of a solver", "on sizes"])
def test_functions_are_the_arrays_of_their_values(units, way):
    """Bit for bit, with their bounds, which are those of the functions that are linear between the nodes.

    Control: the formula of the same f has another solution and other bounds.
    """
    fields = {"free_sides": [2], "u": {3: bowl}, **units}
    arrays = {"free_sides": [2], "u": {3: bowl(X, Y)}, **units}
    mesh = MESH
    if way == "on sizes":
        mesh = ul.solve(ul.Problem(KITE, -1, 0), h=0.2, H=0.3).mesh
        arrays["u"] = {3: bowl(*mesh.points.T)}
    x, y = mesh.points.T
    expected = ul.solve(ul.Problem(mesh, wave(x, y), bowl(x, y), q=wave(x, y), **arrays), H=0.3)
    domain = mesh if way == "made of the mesh" else KITE
    if way == "of a solver":
        s = ul.Solver(mesh, H=0.3, **fields)(wave, bowl, wave)
    elif way == "on sizes":
        s = ul.solve(ul.Problem(domain, wave, bowl, q=wave, **fields), h=0.2, H=0.3)
    else:
        s = ul.solve(
            ul.Problem(domain, wave, bowl, q=wave, **fields), H=0.3, mesh="" if domain is mesh else mesh
        )
    assert np.array_equal(s.u, expected.u)
    np.testing.assert_array_equal(s.multiplier, expected.multiplier)  # NaN is on sides without one
    assert s.bounds == expected.bounds
    assert s.sharp_bounds == expected.sharp_bounds
    assert "linear between the nodes of the mesh" in repr(s.problem)
    np.testing.assert_array_equal(s.problem.mesh.points, mesh.points)
    linear = ul.solve(ul.Problem(mesh, "3*x - 2", bowl(x, y), q=wave(x, y), **arrays), H=0.3)
    assert not np.array_equal(s.u, linear.u)
    assert s.bounds != linear.bounds


def test_the_bound_of_a_function_is_not_that_of_its_values_between_the_nodes():
    """f is 0 at all nodes: the bound is for f = 0, and the output says so. Control: the formula."""
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    s = ul.solve(ul.Problem(square, lambda x, y: 1000 * np.sin(40 * np.pi * x) ** 2, -9), h=1 / 4, H=1 / 2)
    exact = ul.solve(ul.Problem(square, "1000*sin(40*pi*x)**2", -9), h=1 / 4, H=1 / 2)
    assert s.bounds.u < 1e-9 < 1 < exact.bounds.u
    assert "f                linear between the nodes of the mesh" in str(s)
    assert s.certificate()["linear_between_nodes"] == ["f"]
    assert exact.certificate()["linear_between_nodes"] == []


def draw_kinked_values(seed, n):
    """Values that jump from node to node, f of both signs."""
    rng = np.random.default_rng(seed)
    return rng.uniform(-20, 10, n), rng.uniform(-0.6, 0, n), rng.uniform(-1, 2, n)


def prolong_values(mesh, values, finer):
    """The same functions at the nodes of a mesh that was refined, each of them the middle of an edge."""
    prolonged = np.zeros(finer.n_nodes)
    prolonged[: mesh.n_nodes] = values
    for step in finer.steps[len(mesh.steps) :]:
        prolonged[step.n_old_nodes : step.n_old_nodes + len(step.ends)] = prolonged[step.ends].mean(axis=1)
    return prolonged


@pytest.mark.parametrize("data", COEFFICIENTS)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("way", ["arrays", "a formula of g"])
def test_the_bounds_hold_for_the_functions_that_arrays_stand_for(data, seed, way):
    """These are the same on a mesh three times halved, where the bound is far smaller.

    So the distance of both solutions is at most the sum of the bounds. The sharp ones exceed the errors by
    less than half elsewhere, so twice the distance and the smaller bound are a control.
    """
    mesh = ul.mesh([(0, 0), (1, 0), (1, 1), (0, 1)], TWO, halvings=2)
    finer = ul.mesh(mesh, halvings=3)
    f, g, q = draw_kinked_values(seed, mesh.n_nodes)
    data = {"free_sides": [2], **data}

    def solve_on(grid, H):
        obstacle = "-x/4 - y/9" if way == "a formula of g" else prolong_values(mesh, g, grid)
        source = prolong_values(mesh, f, grid)
        flux = prolong_values(mesh, q, grid)
        return ul.solve(ul.Problem(grid, source, obstacle, q=flux, **data), H=H)

    coarse = solve_on(mesh, 1 / 2)
    fine = solve_on(finer, 1 / 16)
    fine_mesh = fine.solved.mesh
    away = fine.solved.u_h - prolong_values(mesh, coarse.solved.u_h, finer)
    distance = energy_norm(fine_mesh, away, fine.solved.form)
    assert fine.sharp_bounds.u < 0.3 * coarse.sharp_bounds.u
    for bound in (coarse.bounds, coarse.sharp_bounds):
        assert distance <= bound.u + fine.sharp_bounds.u
    assert coarse.sharp_bounds.u <= 2 * distance + fine.sharp_bounds.u
    first = coarse.forces(sharp=True).whole
    second = fine.forces(sharp=True).whole
    assert max(first.lower, second.lower) <= min(first.upper, second.upper)


def test_the_means_and_the_load_of_functions_beside_arrays_see_every_node():
    """g is a hat that is inside of a cell; control: the rule of a cell alone would not be exact."""
    g = np.zeros(MESH.n_nodes)
    node = MESH.boundary[np.argmin(np.abs(MESH.s - 0.55))]
    g[node] = 1.0
    solver = ul.Solver(MESH, H=0.6, stop=EXACTLY)
    functions = solver.matrices(lambda x, y: x, g)
    arrays = solver.matrices(X, g)
    np.testing.assert_allclose(functions.g, arrays.g, rtol=0, atol=1e-15)
    np.testing.assert_allclose(functions.F, arrays.F, rtol=0, atol=1e-15)
    assert functions.H @ functions.g == pytest.approx(float((solver.matrices(0, 0).B @ g).sum()), rel=1e-13)
    assert functions.g.max() > 0.1


def test_values_that_are_not_needed_are_not_read():
    """g inside, and on free sides but for their ends."""
    g = np.full(MESH.n_nodes, np.nan)
    nodes = MESH.boundary[np.isin(MESH.side, [0, 1, 3])]
    ends = MESH.boundary[np.searchsorted(MESH.s, MESH.polygon.starts[[2, 3]])]
    g[nodes] = g[ends] = -0.1
    s = solve_exactly(-1, g, free_sides=[2])
    np.testing.assert_allclose(s.u, solve_exactly(-1, "-1/10", free_sides=[2]).u, rtol=0, atol=1e-11)


def test_the_model_of_a_trace_contains_its_values():
    """In rational arithmetic, at random places of each edge."""
    rng = np.random.default_rng(3)
    t = np.concatenate([[0.0], np.sort(rng.uniform(0, 1, 6)), [1.0]])
    values = rng.standard_normal(8) * 10.0 ** rng.integers(-3, 3, 8)
    a = t[:-1]
    b = t[1:]
    model = NodalTrace(t, values).value_model(
        affine_model(monomial_basis(1, 3), 0.5 * (a + b), 0.5 * (b - a)[None], (a, b))
    )
    exact = [[Fraction(x) for x in numbers.tolist()] for numbers in (t, values)]
    for i in range(7):
        for sigma in (Fraction(-1), Fraction(1), Fraction(rng.uniform(-1, 1))):
            place = (exact[0][i] + exact[0][i + 1]) / 2 + sigma * (exact[0][i + 1] - exact[0][i]) / 2
            share = (place - exact[0][i]) / (exact[0][i + 1] - exact[0][i])
            value = exact[1][i] + share * (exact[1][i + 1] - exact[1][i])
            near = sum(Fraction(c) * sigma**k for k, c in enumerate(model.c[:, i].tolist()))
            assert abs(value - near) <= Fraction(model.rad[i])
            assert model.range[0][i] <= value <= model.range[1][i]
    assert model.rad.max() < 1e-12 * np.abs(values).max()


def test_the_model_of_a_slope_contains_it():
    """In rational arithmetic. On edges of 1e-6 beside long ones values of 1e6 make steep slopes."""
    rng = np.random.default_rng(4)
    t = np.array([0.0, 1e-6, 0.3, 0.3 + 1e-6, 0.9, 1.0])
    values = rng.standard_normal(6) * 10.0 ** rng.integers(-6, 6, 6)
    a = t[:-1]
    b = t[1:]
    model = NodalTrace(t, values).slope_model(
        affine_model(monomial_basis(1, 3), 0.5 * (a + b), 0.5 * (b - a)[None], (a, b))
    )
    places = [Fraction(x) for x in t.tolist()]
    heights = [Fraction(x) for x in values.tolist()]
    for i in range(5):
        slope = (heights[i + 1] - heights[i]) / (places[i + 1] - places[i])
        assert abs(slope - Fraction(model.c[0, i])) <= Fraction(model.rad[i])
        assert model.range[0][i] <= slope <= model.range[1][i]
        assert model.rad[i] <= 1e-13 * np.abs(values[i : i + 2]).sum() / (b - a)[i]


def test_a_slope_is_not_known_better_than_its_values():
    """1 + 2^-52 and 1: their difference is rounded like them, and steep over 1e-6."""
    t = np.array([0.0, 1e-6, 1.0])
    model = NodalTrace(t, np.array([1 + 2.0**-52, 1.0, 1.0])).slope_model(
        affine_model(monomial_basis(1, 3), np.array([5e-7]), np.array([[5e-7]]), (t[:1], t[1:2]))
    )
    assert model.rad[0] >= 4 * 2.0**-53 / 1e-6


@pytest.mark.parametrize(
    ("f", "g", "message"),
    [
        (
            np.zeros(5),
            0,
            "field f: the array has the shape (5,); it has to be (81,), a value for each of mesh.",
        ),
        (np.zeros((81, 1)), 0, "field f: the array has the shape (81, 1)"),
        (np.where(X > 1, np.nan, X), 0, "field f: the array is nan at node"),
        (X + 1j, 0, "field f: it holds values of the type complex128; it has to be an array of real numbers"),
        (X.astype(str), 0, "it has to be an array of real numbers"),
        (0, np.zeros(len(MESH.boundary)), "field g: the array has the shape (32,); it has to be (81,)"),
        (0, [0, np.where(X > 1, np.inf, X), 0, 0], "field g[1]: the array is inf at node"),
        (0, [X, 1, X, X], "field g: it jumps at vertex 1"),
        (0, [X, X], "field g: 2 formulas for 4 sides"),
        (1e300 * X, 0, "field f: it is as large as"),
        ([1, 2], 0, "field f: it is [1, 2]; it has to be a formula, a function or an array of values at"),
        (0, [0, {}, 0, 0], "field g[1]: it is {}; a table is {table: surface.csv}, or"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(f, g, message):
    with pytest.raises(ul.InputError, match=re.escape(message)):
        ul.Problem(MESH, f, g)
    with pytest.raises(ul.InputError, match=re.escape(message)):
        ul.Solver(MESH, H=0.3)(f, g)


def test_an_array_without_a_mesh_is_refused():
    with sentences.raises(ul.InputError, "mesh"):
        ul.Problem(KITE, X, 0)
    with sentences.raises(ul.InputError, "mesh"):
        ul.Problem(KITE, 0, [0, 0, X, 0])
    assert ul.Problem(KITE, np.float64(3), np.array(0)).f.rational == 3


@pytest.mark.parametrize("data", [-0.002, "-1/500", lambda x, y: 0 * x - 0.002, 0 * X - 0.002])
def test_an_obstacle_on_a_free_side_is_refused_however_it_is_given(data):
    """As one on a clamped side. Control: null there, and one for all sides, which is for the other ones."""
    with sentences.raises(ul.InputError, "g[3]", "free_sides"):
        ul.Problem(MESH, -1, [-0.001, None, None, data], free_sides=[1, 2, 3])
    solver = ul.Solver(MESH, H=0.3, free_sides=[1, 2, 3])
    with sentences.raises(ul.InputError, "g[3]", "free_sides"):
        solver(-1, [-0.001, None, None, data])
    with sentences.raises(ul.InputError, "g[3]", "clamped"):
        ul.Problem(MESH, -1, [-0.001, None, None, data], free_sides=[1, 2], u={3: 0})
    for accepted in ([data, None, None, None], data):
        assert ul.Problem(MESH, -1, accepted, free_sides=[1, 2, 3]).free_sides == (1, 2, 3)
