"""Bounds on the errors of functions that other programs computed, against true errors where u is known."""

from __future__ import annotations

import copy
import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla
import sentences

import unilateral as ul
from unilateral.bounds.enclosed_data import enclose_data
from unilateral.discrete.problem_data import problem_form
from unilateral.fem.condense import form_matrix
from unilateral.fem.p1 import edge_load
from unilateral.solution.certification import pair_boundary_edges

pytestmark = pytest.mark.usefixtures("shared_cases")
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
GOOD = 1.25
"""docs/certificate.md promises that bounds are at most a quarter above the error of a good solution."""


class OtherSolver:
    """P1 with conditions at nodes, by an active set."""

    def __init__(self, problem, mesh):
        self.mesh = mesh
        form = problem_form(problem, self.mesh)
        self.A = form_matrix(self.mesh, form._replace(clamped=())).tocsr()
        enclosed = enclose_data(problem, self.mesh, form)
        self.F = enclosed.load
        self.u_D = enclosed.constraint.clamped_values
        self.fixed = form.clamped_nodes(self.mesh)
        first = self.mesh.boundary
        last = np.roll(self.mesh.boundary, -1)
        contact = form.has_multiplier(self.mesh.side)
        on_edges = problem.enclosed_obstacle.sample_on_edges(
            self.mesh.s, self.mesh.side, contact, n_intervals=1
        )
        at_ends = on_edges.ends[contact]
        self.g = np.full(self.mesh.n_nodes, -np.inf)
        np.maximum.at(self.g, first[contact], at_ends[:, 0])
        np.maximum.at(self.g, last[contact], at_ends[:, 1])
        self.lengths = np.zeros(self.mesh.n_nodes)
        for ends in (first, last):
            np.add.at(self.lengths, ends[contact], 0.5 * np.diff(self.mesh.s)[contact])
        self.candidates = np.isfinite(self.g) & ~self.fixed
        self.g = np.where(self.candidates, self.g, 0.0)

    def _linear(self, A, F, values, data):
        u = np.where(data, values, 0.0)
        u[~data] = spla.spsolve(A[~data][:, ~data].tocsc(), (F - A @ u)[~data])
        return u

    def solve_with_constraint(self, share=1.0):
        """u >= g at nodes, for a `share` of the load."""
        active = self.candidates
        for _ in range(50):
            u = self._linear(self.A, share * self.F, np.where(active, self.g, self.u_D), active | self.fixed)
            force = self.A @ u - share * self.F
            now = self.candidates & (force > u - self.g)
            if np.array_equal(now, active):
                return u
            active = now
        raise AssertionError("the active set has no end")

    def solve_with_penalty(self, parameter):
        """A penalty over h for u < g at nodes."""
        active = self.candidates
        for _ in range(50):
            push = np.where(active, parameter / self.mesh.h * self.lengths, 0.0)
            A = (self.A + sp.diags_array(push)).tocsr()
            u = self._linear(A, self.F + push * self.g, self.u_D, self.fixed)
            now = self.candidates & (u < self.g)
            if np.array_equal(now, active):
                return u
            active = now
        raise AssertionError("the active set has no end")

    def solve_with_noise(self):
        u = self.solve_with_constraint()
        noise = np.random.default_rng(0).standard_normal(len(u))
        return u + 0.01 * np.abs(u).max() * np.where(self.fixed, 0.0, noise)


def mesh_of(problem, n):
    return ul.Solver(problem, h=1 / n, H=2 / n).mesh


def certify_quietly(problem, mesh, u, **options):
    """The solution, whatever is warned of."""
    with warnings.catch_warnings(action="ignore", category=ul.SolutionWarning):
        return ul.certify(problem, mesh, u, **options)


def index(computed):
    """The bound over the true error, which is known for a case."""
    return computed.bounds.u / computed.true_errors(dual=False).h1


@pytest.fixture(scope="module")
def natural():
    return ul.case("natural")


@pytest.fixture(scope="module")
def other_solver(natural):
    mesh = mesh_of(natural, 16)
    return mesh, OtherSolver(natural, mesh)


