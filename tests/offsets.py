"""Dual operators of structured meshes, and offsets F(0) of which the contact is known."""

import numpy as np
from conftest import coupled

from unilateral.solvers.active_set import solve_by_active_set


def operator(n, ratio, polygon="square"):
    """The dual operator for h = 1/n and H = ratio h."""
    return coupled(polygon, n, n / ratio).operator


def middles(of):
    return np.cumsum(of.H_i) - 0.5 * of.H_i


def full_contact(of):
    """A positive multiplier, and the offset for which it is the solution: F(lambda) = 0 on every cell."""
    lambda_H = 2 + np.sin(3 * middles(of))
    return lambda_H, -of.D @ lambda_H / of.H_i


OFFSETS = {
    "partial contact": lambda of: np.sin(1.5 * np.pi * middles(of)) + 0.3,
    "full contact": lambda of: full_contact(of)[1],
    "no contact": lambda of: 1 + 0.5 * np.sin(middles(of)),
    "rough": lambda of: np.random.default_rng(7).standard_normal(len(of.H_i)),
}
partial_contact = OFFSETS["partial contact"]


def distance(of, mu, nu):
    """||mu - nu||_{-1/2,h}."""
    return float(np.linalg.norm(of.D_factor @ (mu - nu)))


def exact(of, offset):
    return solve_by_active_set(of, offset, 1e-5).lambda_H
