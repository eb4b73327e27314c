"""Fluxes through the boundary edges of a mesh, linear on each: sigma of lambda_H, tau~ of a given flux tau.

mu has the mean of lambda_H on every edge e and as much of its slope as leaves mu >= 0. On the triangle T at e

    sigma = w mu + (1 - w) min(mu, max(k du_h/dn, 0)),   w = min(1, EDGE_REACTION_RATIO k / (c |e|^2))^2.

Where the mesh does not see the layer of depth (k/c)^{1/2}, lambda_H is some c |e| times the error of u_h, and
much larger than lambda. This is a choice, and only the sharpness of bounds depends on it.

On free sides the flux tau (q in problem files) is given. On an edge e it is a piecewise polynomial p up to a
function rho, and bounds on ||rho||_e and on its integral are known (`GivenFlux`). tau~ is the L2
projection of p onto linear functions: int tau~ psi is int p psi for all hats psi. `oscillation` bounds the
dual norm of p - tau~, which is orthogonal to linear functions. On the triangle T at e

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
"""The rounding of the moments of p on an edge, over the largest |p| there, per interval and once more."""
EDGE_REACTION_RATIO = 15.0
"""c |e|^2 / k of an edge above which the flux of u_h counts beside mu, as in `equilibrate_flux`."""


class NormalFlux(NamedTuple):
    """sigma, by its values `end_values` (nb, 2) >= 0 at the ends of the edges.

    `oscillation_squares` (nb,) is the squared L2 norm of lambda_H - mu, and `square_constants` (nb,) is the C
    with which `oscillation` bounds its dual norm; `reduction_squares` (nb,) is the squared L2 norm of
    mu - sigma. `contact_scale` (nb,) is the largest H_i lambda_i of a cell there over k, with the factor w.
    """

    end_values: Array
    oscillation_squares: Array
    square_constants: Array
    reduction_squares: Array
    contact_scale: Array

    def multiplier_distance(self, mesh: Mesh, form: Form) -> float:
        """A bound on the norm of lambda_H - sigma in the dual of the energy norm on H^1."""
        squares = self.oscillation_squares[:, None]
        oscillation_norm = oscillation_bound(mesh, squares, self.square_constants, form).item()
        is_reduced = self.reduction_squares > 0  # nothing is for c = 0, where the constants are infinite
        constants = value_constants(mesh, form)[is_reduced]
        reduction_norm = math.sqrt(constants @ self.reduction_squares[is_reduced])
        return (1 + SQUARES_ROUNDING) * (oscillation_norm + reduction_norm)


def build_normal_flux(
    mesh: Mesh, partition: Partition, lambda_H: Array, u_h: Array, form: Form
) -> NormalFlux:
    """The flux of lambda_H (m,), which is constant on the cells, for u_h (n,) near the discrete solution."""
    lengths = np.diff(mesh.s)
    points, cell, edge = overlay(partition.points, mesh.s)
    mu, oscillation_squares, square_constants = _limit_slopes(mesh, points, edge, lambda_H[cell])
    # k du_h/dn of the triangle at each edge, as far as it flows out
    outer_mesh = mesh.select_triangles(mesh.boundary_triangles)
    slopes = np.einsum("tid,ti->td", gradients(outer_mesh), u_h[outer_mesh.triangles])
    outflow = np.maximum(form.k * np.sum(slopes * mesh.polygon.normals[mesh.side], axis=1), 0.0)
    # sigma = mu - reduction, (1 - w) (mu - outflow)_+ taken at both ends and linear between them
    w = 1 / np.maximum(1.0, form.c / (EDGE_REACTION_RATIO * form.k) * lengths**2) ** 2
    reduction = (1 - w[:, None]) * np.maximum(mu - outflow[:, None], 0.0)
    # H_i lambda_i / k has the unit of u, and u_h - g is compared with it (`find_contact`)
    largest_H_lambda = np.zeros(len(lengths))
    np.maximum.at(largest_H_lambda, edge, (partition.lengths * lambda_H)[cell])
    return NormalFlux(
        mu - reduction,
        oscillation_squares,
        square_constants,
        # the square of a linear function with the values a, b at the ends: |e| / 3 (a^2 + b^2 + a b)
        reduction_squares=lengths / 3 * ((reduction**2).sum(axis=1) + reduction.prod(axis=1)),
        contact_scale=w * largest_H_lambda / form.k,
    )


def _limit_slopes(mesh: Mesh, points: Array, edge: Index, value: Array) -> tuple[Array, Array, Array]:
    """mu (nb, 2) >= 0 at the ends of edges, ||lambda_H - mu||_e^2 and the constants for squares, (nb,) each.

    lambda_H has the `value` (k,) on the intervals between the arc lengths `points` (k + 1,), which lie on the
    edges `edge` (k,).
    """
    lengths = np.diff(mesh.s)
    nb = len(lengths)
    # mean and slope of the L2 projection of lambda_H to linear functions of x, from -1 to 1 on each edge
    share = np.diff(points) / lengths[edge]
    x = 2 * (0.5 * (points[1:] + points[:-1]) - mesh.s[edge]) / lengths[edge] - 1
    mean = np.bincount(edge, share * value, nb)
    slope = 3 * np.bincount(edge, share * x * value, nb)
    mu_slope = np.clip(slope, -mean, mean)  # mu = mean + mu_slope x is >= 0, as the mean is
    # |e|^-1 ||lambda_H - mu||_e^2 = variance - slope^2 / 3 + (mu_slope - slope)^2 / 3
    variance = np.bincount(edge, share * (value - mean[edge]) ** 2, nb)
    oscillation_variance = np.maximum(variance + (mu_slope - 2 * slope) * mu_slope / 3, 0.0)
    # a mu with the whole slope leaves what is orthogonal to linear functions, else only to constants
    square_constants = np.where(mu_slope == slope, SQUARE_CONSTANT, MEAN_FREE_SQUARE_CONSTANT)
    mu = np.column_stack([mean - mu_slope, mean + mu_slope])
    return mu, lengths * oscillation_variance, square_constants


class GivenEdgeFlux(NamedTuple):
    """tau~, by its values `end_values` (nb, 2) at the ends of the edges, and bounds on tau - tau~ on each.

    `oscillation` (nb,) is ||p - tau~||_e, `remainder_norms` is ||rho||_e, and `remainder_integrals` bounds
    the integral of rho.
    """

    end_values: Array
    oscillation: Array
    remainder_norms: Array
    remainder_integrals: Array

    def projection_error(self, mesh: Mesh, form: Form) -> float:
        """A bound on the norm of p - tau~ in the dual of the energy norm on H^1."""
        bound = oscillation_bound(mesh, self.oscillation[:, None] ** 2, form=form)
        return (1 + SQUARES_ROUNDING) * bound.item()

    def shares(self, mesh: Mesh, form: Form) -> Array:
        """Each boundary edge's part of the squared bound on the dual norm of p - tau~, (nb,)."""
        return np.asarray(oscillation_constants(mesh, form=form).sum(axis=0) * self.oscillation**2)

    def gradient_coefficients(self, mesh: Mesh) -> Array:
        """The factors (nb,) of |z|_{1,T} in the bound on the functional of rho, T at each boundary edge."""
        # ||z - mean_T z||_T <= d / j |z|_{1,T} on triangles, j the first zero of J_1 (Lemma S12)
        return np.sqrt(trace_constants(mesh, 1 / BESSEL_ZERO)) * self.remainder_norms

    def value_coefficients(self, mesh: Mesh) -> Array:
        """The factors (nb,) of ||z||_T in the bound on the functional of rho, T at each boundary edge."""
        return self.remainder_integrals / np.sqrt(mesh.areas[mesh.boundary_triangles])

    def remainder_dual_norm(self, mesh: Mesh, form: Form) -> float:
        """A bound on the norm of the functional of rho, on functions that vanish on clamped sides."""
        gradient_term = np.linalg.norm(self.gradient_coefficients(mesh)) / math.sqrt(form.k)
        return float(gradient_term + form.value_constant * np.linalg.norm(self.value_coefficients(mesh)))


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
    is_given = flux.is_given[samples.piece]
    half_length = samples.half_length[is_given]
    p = samples.value[is_given]
    edge = _locate_edges(mesh, samples.middle[is_given])
    weight = half_length[:, None] * samples.weights
    x = (samples.s[is_given] - mesh.s[edge][:, None]) / lengths[edge][:, None]
    projection = project_to_linear(mesh, edge, x, weight, p)  # tau~
    # p - tau~ is measured by the same Gauss points, which are exact for squares of polynomials of p's degree
    difference = p - projection[edge, :1] * (1 - x) - projection[edge, 1:] * x
    oscillation = np.sqrt(np.bincount(edge, np.sum(weight * difference**2, axis=1), len(lengths)))
    remainder = flux.remainder[samples.piece[is_given]]
    size, integral = _remainder_bounds(flux, mesh, edge, 2 * half_length, remainder)
    rounding = _given_flux_rounding(flux, mesh, edge, np.abs(p).max(axis=1))
    return GivenEdgeFlux(
        projection,
        oscillation=oscillation,
        remainder_norms=size + np.sqrt(lengths) * rounding,
        remainder_integrals=integral + lengths * rounding,
    )


