"""f, g and q of a problem on a mesh, enclosed: after this nothing that solves or bounds knows the problem."""

from __future__ import annotations

from dataclasses import dataclass

from unilateral.arrays import Array
from unilateral.bounds.boundary_flux import GivenEdgeFlux, project_given_flux
from unilateral.bounds.constraint import Constraint, build_constraint
from unilateral.bounds.forces import enclose_total_force
from unilateral.bounds.source import Source, enclose_source
from unilateral.fem.form import Form
from unilateral.fem.p1 import edge_load
from unilateral.geometry.mesh import Mesh
from unilateral.problems.problem import Problem


@dataclass(frozen=True, eq=False)
class EnclosedData:
    """What is known of f, g and q on a mesh: the `source` has f on the triangles.

    The `constraint` has g on the boundary edges with multipliers, and u_D on clamped ones; `given_flux` is
    tau~ on free edges, with what it leaves of the flux there. `total_force` are, if c = 0, two numbers
    between which - int f - int q lies, the sum of all forces and reactions.
    """

    source: Source
    constraint: Constraint
    given_flux: GivenEdgeFlux
    total_force: tuple[float, float] | None

    @property
    def mesh(self) -> Mesh:
        """The mesh on which the data are enclosed."""
        return self.source.mesh

    @property
    def load(self) -> Array:
        """The load vector of f and q, exact for the polynomials of their enclosures, (n,)."""
        return self.source.load + edge_load(self.mesh, self.given_flux.end_values)


def enclose_data(problem: Problem, mesh: Mesh, form: Form, source: Source | None = None) -> EnclosedData:
    """f, g and q of a problem, enclosed on a mesh; the `form` is the problem's on that mesh.

    If `source` is given it is f on the mesh, which then is not enclosed again.
    """
    flux = problem.enclosed_flux
    tau = project_given_flux(flux, mesh)
    if source is None:
        source = enclose_source(mesh, problem.source, form)
    return EnclosedData(
        source=source,
        constraint=build_constraint(problem.enclosed_obstacle, mesh, form),
        given_flux=tau,
        total_force=None if form.c else enclose_total_force(source, flux),
    )
