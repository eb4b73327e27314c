"""Fluxes through the boundary edges of a mesh, linear on each: sigma of lambda_H, tau~ of a given flux tau.

sigma has the mean of lambda_H on every edge and as much of its slope as leaves sigma >= 0.

On free sides the flux tau (q in problem files) is given. On an edge e it is a piecewise polynomial p up to a
function rho, and bounds on ||rho||_e and on its integral are known (`Flux`). tau~ is the L2
projection of p onto linear functions: int tau~ psi is int p psi for all hats psi. tau - tau~ is the sum of
p - tau~, which is orthogonal to linear functions, of rho less its mean, and of the mean of rho. For the first
two see `oscillation`: with ||p - tau~||_e + ||rho||_e on triangles, and the sum of both with their constants
on squares. For the third, with T the triangle at e,

    |int rho| |mean_e v| <= |int rho| |e|^{-1/2} ||v||_e <= |int rho| (C/|e|)^{1/2} ||v||_{1,T},

    ||v||_e^2 <= C ||v||_{1,T}^2,    C = |e|/|T| (1 + (1 + a^2)^{1/2})/2,

a the greater distance of the vertex off e from the ends of e, by the divergence theorem with the field
x - vertex. If c = 0, ||v||_1 is at most (1 + C^2)^{1/2} |v|_1, C Friedrichs' constant.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from unilateral.arrays import Array, Index
from unilateral.bounds.flux_residuals import SUMS
from unilateral.bounds.source import norm
from unilateral.fem.form import H1, Form
from unilateral.fem.p1 import linear_parts
from unilateral.formulas.taylor import EPS
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, overlay
from unilateral.norms.oscillation import (
    MEAN_FREE_ON_SQUARE,
    ON_SQUARE,
    has_square,
    oscillation_bound,
    trace_constants,
    value_constants,
)
from unilateral.problems.obstacle_and_flux import Flux

ROUNDING = 64 * EPS
"""The rounding of the moments of p on an edge, as a multiple of the largest |p| there.

It is added once more for every interval of the edge.
"""


class EdgeFlux(NamedTuple):
    """sigma, by its values `ends` (nb, 2) >= 0 at the ends of the edges.

    `rest` (nb,) is the squared L2 norm of lambda_H - sigma, and `constant` (nb,) is what `oscillation` needs
    to bound that in ||.||_{-1/2}. `push` (nb,) is the largest H_i lambda_i of a cell there.
    """

    ends: Array
    rest: Array
    constant: Array
    push: Array

    def distance(self, mesh: Mesh) -> float:
        """A bound on ||lambda_H - sigma||_{-1/2}."""
        return (1 + SUMS) * oscillation_bound(mesh, self.rest[:, None], self.constant).item()


def edge_flux(mesh: Mesh, cells: Partition, lambda_H: Array) -> EdgeFlux:
    """The flux of lambda_H (m,), which is constant on the cells."""
    lengths, nb = np.diff(mesh.s), len(mesh.boundary)
    points, cell, edge = overlay(cells.points, mesh.s)
    middle = 0.5 * (points[1:] + points[:-1])
    share, arm = np.diff(points) / lengths[edge], 2 * (middle - mesh.s[edge]) / lengths[edge] - 1
    value = lambda_H[cell]
    mean = np.bincount(edge, share * value, nb)
    slope = 3 * np.bincount(edge, share * arm * value, nb)
    limited = np.clip(slope, -mean, mean)
    squares = np.bincount(edge, share * (value - mean[edge]) ** 2, nb)
    rest = np.maximum(squares + (limited - 2 * slope) * limited / 3, 0.0)
    push = np.zeros(nb)
    np.maximum.at(push, edge, (cells.lengths * lambda_H)[cell])
    return EdgeFlux(
        np.column_stack([mean - limited, mean + limited]),
        rest=lengths * rest,
        constant=np.where(limited == slope, ON_SQUARE, MEAN_FREE_ON_SQUARE),
        push=push,
    )


class Given(NamedTuple):
    """tau~, by its values `ends` (nb, 2) at the ends of the edges, and bounds on tau - tau~.

    Each of the two rows of `squares` (2, nb) has a sum. The dual norm of tau - tau~ is at most the sum of the
    roots of these. `doubts` (2, nb) are the same for tau - p: if tau were p they would be 0 but for rounding.
    """

    ends: Array
    squares: Array
    doubts: Array

    @property
    def distance(self) -> float:
        """A bound on the norm of tau - tau~ as a functional."""
        return norm(self.squares)

    @property
    def unknown(self) -> float:
        """The part of that bound that is for tau - p."""
        return norm(self.doubts)


def nothing(mesh: Mesh) -> Given:
    """The `Given` of a mesh on which no flux is given: 0."""
    nb = len(mesh.boundary)
    return Given(np.zeros((nb, 2)), *np.zeros((2, 2, nb)))


def given(flux: Flux, mesh: Mesh, form: Form = H1) -> Given:
    """The `Given` of a problem's flux on a mesh; infinite where the flux has no bound."""
    if not flux.given.any():
        return nothing(mesh)
    samples, lengths = flux.sample(mesh.s), np.diff(mesh.s)
    here = flux.given[samples.piece]
    half, piece, s, p = samples.half[here], samples.piece[here], samples.s[here], samples.value[here]
    edge, weight = _edges(mesh, samples.middle[here]), half[:, None] * samples.weights
    x = (s - mesh.s[edge][:, None]) / lengths[edge][:, None]
    ends = linear_parts(mesh, edge, x, weight, p)
    away = p - ends[edge, :1] * (1 - x) - ends[edge, 1:] * x
    left = np.sqrt(np.bincount(edge, np.sum(weight * away**2, axis=1), len(ends)))
    size, integral = _of_rho(flux, mesh, edge, 2 * half, flux.doubt[piece])
    rounding = _rounding(flux, mesh, edge, np.abs(p).max(axis=1))
    size, integral = size + np.sqrt(lengths) * rounding, integral + lengths * rounding
    integral *= math.hypot(1.0, form.value_constant)
    return Given(ends, *(_squares(mesh, rest, size, integral) for rest in (left, np.zeros_like(left))))


