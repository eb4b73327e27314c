"""Fluxes through the boundary edges of a mesh, linear on each: sigma of lambda_H, tau~ of a given flux tau.

mu has the mean of lambda_H on every edge e and as much of its slope as leaves mu >= 0. On the triangle T at e

    sigma = w mu + (1 - w) min(mu, max(k du_h/dn, 0)),     w = min(1, EDGE_BALANCE k / (c |e|^2))^2.

Where the mesh does not see the layer of depth (k/c)^{1/2}, lambda_H is some c |e| times the error of u_h, and
much larger than lambda. This is a choice, and only the sharpness of bounds depends on it.

On free sides the flux tau (q in problem files) is given. On an edge e it is a piecewise polynomial p up to a
function rho, and bounds on ||rho||_e and on its integral are known (`GivenFlux`). tau~ is the L2
projection of p onto linear functions: int tau~ psi is int p psi for all hats psi. For p - tau~, which is
orthogonal to linear functions, see `oscillation`. On the triangle T at e

    <rho, z>_e <= ||rho||_e ||z - mean_T z||_e + |int rho| |T|^{-1/2} ||z||_T,

and the norm of z - mean_T z is at most a constant of `oscillation` times |z|_{1,T}. So rho has parts like
those of `residual_norm`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.bounds.residual_norm import BESSEL_ZERO, SQUARES_ROUNDING
from unilateral.fem.form import Form
from unilateral.fem.p1 import gradients, project_to_linear
from unilateral.formulas.taylor import EPS
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, overlay
from unilateral.norms.oscillation import (
    MEAN_FREE_SQUARE_CONSTANT,
    SQUARE_CONSTANT,
    oscillation_bound,
    oscillation_constants,
    trace_constants,
    value_constants,
)
from unilateral.problems.obstacle_and_flux import GivenFlux

MOMENT_ROUNDING = 64 * EPS
"""The rounding of the moments of p on an edge, as a multiple of the largest |p| there.