METHODS = {
    "constraints at nodes": (lambda solver: solver.solve_with_constraint(), GOOD),
    "penalty 10/h": (lambda solver: solver.solve_with_penalty(10), math.inf),
    "penalty 1000/h": (lambda solver: solver.solve_with_penalty(1000), GOOD),
    "half the load": (lambda solver: solver.solve_with_constraint(0.5), GOOD),
    "no load": (lambda solver: solver.solve_with_constraint(0.0), math.inf),
    "noise of 1 %": (lambda solver: solver.solve_with_noise(), GOOD),
}


@pytest.mark.parametrize(("method", "limit"), METHODS.values(), ids=METHODS)
def test_bounds_are_above_the_true_errors_and_near_them(method, limit, natural, other_solver):
    mesh, solver = other_solver
    certificate = certify_quietly(natural, mesh, method(solver))
    assert 1 <= index(certificate) <= limit
    assert certificate.true_errors(dual=False).h1 <= certificate.sharp_bounds.u <= certificate.bounds.u


def test_half_the_load_is_seen(natural, other_solver):
    """Its true error is nine times that of the right solution."""
    mesh, solver = other_solver
    right = certify_quietly(natural, mesh, solver.solve_with_constraint(1.0)).bounds.u
    half = certify_quietly(natural, mesh, solver.solve_with_constraint(0.5)).bounds.u
    assert half > 5 * right


def test_of_this_project_s_own_solution_the_bounds_are_its_own(natural):
    s = ul.solve(natural, h=1 / 16, H=1 / 8)
    certificate = ul.certify(natural, s.mesh, s.u)
    assert np.array_equal(certificate.multiplier, s.multiplier)
    assert certificate.bounds.u == pytest.approx(s.bounds.u, rel=1e-12)
    assert certificate.sharp_bounds.u == pytest.approx(s.sharp_bounds.u, rel=1e-12)


def test_the_index_does_not_grow_on_finer_meshes(natural):
    """Control: with the flux of u itself it does, because u is in no equilibrium with lambda_H."""
    indices = []
    own_flux = []
    for n in (8, 16, 32):
        mesh = mesh_of(natural, n)
        certificate = certify_quietly(natural, mesh, OtherSolver(natural, mesh).solve_with_constraint())
        indices.append(index(certificate))
        exact_slopes = replace(certificate.bounded, potential=None).local_bound
        own_flux.append(exact_slopes.u / certificate.true_errors(dual=False).h1)
    assert max(indices) == indices[0]
    assert own_flux[2] > 1.2 * indices[2]
    assert np.all(np.diff(np.divide(own_flux, indices)) > 0)


K_AND_C = [(1, 0), (1, 1), (1, 100), (1000, 1), (0.01, 0), (0.1, 0.001)]
RULE = [
    (weight, b0, b1, 1 - b0 - b1)
    for weight, orbit in [
        (0.109951743655322, 0.091576213509771),
        (0.223381589678011, 0.445948490915965),
    ]
    for b0, b1 in [(orbit, orbit), (orbit, 1 - 2 * orbit), (1 - 2 * orbit, orbit)]
]
"""Dunavant's rule of degree 4 on triangles: exact for squares of quadratic functions."""


def make_clamped_problem(k, c):
    """u = x^2 + y: clamped at x = 0, in contact at x = 1 with lambda = 2 k, given fluxes -k and k."""
    f = f"-2*{k} + {c}*(x**2 + y)"
    return ul.Problem(
        SQUARE, f, [None, "1 + y", None, None], [0, 2], k=k, c=c, q=[-k, None, k, None], u={3: "y"}
    )


def error(mesh, u, k, c):
    """The energy norm of x^2 + y - u, for u (n,) at the nodes of the mesh."""
    corners = mesh.points[mesh.triangles]
    values = u[mesh.triangles]
    sides = corners[:, 1:] - corners[:, :1]
    slopes = np.linalg.solve(sides, (values[:, 1:] - values[:, :1])[..., None])[..., 0]
    area = np.linalg.det(sides) / 2
    square = 0.0
    for weight, *place in RULE:
        (x, y) = np.einsum("mid,i->dm", corners, place)
        position = values @ place
        gradient = (2 * x - slopes[:, 0]) ** 2 + (1 - slopes[:, 1]) ** 2
        square += weight * float(area @ (k * gradient + c * (x**2 + y - position) ** 2))
    return math.sqrt(square)