def _of_rho(flux: Flux, mesh: Mesh, edge: Index, length: Array, doubt: Array) -> tuple[Array, Array]:
    """(nb,), (nb,) bounds on ||rho||_e and on the integral of rho, from intervals (K,) of edges.

    Within the flux's `reach` of a place where two pieces meet, on either side, rho may be the jump there.
    """
    at, jumps = flux.points[flux.jumps > 0], flux.jumps[flux.jumps > 0]
    before, after = (_edges(mesh, at + off) for off in (-flux.reach, flux.reach))
    apart, nb = before != after, len(mesh.boundary)
    edge = np.concatenate([edge, before, after[apart]])
    length = np.append(length, np.full(len(edge) - len(length), 2 * flux.reach))
    size = np.concatenate([doubt, jumps, jumps[apart]])
    square, integral = (np.bincount(edge, length * size**power, nb).astype(float) for power in (2, 1))
    return np.sqrt(square), integral


def _rounding(flux: Flux, mesh: Mesh, edge: Index, size: Array) -> Array:
    """(nb,) the rounding of tau~, from the largest |p| on intervals (K,).

    Places, and so the edges' lengths, are rounded, too.
    """
    largest = np.zeros(len(mesh.boundary))
    np.maximum.at(largest, edge, size)
    terms = 1 + np.bincount(edge, minlength=len(largest))
    return np.asarray(largest * (ROUNDING * terms + flux.reach / np.diff(mesh.s)))


def _squares(mesh: Mesh, left: Array, size: Array, integral: Array) -> Array:
    """(2, nb) the squares of `Given`, from ||p - tau~|| and bounds on ||rho|| and on the integral of rho."""
    lengths, square = np.diff(mesh.s), has_square(mesh)
    on_square = math.sqrt(ON_SQUARE) * left + math.sqrt(MEAN_FREE_ON_SQUARE) * size
    on_triangle = np.sqrt(trace_constants(mesh)) * (left + size)
    of_mean = np.sqrt(value_constants(mesh) / lengths) * integral
    on_squares = np.where(square, np.sqrt(lengths) * on_square, 0.0)
    return np.stack([on_squares, np.where(square, 0.0, on_triangle) + of_mean]) ** 2


def _edges(mesh: Mesh, s: Array) -> Index:
    """(k,) the boundary edges on which arc lengths (k,) lie."""
    return np.clip(np.searchsorted(mesh.s, s) - 1, 0, len(mesh.boundary) - 1)