It is added once more for every interval of the edge.
"""


EDGE_REACTION_RATIO = 15.0
"""c |e|^2 / k of an edge above which the flux of u_h counts beside mu, as in `equilibrate_flux`."""


class NormalFlux(NamedTuple):
    """sigma, by its values `end_values` (nb, 2) >= 0 at the ends of the edges.

    `oscillation_squares` (nb,) is the squared L2 norm of lambda_H - mu, and `square_constants` (nb,) is what
    `oscillation` needs to bound that in the dual norm; `reduction_squares` (nb,) is the squared L2 norm of mu
    - sigma. `contact_scale` (nb,) is the largest H_i lambda_i of a cell there over k, with the factor w.
    """

    end_values: Array
    oscillation_squares: Array
    square_constants: Array
    reduction_squares: Array
    contact_scale: Array

    def multiplier_distance(self, mesh: Mesh, form: Form) -> float:
        """A bound on the norm of lambda_H - sigma in the dual of the energy norm on H^1."""
        of_rest = oscillation_bound(
            mesh, self.oscillation_squares[:, None], self.square_constants, form
        ).item()
        lower = self.reduction_squares > 0
        of_lowered = math.sqrt(value_constants(mesh, form)[lower] @ self.reduction_squares[lower])
        return (1 + SQUARES_ROUNDING) * (of_rest + of_lowered)


def build_normal_flux(
    mesh: Mesh, partition: Partition, lambda_H: Array, u_h: Array, form: Form
) -> NormalFlux:
    """The flux of lambda_H (m,), which is constant on the cells, for u_h (n,) near the discrete solution."""
    lengths = np.diff(mesh.s)
    nb = len(mesh.boundary)
    points, cell, edge = overlay(partition.points, mesh.s)
    middle = 0.5 * (points[1:] + points[:-1])
    share = np.diff(points) / lengths[edge]
    arm = 2 * (middle - mesh.s[edge]) / lengths[edge] - 1
    value = lambda_H[cell]
    mean = np.bincount(edge, share * value, nb)
    slope = 3 * np.bincount(edge, share * arm * value, nb)
    limited = np.clip(slope, -mean, mean)
    squares = np.bincount(edge, share * (value - mean[edge]) ** 2, nb)
    rest = np.maximum(squares + (limited - 2 * slope) * limited / 3, 0.0)
    push = np.zeros(nb)
    np.maximum.at(push, edge, (partition.lengths * lambda_H)[cell])
    mu = np.column_stack([mean - limited, mean + limited])

    # less than mu where it is above k du_h/dn
    part = mesh.select_triangles(mesh.boundary_triangles)
    slopes = np.einsum("tid,ti->td", gradients(part), u_h[part.triangles])
    outflow = form.k * np.sum(slopes * mesh.polygon.normals[mesh.side], axis=1)
    w = 1 / np.maximum(1.0, form.c / (EDGE_REACTION_RATIO * form.k) * lengths**2) ** 2
    less = (1 - w[:, None]) * np.maximum(mu - np.maximum(outflow, 0.0)[:, None], 0.0)
    return NormalFlux(
        mu - less,
        oscillation_squares=lengths * rest,
        square_constants=np.where(limited == slope, SQUARE_CONSTANT, MEAN_FREE_SQUARE_CONSTANT),
        reduction_squares=lengths / 3 * ((less**2).sum(axis=1) + less.prod(axis=1)),
        contact_scale=w * push / form.k,
    )


class GivenEdgeFlux(NamedTuple):
    """tau~, by its values `end_values` (nb, 2) at the ends of the edges, and bounds on tau - tau~ on each edge.

    `oscillation` (nb,) is ||p - tau~||_e, `remainder_norms` is ||rho||_e, and `remainder_integrals` bounds
    the integral of rho.
    """

    end_values: Array
    oscillation: Array
    remainder_norms: Array
    remainder_integrals: Array

    def projection_error(self, mesh: Mesh, form: Form) -> float:
        """A bound on the norm of p - tau~ in the dual of the energy norm on H^1."""
        return (1 + SQUARES_ROUNDING) * oscillation_bound(
            mesh, self.oscillation[:, None] ** 2, form=form
        ).item()

    def shares(self, mesh: Mesh, form: Form) -> Array:
        """Each boundary edge's part of the squared bound on the dual norm of p - tau~.

        The shape is (nb,).
        """
        return np.asarray(oscillation_constants(mesh, form=form).sum(axis=0) * self.oscillation**2)

    def gradient_coefficients(self, mesh: Mesh) -> Array:
        """The factors of |z|_{1,T} in the bound on the functional of rho, for the triangles at the boundary edges.

        The shape is (nb,).
        """
        return np.sqrt(trace_constants(mesh, 1 / BESSEL_ZERO)) * self.remainder_norms

    def value_coefficients(self, mesh: Mesh) -> Array:
        """The factors of ||z||_T in the bound on the functional of rho, for the triangles at the boundary edges.

        The shape is (nb,).
        """
        return self.remainder_integrals / np.sqrt(mesh.areas[mesh.boundary_triangles])

    def remainder_dual_norm(self, mesh: Mesh, form: Form) -> float:
        """A bound on the norm of the functional of rho, on functions that vanish on clamped sides."""
        of_gradients = np.linalg.norm(self.gradient_coefficients(mesh)) / math.sqrt(form.k)
        return float(of_gradients + form.value_constant * np.linalg.norm(self.value_coefficients(mesh)))


def no_given_flux(mesh: Mesh) -> GivenEdgeFlux:
    """The `GivenEdgeFlux` of a mesh on which no flux is given: 0."""
    nb = len(mesh.boundary)
    return GivenEdgeFlux(np.zeros((nb, 2)), *np.zeros((3, nb)))


def project_given_flux(flux: GivenFlux, mesh: Mesh) -> GivenEdgeFlux:
    """The `GivenEdgeFlux` of a problem's flux on a mesh; infinite where the flux has no bound."""
    if not flux.is_given.any():
        return no_given_flux(mesh)
    samples = flux.sample(mesh.s)
    lengths = np.diff(mesh.s)
    here = flux.is_given[samples.piece]
    half = samples.half_length[here]
    piece = samples.piece[here]
    s = samples.s[here]
    p = samples.value[here]
    edge = _locate_edges(mesh, samples.middle[here])
    weight = half[:, None] * samples.weights
    x = (s - mesh.s[edge][:, None]) / lengths[edge][:, None]
    ends = project_to_linear(mesh, edge, x, weight, p)
    away = p - ends[edge, :1] * (1 - x) - ends[edge, 1:] * x
    left = np.sqrt(np.bincount(edge, np.sum(weight * away**2, axis=1), len(ends)))
    size, integral = _remainder_bounds(flux, mesh, edge, 2 * half, flux.remainder[piece])
    rounding = _given_flux_rounding(flux, mesh, edge, np.abs(p).max(axis=1))
    return GivenEdgeFlux(
        ends,
        oscillation=left,
        remainder_norms=size + np.sqrt(lengths) * rounding,
        remainder_integrals=integral + lengths * rounding,
    )


def _remainder_bounds(
    flux: GivenFlux, mesh: Mesh, edge: Index, length: Array, remainder: Array
) -> tuple[Array, Array]:
    """Bounds on ||rho||_e and on the integral of rho over each boundary edge, from those on intervals of edges.

    Returns arrays of the shapes (nb,), (nb,).

    Within the flux's `reach` of a place where two pieces meet, on either side, rho may be the jump there.
    """
    at = flux.points[flux.jumps > 0]
    jumps = flux.jumps[flux.jumps > 0]
    before = _locate_edges(mesh, at + (-flux.reach))
    after = _locate_edges(mesh, at + flux.reach)
    apart = before != after
    nb = len(mesh.boundary)
    edge = np.concatenate([edge, before, after[apart]])
    length = np.append(length, np.full(len(edge) - len(length), 2 * flux.reach))
    size = np.concatenate([remainder, jumps, jumps[apart]])
    square = np.bincount(edge, length * size**2, nb).astype(float)
    integral = np.bincount(edge, length * size**1, nb).astype(float)
    return np.sqrt(square), integral


def _given_flux_rounding(flux: GivenFlux, mesh: Mesh, edge: Index, magnitude: Array) -> Array:
    """The rounding of tau~ on each boundary edge, from the largest |p| on intervals.

    The shape is (nb,).

    Places, and so the edges' lengths, are rounded, too.
    """
    largest = np.zeros(len(mesh.boundary))
    np.maximum.at(largest, edge, magnitude)
    terms = 1 + np.bincount(edge, minlength=len(largest))
    return np.asarray(largest * (MOMENT_ROUNDING * terms + flux.reach / np.diff(mesh.s)))


def _locate_edges(mesh: Mesh, s: Array) -> Index:
    """The boundary edge on which each arc length lies.

    The shape is (k,).
    """
    return np.clip(np.searchsorted(mesh.s, s) - 1, 0, len(mesh.boundary) - 1)
