"""Dual operators of structured meshes, and offsets F(0) of which the contact is known."""

import numpy as np
from conftest import couple_structured_mesh

from unilateral.solvers.active_set import solve_by_active_set


def operator(n, ratio, polygon="square"):
    """The dual operator for h = 1/n and H = ratio h."""
    return couple_structured_mesh(polygon, n, n / ratio).operator


def middles(operator):
    return np.cumsum(operator.H_i) - 0.5 * operator.H_i


def full_contact(operator):
    """A positive multiplier, and the offset for which it is the solution: F(lambda) = 0 on every cell."""
    lambda_H = 2 + np.sin(3 * middles(operator))
    return lambda_H, -operator.D @ lambda_H / operator.H_i


OFFSETS = {
    "partial contact": lambda operator: np.sin(1.5 * np.pi * middles(operator)) + 0.3,
    "full contact": lambda operator: full_contact(operator)[1],
    "no contact": lambda operator: 1 + 0.5 * np.sin(middles(operator)),
    "rough": lambda operator: np.random.default_rng(7).standard_normal(len(operator.H_i)),
}
partial_contact = OFFSETS["partial contact"]


def distance(operator, mu, nu):
    """||mu - nu||_{-1/2,h}."""
    return float(np.linalg.norm(operator.D_factor @ (mu - nu)))


def exact(operator, offset):
    return solve_by_active_set(operator, offset, 1e-5).lambda_H