def shuffle_nodes(mesh, seed=1):
    """Points and triangles with the nodes in a random order, and the old number of each node."""
    old = np.random.default_rng(seed).permutation(mesh.n_nodes)
    return (mesh.points[old], np.argsort(old)[mesh.triangles]), old


@pytest.mark.parametrize(("k", "c"), K_AND_C)
def test_bounds_hold_with_coefficients_clamped_sides_and_nodes_in_any_order(k, c):
    problem = make_clamped_problem(k, c)
    mesh = mesh_of(problem, 8)
    solver = OtherSolver(problem, mesh)
    (arrays, old) = shuffle_nodes(mesh)
    for share in (0.5, 1.0):
        u = solver.solve_with_constraint(share)
        certificate = ul.certify(problem, arrays, u[old])
        assert np.allclose(certificate.u, u[old], rtol=1e-14, atol=0)
        assert 1 <= certificate.bounds.u / error(mesh, u, k, c) <= GOOD
        force = certificate.forces()
        assert force.whole.lower <= 2 * k <= force.whole.upper
        assert force.reactions[3,].lower <= 0 <= force.reactions[3,].upper
    assert (
        certify_quietly(problem, arrays, u).bounds.u > 10 * certificate.bounds.u
    )  # control: in the order of `mesh`


def test_other_values_on_clamped_sides_are_counted():
    problem = make_clamped_problem(1, 1)
    mesh = mesh_of(problem, 16)
    u = OtherSolver(problem, mesh).solve_with_constraint()
    u[mesh.points[:, 0] == 0] += 0.01
    assert error(mesh, u, 1, 1) <= certify_quietly(problem, mesh, u).bounds.u


def test_u_above_the_given_values_says_nothing_of_the_gap_at_a_clamped_vertex():
    """u = 5 is lowered to 0 on side 3, so that it is less than 1 above g near the ends of this side."""
    problem = ul.Problem(SQUARE, 0, -1, [1], c=0, u={3: 0})
    mesh = mesh_of(problem, 4)
    ends = certify_quietly(problem, mesh, np.full(mesh.n_nodes, 5.0)).solved.bound().clamped_ends
    assert np.all(ends.gamma[[0, 3]] <= 1 + 1e-12)


def test_a_multiplier_takes_the_place_of_lambda_h():
    """lambda = 2 on side 1. One that is larger by 1 there is that far from it: by <1, x> / |||x|||."""
    problem = make_clamped_problem(1, 1)
    mesh = mesh_of(problem, 16)
    u = OtherSolver(problem, mesh).solve_with_constraint()
    exact = np.where(mesh.side == 1, 2.0, math.nan)
    right = ul.certify(problem, mesh, u, exact)
    wrong = ul.certify(problem, mesh, u, exact + 1)
    for computed in (right, wrong):
        assert computed.unique
        assert error(mesh, u, 1, 1) <= computed.bounds.u
        assert computed.force().lower <= 2 <= computed.force().upper
    assert np.array_equal(right.multiplier, np.where(mesh.side == 3, math.nan, np.nan_to_num(exact)), True)
    assert right.bounds.u <= GOOD * error(mesh, u, 1, 1)
    assert right.bounds.multiplier < 0.1 < 1 / math.sqrt(4 / 3) <= wrong.bounds.multiplier


def test_the_potential_of_a_multiplier_solves_the_linear_problem():
    problem = make_clamped_problem(3, 2)
    mesh = mesh_of(problem, 8)
    values = np.where(mesh.side == 1, 1 + np.arange(len(mesh.side)) % 3, 0.0)
    solver = OtherSolver(problem, mesh)
    certificate = certify_quietly(problem, mesh, np.zeros(mesh.n_nodes), multiplier=values)
    ends = np.column_stack([values, values])
    remaining = solver.A @ certificate.solved.potential - solver.F - edge_load(solver.mesh, ends)
    assert np.abs(remaining[~solver.fixed]).max() < 1e-12 * np.abs(solver.F).max()


