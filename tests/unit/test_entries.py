"""Whatever is handed to a public function, it is taken or refused in one sentence: no other exception."""

import numpy as np
import pytest
import sentences

import unilateral as ul

pytestmark = pytest.mark.usefixtures("shared_cases")
MESH = ul.mesh([(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1, 2), (0, 2, 3)], halvings=1)
SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
SIZES = {"h": 1 / 4, "H": 1 / 2}


class Odd:
    """Of no use to anyone."""


ODD = [
    *(None, True, 1j, float("nan"), "", "x", b"x", [1], {1}, {1: 2}, Odd(), Odd, lambda: 1, iter([1]), ...),
    *(np.array([1, 2]), np.ma.masked, [Odd()]),
]


@pytest.fixture(scope="module")
def solution():
    return ul.solve("natural", **SIZES)


PLACES = {
    "Problem(polygon)": lambda odd: ul.Problem(odd, -1, 0),
    "Problem(f)": lambda odd: ul.Problem(SQUARE, odd, 0),
    "Problem(g)": lambda odd: ul.Problem(SQUARE, -1, odd),
    "Problem([g])": lambda odd: ul.Problem(SQUARE, -1, [odd] * 4),
    "Problem(free_sides)": lambda odd: ul.Problem(SQUARE, -1, 0, odd),
    "Problem([free side])": lambda odd: ul.Problem(SQUARE, -1, 0, [odd]),
    "Problem(name)": lambda odd: ul.Problem(SQUARE, -1, 0, name=odd),
    "Problem(k)": lambda odd: ul.Problem(SQUARE, -1, 0, k=odd),
    "Problem(c)": lambda odd: ul.Problem(SQUARE, -1, 0, c=odd),
    "Problem(q)": lambda odd: ul.Problem(SQUARE, -1, [0, 0, 0, None], [3], q=odd),
    "Problem(u)": lambda odd: ul.Problem(SQUARE, -1, 0, u=odd),
    "Problem(u of a side)": lambda odd: ul.Problem(SQUARE, -1, -1, u={1: odd}),
    "mesh(points)": lambda odd: ul.mesh(odd, MESH.triangles),
    "mesh(triangles)": lambda odd: ul.mesh(MESH.points, odd),
    "mesh(halvings)": lambda odd: ul.mesh(MESH, halvings=odd),
    "case(name)": ul.case,
    "case(polygon)": lambda odd: ul.case("natural", odd),
    "case(side)": lambda odd: ul.case("natural", side=odd),
    "case(free_sides)": lambda odd: ul.case("natural", free_sides=odd),
    "load": ul.load,
    "solve(problem)": lambda odd: ul.solve(odd, **SIZES),
    "solve(h)": lambda odd: ul.solve("natural", h=odd, H=1 / 2),
    "solve(H)": lambda odd: ul.solve("natural", h=1 / 4, H=odd),
    "solve(accuracy)": lambda odd: ul.solve("natural", accuracy=odd),
    "solve(norm)": lambda odd: ul.solve("natural", accuracy=0.5, norm=odd),
    "solve(norm) for sizes": lambda odd: ul.solve("natural", **SIZES, norm=odd),
    "solve(mesh)": lambda odd: ul.solve("natural", **SIZES, mesh=odd),
    "solve(stop)": lambda odd: ul.solve("natural", **SIZES, stop=odd),
    "solve(max_unknowns)": lambda odd: ul.solve("natural", accuracy=0.5, max_unknowns=odd),
    "solve(sharp)": lambda odd: ul.solve("natural", **SIZES, sharp=odd),
    "solve(dry_run)": lambda odd: ul.solve("natural", accuracy=0.5, dry_run=odd),
    "solve(begin)": lambda odd: ul.solve("natural", accuracy=0.5, begin=odd),
    "Stop(fraction)": lambda odd: ul.Stop(fraction=odd),
    "Stop(tolerance)": lambda odd: ul.Stop(tolerance=odd),
    "Stop(max_steps)": lambda odd: ul.Stop(max_steps=odd),
    "Stop(algorithm)": lambda odd: ul.Stop(algorithm=odd),
    "Stop(rho)": lambda odd: ul.Stop(rho=odd),
    "Solver(problem)": lambda odd: ul.Solver(odd, **SIZES),
    "Solver(mesh)": lambda odd: ul.Solver("natural", **SIZES, mesh=odd),
    "Solver(free_sides)": lambda odd: ul.Solver(MESH, H=1 / 2, free_sides=odd),
    "Solver(k)": lambda odd: ul.Solver(MESH, H=1 / 2, k=odd),
    "Solver(c)": lambda odd: ul.Solver(MESH, H=1 / 2, c=odd),
    "Solver(q)": lambda odd: ul.Solver(MESH, H=1 / 2, free_sides=[1], q=odd),
    "Solver(u)": lambda odd: ul.Solver(MESH, H=1 / 2, u=odd),
    "Solver(free_sides) of a case": lambda odd: ul.Solver("natural", **SIZES, free_sides=odd),
    "Solver(k) of a case": lambda odd: ul.Solver("natural", **SIZES, k=odd),
    "Solver(q) of a case": lambda odd: ul.Solver("natural", **SIZES, q=odd),
    "Solver(u) of a case": lambda odd: ul.Solver("natural", **SIZES, u=odd),
    "Solver()(f)": lambda odd: ul.Solver(MESH, H=1)(odd, 0),
    "Solver()(g)": lambda odd: ul.Solver(MESH, H=1)(-1, odd),
    "Solver()(q)": lambda odd: ul.Solver(MESH, H=1)(-1, 0, odd),
}
OF_SOLUTIONS = {
    "u_at": lambda s, odd: s.u_at(odd),
    "grad_at": lambda s, odd: s.grad_at(odd),
    "flux_at": lambda s, odd: s.flux_at(odd),
    "lambda_at(side)": lambda s, odd: s.lambda_at(odd, 0.1),
    "lambda_at(t)": lambda s, odd: s.lambda_at(0, odd),
    "forces": lambda s, odd: s.forces(sharp=odd),
    "force(sides)": lambda s, odd: s.force(sides=odd),
    "true_errors": lambda s, odd: s.true_errors(dual=odd),
    "save": lambda s, odd: s.save(odd),
    "plot": lambda s, odd: s.plot(odd),
}


def refusals(place):
    """What is said of each odd thing that is refused."""
    messages = []
    for odd in ODD:
        try:
            place(odd)
        except ul.InputError as error:
            messages.append(str(error))
    return messages


@pytest.mark.parametrize("name", PLACES)
def test_odd_arguments_are_taken_or_refused_in_one_sentence(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    message = refusals(PLACES[name])
    assert len(message) >= 5
    assert not [item for item in message if "\n" in item or len(item) > 400]


@pytest.mark.parametrize("name", OF_SOLUTIONS)
def test_odd_arguments_of_solutions_are_taken_or_refused_in_one_sentence(
    name, solution, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    message = refusals(lambda odd: OF_SOLUTIONS[name](solution, odd))
    assert len(message) >= 5
    assert not [item for item in message if "\n" in item or len(item) > 400]


def test_clamped_sides_are_refused_by_a_solver_as_by_a_problem():
    makers = (lambda u: ul.Solver(MESH, H=0.5, c=0, u=u), lambda u: ul.Problem(MESH, -1, -1, c=0, u=u))
    for sides in ([1], {1}, 3, np.array([1])):
        message = []
        for make in makers:
            with sentences.raises(ul.InputError) as error:
                make(sides)
            message.append(str(error.value))
        assert message[0] == message[1]