def _remainder_bounds(
    flux: GivenFlux, mesh: Mesh, edge: Index, length: Array, remainder: Array
) -> tuple[Array, Array]:
    """Bounds (nb,) on ||rho||_e and on the integral of |rho| over boundary edges.

    On intervals of the `length` (k,), on the edges `edge` (k,), |rho| is at most the `remainder` (k,). Within
    the flux's `reach` of a place where two pieces meet, on either side, rho may be the jump there.
    """
    jump_points = flux.points[flux.jumps > 0]
    jumps = flux.jumps[flux.jumps > 0]
    before = _locate_edges(mesh, jump_points + (-flux.reach))
    after = _locate_edges(mesh, jump_points + flux.reach)
    is_cut = before != after
    nb = len(mesh.boundary)
    # jumps are intervals more, of twice the reach; one near a node may lie on either edge, and counts on both
    edge = np.concatenate([edge, before, after[is_cut]])
    length = np.append(length, np.full(len(edge) - len(length), 2 * flux.reach))
    size = np.concatenate([remainder, jumps, jumps[is_cut]])
    square = np.bincount(edge, length * size**2, nb).astype(float)
    integral = np.bincount(edge, length * size**1, nb).astype(float)
    return np.sqrt(square), integral


def _given_flux_rounding(flux: GivenFlux, mesh: Mesh, edge: Index, magnitude: Array) -> Array:
    """The rounding of tau~ on each boundary edge, (nb,).

    |p| is at most `magnitude` (k,) on intervals of the edges `edge` (k,). Places are rounded, too, by up to
    the flux's `reach`, and so are the edges' lengths.
    """
    largest = np.zeros(len(mesh.boundary))
    np.maximum.at(largest, edge, magnitude)
    terms = 1 + np.bincount(edge, minlength=len(largest))
    return np.asarray(largest * (MOMENT_ROUNDING * terms + flux.reach / np.diff(mesh.s)))


def _locate_edges(mesh: Mesh, s: Array) -> Index:
    """The boundary edge on which each arc length lies, (k,); at a node it is the edge that ends there."""
    return np.clip(np.searchsorted(mesh.s, s) - 1, 0, len(mesh.boundary) - 1)