def test_cells_have_two_edges_or_three_at_the_end_of_a_side_and_one_if_there_is_no_more():
    points = [(0, 0), (0.2, 0), (0.5, 0), (1, 0), (1, 0.4), (1, 1)]
    mesh = ul.mesh(points, [(0, 1, 5), (1, 2, 5), (2, 4, 5), (2, 3, 4)])
    assert pair_boundary_edges(mesh).points == pytest.approx([0, 1, 2, 2 + math.sqrt(2)])
    finer = ul.mesh(mesh, halvings=1)
    assert pair_boundary_edges(finer).points[:7] == pytest.approx([0, 0.2, 0.5, 1, 1.4, 2, 2 + math.sqrt(2)])


def test_a_side_of_one_edge_is_told_of_and_bounds_hold(natural):
    mesh = ul.mesh(SQUARE, [(0, 1, 2), (0, 2, 3)])
    with pytest.warns(ul.SolutionWarning, match="may not be unique.*halvings=1"):
        certificate = ul.certify(natural, mesh, np.ones(4))
    assert index(certificate) >= 1


def test_a_mesh_without_a_node_in_contact_is_refused_with_what_mends_it():
    problem = ul.Problem([(0, 0), (1, 0), (0, 1)], 1, [-1, None, None], u={1: 0, 2: 0})
    mesh = ul.mesh(problem.polygon.vertices, [(0, 1, 2)])
    with sentences.raises(ul.InputError):
        ul.certify(problem, mesh, np.zeros(3))
    certify_quietly(problem, ul.mesh(mesh, halvings=1), np.zeros(6))


def test_a_solution_that_penetrates_far_is_told_of(natural, other_solver):
    mesh, solver = other_solver
    with pytest.warns(ul.SolutionWarning, match="on the error of u comes from places where u < g"):
        ul.certify(natural, mesh, solver.solve_with_penalty(10))
    ul.certify(natural, mesh, solver.solve_with_constraint())  # control: no warning


def test_shares_say_where_the_error_is(natural, other_solver):
    mesh, solver = other_solver
    u = solver.solve_with_constraint()
    node = int(np.argmin(np.hypot(*(mesh.points - 0.5).T)))
    wrong = ul.certify(natural, mesh, u + (np.arange(len(u)) == node))
    there = np.any(mesh.triangles == node, axis=1)
    assert wrong.error_shares.sum() == pytest.approx(1)
    assert wrong.error_shares[there].sum() > 0.9
    assert ul.certify(natural, mesh, u).error_shares[there].sum() < 0.1  # control


def test_it_is_kept_as_what_it_is(natural, other_solver):
    mesh, solver = other_solver
    certificate = ul.certify(natural, mesh, solver.solve_with_constraint(0.5))
    again = copy.deepcopy(certificate)
    assert "\n  u                of another program\n" in repr(again)
    assert again.bounds == certificate.bounds
    assert np.array_equal(again.flux_at((0.5, 0.5)), certificate.flux_at((0.5, 0.5)))
    record = certificate.certificate()
    assert record["foreign"]
    assert math.isnan(record["algebraic_bound"])
    original = ul.solve(natural, h=1 / 16, H=1 / 8)  # control
    assert not original.certificate()["foreign"]
    assert "another program" not in repr(original)


def test_files_have_the_shares(natural, other_solver, tmp_path):
    meshio = pytest.importorskip("meshio")
    mesh, solver = other_solver
    certificate = ul.certify(natural, mesh, solver.solve_with_constraint())
    certificate.save(tmp_path / "u.vtu")
    stored_shares = meshio.read(tmp_path / "u.vtu").cell_data_dict["error_share"]
    assert np.array_equal(stored_shares["triangle"], certificate.error_shares)
    assert np.isnan(stored_shares["line"]).all()


def mask_every_third(n):
    return np.ma.masked_array(np.zeros(n), mask=np.arange(n) == 3)


