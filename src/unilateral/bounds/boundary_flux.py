"""Fluxes through the boundary edges of a mesh, linear on each: sigma of lambda_H, tau~ of a given flux tau.

mu has the mean of lambda_H on every edge e and as much of its slope as leaves mu >= 0. On the triangle T at e

    sigma = w mu + (1 - w) min(mu, max(k du_h/dn, 0)),     w = min(1, EDGE_BALANCE k / (c |e|^2))^2.

Where the mesh does not see the layer of depth (k/c)^{1/2}, lambda_H is some c |e| times the error of u_h, and
much larger than lambda. This is a choice, and only the sharpness of bounds depends on it.

On free sides the flux tau (q in problem files) is given. On an edge e it is a piecewise polynomial p up to a
function rho, and bounds on ||rho||_e and on its integral are known (`Flux`). tau~ is the L2
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
from unilateral.bounds.residual_norm import SUMS, J
from unilateral.fem.form import Form
from unilateral.fem.p1 import gradients, linear_parts
from unilateral.formulas.taylor import EPS
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, overlay
from unilateral.norms.oscillation import (
    MEAN_FREE_ON_SQUARE,
    ON_SQUARE,
    oscillation_bound,
    oscillation_constants,
    trace_constants,
    value_constants,
)
from unilateral.problems.obstacle_and_flux import Flux

ROUNDING = 64 * EPS
"""The rounding of the moments of p on an edge, as a multiple of the largest |p| there.

It is added once more for every interval of the edge.
"""


EDGE_BALANCE = 15.0
"""c |e|^2 / k of an edge above which the flux of u_h counts beside mu, as in `equilibrated`."""


class EdgeFlux(NamedTuple):
    """sigma, by its values `ends` (nb, 2) >= 0 at the ends of the edges.

    `rest` (nb,) is the squared L2 norm of lambda_H - mu, and `constant` (nb,) is what `oscillation` needs to
    bound that in the dual norm; `lowered` (nb,) is the squared L2 norm of mu - sigma. `push` (nb,) is the
    largest H_i lambda_i of a cell there over k, with the factor w.
    """

    ends: Array
    rest: Array
    constant: Array
    lowered: Array
    push: Array

    def distance(self, mesh: Mesh, form: Form) -> float:
        """A bound on the norm of lambda_H - sigma in the dual of the energy norm on H^1."""
        of_rest = oscillation_bound(mesh, self.rest[:, None], self.constant, form).item()
        lower = self.lowered > 0
        of_lowered = math.sqrt(value_constants(mesh, form)[lower] @ self.lowered[lower])
        return (1 + SUMS) * (of_rest + of_lowered)


def edge_flux(mesh: Mesh, cells: Partition, lambda_H: Array, u_h: Array, form: Form) -> EdgeFlux:
    """The flux of lambda_H (m,), which is constant on the cells, for u_h (n,) near the discrete solution."""
    lengths = np.diff(mesh.s)
    nb = len(mesh.boundary)
    points, cell, edge = overlay(cells.points, mesh.s)
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
    np.maximum.at(push, edge, (cells.lengths * lambda_H)[cell])
    mu = np.column_stack([mean - limited, mean + limited])

    # less than mu where it is above k du_h/dn
    part = mesh.part(mesh.boundary_triangles)
    slopes = np.einsum("tid,ti->td", gradients(part), u_h[part.triangles])
    outflow = form.k * np.sum(slopes * mesh.polygon.normals[mesh.side], axis=1)
    w = 1 / np.maximum(1.0, form.c / (EDGE_BALANCE * form.k) * lengths**2) ** 2
    less = (1 - w[:, None]) * np.maximum(mu - np.maximum(outflow, 0.0)[:, None], 0.0)
    return EdgeFlux(
        mu - less,
        rest=lengths * rest,
        constant=np.where(limited == slope, ON_SQUARE, MEAN_FREE_ON_SQUARE),
        lowered=lengths / 3 * ((less**2).sum(axis=1) + less.prod(axis=1)),
        push=w * push / form.k,
    )


class Given(NamedTuple):
    """tau~, by its values `ends` (nb, 2) at the ends of the edges, and bounds on tau - tau~ on each edge.

    `left` (nb,) is ||p - tau~||_e, `size` is ||rho||_e, and `integral` bounds the integral of rho.
    """

    ends: Array
    left: Array
    size: Array
    integral: Array

    def distance(self, mesh: Mesh, form: Form) -> float:
        """A bound on the norm of p - tau~ in the dual of the energy norm on H^1."""
        return (1 + SUMS) * oscillation_bound(mesh, self.left[:, None] ** 2, form=form).item()

    def shares(self, mesh: Mesh, form: Form) -> Array:
        """(nb,) the edges' parts of its square."""
        return np.asarray(oscillation_constants(mesh, form=form).sum(axis=0) * self.left**2)

    def misfit(self, mesh: Mesh) -> Array:
        """(nb,) what gradients are multiplied by in the functional of rho, on the triangles."""
        return np.sqrt(trace_constants(mesh, 1 / J)) * self.size

    def rest(self, mesh: Mesh) -> Array:
        """(nb,) what values are multiplied by in that functional."""
        return self.integral / np.sqrt(mesh.areas[mesh.boundary_triangles])

    def unknown(self, mesh: Mesh, form: Form) -> float:
        """A bound on the norm of the functional of rho, on functions that vanish on clamped sides."""
        of_gradients = np.linalg.norm(self.misfit(mesh)) / math.sqrt(form.k)
        return float(of_gradients + form.value_constant * np.linalg.norm(self.rest(mesh)))


