"""The heat equation of docs/time-steps.md: bounds on steps of all lengths, beside steps on a finer mesh."""

import contextlib
import io

import numpy as np
import pytest
from documents import blocks

import unilateral as ul
from unilateral.bounds import equilibrated_flux, flux_residuals
from unilateral.fem.form import Form
from unilateral.fem.p1 import energy_norm, stiffness_and_mass

LENGTHS = [1.0, 1e-2, 1e-4, 1e-6, 1e-8]
"""The first four are on the page, too."""


def follow(n, factor=-6):
    """The names of the page's program for the heat equation, with edges of 1/n, and that factor of x."""
    programs = [block.text for block in blocks("docs/time-steps.md") if "make_solver(dt)" in block.text]
    text = programs[0].replace("h=1 / 32, H=1 / 16", f"h=1 / {n}, H=2 / {n}").replace("-6 *", f"{factor} *")
    names = {"np": np, "ul": ul}
    with contextlib.redirect_stdout(io.StringIO()):
        exec(text, names)
    return names


@pytest.fixture(scope="module")
def page():
    return follow(8)


def steps(page, dt, factor=2):
    """The step of the page with `factor` times the loss, and the one with twice the loss on a finer mesh."""
    before = page["step"]
    step = page["make_solver"](dt)(f=factor * page["loss"] + before.u / dt, g=page["heater"])
    finer = ul.mesh(before.mesh.points, before.mesh.triangles, halvings=3)
    problem = ul.Problem(
        finer,
        f=-12 * finer.points[:, 0] + before.u_at(finer.points) / dt,
        g=page["heater"],
        free_sides=[1, 3],
        u={0: 1},
        c=1 / dt,
    )
    return step, ul.solve(problem, H=1 / 32)


def distance(step, fine, dt):
    """The distance of both in the energy norm of the step."""
    return energy_norm(fine.mesh, step.u_at(fine.mesh.points) - fine.u, Form(c=1 / dt))


@pytest.mark.parametrize("dt", LENGTHS)
def test_the_bound_on_a_step_is_near_its_error(dt, page):
    """The true error is the distance up to the error on the finer mesh; the quotient is at most 10.

    The forces of both have a number in common.
    """
    step, fine = steps(page, dt)
    apart = distance(step, fine, dt)
    assert apart <= step.bounds.u + fine.bounds.u
    assert step.bounds.u <= 10 * apart
    forces = step.force(), fine.force()
    assert max(force.lower for force in forces) <= min(force.upper for force in forces)


def test_the_bound_on_a_step_with_another_loss_is_too_small(page):
    """Control."""
    step, fine = steps(page, 1.0, factor=1)
    assert distance(step, fine, 1.0) > step.bounds.u + fine.bounds.u


def test_the_bound_on_all_steps_holds(page):
    """Both meshes are as far from exact steps as their bounds say. Control: with a third of the loss not."""
    fine = follow(32)
    mesh = fine["solver"].mesh

    def measure_difference(coarse):
        difference = coarse["step"].u_at(mesh.points) - fine["u"]
        return np.sqrt(difference @ (stiffness_and_mass(mesh)[1] @ difference))

    assert measure_difference(page) <= page["drift"] + fine["drift"]
    second = follow(8, factor=-2)
    assert measure_difference(second) > second["drift"] + fine["drift"]


def test_a_flux_in_equilibrium_is_no_good_bound_on_a_short_step(page, monkeypatch):
    """Control: without fluxes for triangles larger than dt^(1/2), and the residual by parts on these."""
    monkeypatch.setattr(equilibrated_flux, "PATCH_REACTION_RATIO", np.inf)
    monkeypatch.setattr(
        flux_residuals, "bound_by_parts", lambda mesh, triangles, *_: np.full(len(triangles), np.inf)
    )
    step, fine = steps(page, 1e-8)
    assert step.bounds.u > 10 * distance(step, fine, 1e-8)
