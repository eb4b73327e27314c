"""The solution of the discrete problem (P_h*) as plain data, with what is known of its errors."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.bounds.boundary_flux import build_normal_flux
from unilateral.bounds.clamped_ends import ReactionData, no_clamped_ends
from unilateral.bounds.enclosed_data import EnclosedData
from unilateral.bounds.forces import Force, bound_forces
from unilateral.bounds.local_bounds import Bound, equilibrate_source, local_bound
from unilateral.bounds.residual_norm import SQUARES_ROUNDING
from unilateral.bounds.sharp_bounds import sharp_bound
from unilateral.fem.form import Form
from unilateral.fem.p1 import coupling, energy_norm
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.solvers.uzawa import DualResult


@dataclass(frozen=True, eq=False)
class DiscreteSolution:
    """(u_h, lambda_H) on a mesh and a partition, without what solved it: it can be copied and pickled.

    Bounds, and what else follows from these numbers, are computed when they are asked for. `data` has f, g
    and q on the mesh, by which errors are bounded; it is None where they were not enclosed. `cells` (m,) are
    those that have a multiplier. `g_means` (all cells,) are the means of g, `u_h` (n,) the values at the
    nodes, and `lambda_H` (all cells,) is 0 on cells without a multiplier.

    `result` is what the iteration found, with its algebraic bound, which was to be at most `tolerance`.
    `beta` serves as beta of (3.4), and `unique` says whether lambda_H is known to be the only one.
    `lambda_norm` is a lower bound on ||lambda_H||_{-1/2,h}, which is at most ||lambda_H||_{-1/2}.

    If u_h is of another program, `potential` (n,) is the function that solves the discrete equation with
    lambda_H. The bounds on the errors of u_h make their flux from it.
    """

    data: EnclosedData | None
    mesh: Mesh
    partition: Partition
    form: Form
    cells: Index
    g_means: Array
    u_h: Array
    lambda_H: Array
    result: DualResult
    tolerance: float
    beta: float
    unique: bool
    lambda_norm: float
    potential: Array | None = None

    def __repr__(self) -> str:
        return f"DiscreteSolution: {self.mesh.n_nodes} unknowns, {len(self.cells)} multipliers"

    @property
    def is_foreign(self) -> bool:
        """Whether u_h is of another program."""
        return self.potential is not None

    @cached_property
    def u_norm(self) -> float:
        """||u_h||."""
        return energy_norm(self.mesh, self.u_h, self.form)

    @cached_property
    def u_integral(self) -> float:
        """The integral of u_h."""
        return float(self.mesh.areas @ self.u_h[self.mesh.triangles].mean(axis=1))

    @cached_property
    def force(self) -> float:
        """The integral of lambda_H."""
        return float(self.partition.lengths @ self.lambda_H)

    @cached_property
    def gap(self) -> Array:
        """The means of u_h - g on all cells, NaN on cells without a multiplier; shape (all cells,)."""
        means = coupling(self.mesh, self.partition) @ self.u_h[self.mesh.boundary] / self.partition.lengths
        gap = np.full(self.partition.n_cells, math.nan)
        gap[self.cells] = (means - self.g_means)[self.cells]
        return gap

    def bound(self, sharp: bool = False) -> Bound | None:
        """The guaranteed bounds on the errors, if there are data; sharp ones take more time."""
        return self.sharp_bound if sharp else self.local_bound

    def has_bound(self, sharp: bool = False) -> bool:
        """Whether the bounds are already computed."""
        return ("sharp_bound" if sharp else "local_bound") in vars(self)

    @cached_property
    def local_bound(self) -> Bound | None:
        """The cheap bounds; None without data."""
        return self._compute_bound(local_bound)

    @cached_property
    def sharp_bound(self) -> Bound | None:
        """The sharp bounds; None without data."""
        return self._compute_bound(sharp_bound)

    def _compute_bound(self, compute: Callable[..., Bound]) -> Bound | None:
        """The bounds by one of the two functions; None without data."""
        if self.data is None:
            return None
        return compute(
            self.data,
            self.partition,
            self.u_h,
            self.lambda_H,
            self.form,
            self.potential,
        )

    @cached_property
    def flux(self) -> Array | None:
        """Equilibrated flux of the cheap bound, by normal components (2, E) on edges; None without data."""
        if self.data is None:
            return None
        potential = self.u_h if self.potential is None else self.potential
        sigma = build_normal_flux(self.mesh, self.partition, self.lambda_H, potential, self.form)
        end_fluxes = sigma.end_values + self.data.given_flux.end_values
        return equilibrate_source(self.data.source, potential, end_fluxes, self.form)

    @property
    def bound_shares(self) -> Array:
        """Shares (m,) of the triangles in the square of the cheap bound on ||u - u_h||_1; 0 without data."""
        return self.local_bound.shares if self.local_bound else np.zeros(len(self.mesh.triangles))

    def bound_forces(
        self, side_groups: Sequence[Sequence[int]], sharp: bool = False, idle_sides: Sequence[int] = ()
    ) -> list[Force]:
        """The forces, with reactions, over groups of sides between bounds by Proposition S16.

        On `idle_sides` u does not touch, by the data. Without data no force has an upper bound.
        """
        n = self.mesh.polygon.n_sides
        # where u does not touch lambda is 0, as on free sides
        form = self.form._replace(free=self.form.free + tuple(idle_sides))
        bound = self.bound(sharp)
        if bound is None or self.local_bound is None or self.data is None:
            outflows = np.where(np.isin(np.arange(n), form.clamped), math.nan, np.zeros((2, n)))
            multiplier_bound = math.inf
            reactions = ReactionData(form, outflows, no_clamped_ends(n), math.inf)
        else:
            # E of `bounds.forces`: |<lambda - lambda_H, w>| <= E N(w)
            multiplier_bound = bound.lambda_
            clamped_ends = self.local_bound.clamped_ends
            total_force = self.data.total_force
            reactions = ReactionData(form, bound.outflows, clamped_ends, bound.reaction_bound, total_force)
        return bound_forces(
            self.mesh, self.partition, self.lambda_H, multiplier_bound, side_groups, reactions
        )

    def total_bound(self, norm: str, sharp: bool = False) -> float:
        """The bound on ||u - u_h||_1 ("h1") or ||lambda - lambda_H||_{-1/2} ("hm12"), infinite if unknown."""
        bound = self.bound(sharp)
        if bound is None:
            return math.inf
        return bound.u if norm == "h1" else bound.lambda_

    def algebraic_bound(self, norm: str) -> float:
        """The bound on the iteration's part of the error of u ("h1") or lambda, infinite if unknown.

        For lambda it is that of u over beta. It says when to stop. `total_bound` includes the error of the
        iteration, and does not rest on this bound.
        """
        if norm != "h1" and len(self.cells) == 0:
            return 0.0
        beta = 1.0 if norm == "h1" else self.beta
        return self.result.bound / beta if beta > 0 else math.inf

    def norm_lower_bound(self, norm: str, sharp: bool = False) -> float:
        """A lower bound on the norm of the exact solution, from that of the discrete one."""
        # ||u|| >= ||u_h|| - ||u - u_h||; on the exact mesh ||u_h|| may be smaller by its factor
        discrete_norm = self.u_norm if norm == "h1" else self.lambda_norm
        return max(
            (1 - SQUARES_ROUNDING) * discrete_norm / self.mesh.exact_mesh_factor
            - self.total_bound(norm, sharp),
            0.0,
        )