def nothing(mesh: Mesh) -> Given:
    """The `Given` of a mesh on which no flux is given: 0."""
    nb = len(mesh.boundary)
    return Given(np.zeros((nb, 2)), *np.zeros((3, nb)))


def given(flux: Flux, mesh: Mesh) -> Given:
    """The `Given` of a problem's flux on a mesh; infinite where the flux has no bound."""
    if not flux.given.any():
        return nothing(mesh)
    samples = flux.sample(mesh.s)
    lengths = np.diff(mesh.s)
    here = flux.given[samples.piece]
    half = samples.half[here]
    piece = samples.piece[here]
    s = samples.s[here]
    p = samples.value[here]
    edge = _edges(mesh, samples.middle[here])
    weight = half[:, None] * samples.weights
    x = (s - mesh.s[edge][:, None]) / lengths[edge][:, None]
    ends = linear_parts(mesh, edge, x, weight, p)
    away = p - ends[edge, :1] * (1 - x) - ends[edge, 1:] * x
    left = np.sqrt(np.bincount(edge, np.sum(weight * away**2, axis=1), len(ends)))
    size, integral = _of_rho(flux, mesh, edge, 2 * half, flux.doubt[piece])
    rounding = _rounding(flux, mesh, edge, np.abs(p).max(axis=1))
    return Given(
        ends,
        left=left,
        size=size + np.sqrt(lengths) * rounding,
        integral=integral + lengths * rounding,
    )


def _of_rho(flux: Flux, mesh: Mesh, edge: Index, length: Array, doubt: Array) -> tuple[Array, Array]:
    """(nb,), (nb,) bounds on ||rho||_e and on the integral of rho, from intervals (K,) of edges.

    Within the flux's `reach` of a place where two pieces meet, on either side, rho may be the jump there.
    """
    at = flux.points[flux.jumps > 0]
    jumps = flux.jumps[flux.jumps > 0]
    before = _edges(mesh, at + (-flux.reach))
    after = _edges(mesh, at + flux.reach)
    apart = before != after
    nb = len(mesh.boundary)
    edge = np.concatenate([edge, before, after[apart]])
    length = np.append(length, np.full(len(edge) - len(length), 2 * flux.reach))
    size = np.concatenate([doubt, jumps, jumps[apart]])
    square = np.bincount(edge, length * size**2, nb).astype(float)
    integral = np.bincount(edge, length * size**1, nb).astype(float)
    return np.sqrt(square), integral


def _rounding(flux: Flux, mesh: Mesh, edge: Index, size: Array) -> Array:
    """(nb,) the rounding of tau~, from the largest |p| on intervals (K,).

    Places, and so the edges' lengths, are rounded, too.
    """
    largest = np.zeros(len(mesh.boundary))
    np.maximum.at(largest, edge, size)
    terms = 1 + np.bincount(edge, minlength=len(largest))
    return np.asarray(largest * (ROUNDING * terms + flux.reach / np.diff(mesh.s)))


def _edges(mesh: Mesh, s: Array) -> Index:
    """(k,) the boundary edges on which arc lengths (k,) lie."""
    return np.clip(np.searchsorted(mesh.s, s) - 1, 0, len(mesh.boundary) - 1)