REFUSED = {
    "of another size": (lambda n: np.zeros(n + 1), r"u has the shape \(290,\); it has to be \(289,\)"),
    "of two rows": (lambda n: np.zeros((n, 1)), r"u has the shape \(289, 1\)"),
    "not finite": (
        lambda n: np.where(np.arange(n) == 5, math.nan, 0.0),
        r"u\[5\] is nan; it has to be finite",
    ),
    "infinite": (lambda n: np.full(n, math.inf), r"u\[0\] is inf; it has to be finite"),
    "huge": (lambda n: np.full(n, -1e200), r"u\[0\] is -1e\+200; it has to be finite, below 1e\+100"),
    "masked": (mask_every_third, "u: 1 of 289 numbers are masked"),
    "integers": (lambda n: np.zeros(n, dtype=int), "u: the values are integers"),
    "a text": (lambda n: "u", "u: it is 'u'"),
}


@pytest.mark.parametrize(("u", "message"), REFUSED.values(), ids=REFUSED)
def test_u_that_does_not_fit_is_refused(u, message, natural, other_solver):
    with pytest.raises(ul.InputError, match=message):
        ul.certify(natural, other_solver[0], u(289))


@pytest.mark.parametrize(
    "change",
    [
        lambda mesh: -1.0 * (mesh.side == 1),
        lambda mesh: 1.0 * (mesh.side == 0),
        lambda mesh: np.full(64, math.nan),
        lambda mesh: np.zeros(4),
    ],
)
def test_a_multiplier_that_does_not_fit_is_refused(change):
    problem = make_clamped_problem(1, 1)
    mesh = mesh_of(problem, 16)
    with sentences.raises(ul.InputError):
        ul.certify(problem, mesh, np.zeros(mesh.n_nodes), change(mesh))


def test_without_contact_the_problem_is_linear():
    """u = 1 is the solution: the bound is rounding. Control: u = 1.1, whose error is 0.1."""
    problem = ul.Problem(SQUARE, 1, free_sides=[0, 1, 2, 3])
    mesh = mesh_of(problem, 4)
    for multiplier in (None, np.zeros(len(mesh.side))):
        assert ul.certify(problem, mesh, np.ones(mesh.n_nodes), multiplier).bounds.u < 1e-9
        assert 0.1 <= ul.certify(problem, mesh, np.full(mesh.n_nodes, 1.1), multiplier).bounds.u < 0.1 + 1e-9


def test_functions_are_certified_by_their_values_at_the_nodes(natural):
    """Bit for bit as the arrays of these values."""
    mesh = mesh_of(natural, 4)
    x, y = mesh.points.T
    functions = ul.Problem(SQUARE, np.hypot, 0)
    arrays = ul.Problem(mesh, np.hypot(x, y), 0)
    certificate = ul.certify(functions, mesh, x / 9)
    expected = ul.certify(arrays, mesh, x / 9)
    assert certificate.bounds == expected.bounds
    assert "f                linear between the nodes of the mesh" in repr(certificate)


def test_a_mesh_of_another_polygon_is_refused(natural):
    triangle = ul.mesh([(0, 0), (1, 0), (0, 1)], [(0, 1, 2)])
    with sentences.raises(ul.InputError):
        ul.certify(natural, triangle, np.zeros(3))
    with sentences.raises(ul.InputError):
        ul.certify(7, triangle, np.zeros(3))
    for components in ((), (triangle.points,), (triangle.points, triangle.triangles, 0)):
        with sentences.raises(ul.InputError):
            ul.certify(natural, components, np.zeros(3))


def test_a_problem_of_a_mesh_takes_this_mesh_only(natural, other_solver):
    mesh, _ = other_solver
    problem = ul.Problem(mesh, f=np.full(mesh.n_nodes, -1.0), g=-0.1)
    s = ul.solve(problem, H=1 / 8)
    for same in (mesh, (mesh.points, mesh.triangles)):
        assert ul.certify(problem, same, s.u).bounds.u == pytest.approx(s.bounds.u, rel=1e-12)
    with sentences.raises(ul.InputError):
        ul.certify(problem, mesh_of(natural, 8), np.zeros(81))
