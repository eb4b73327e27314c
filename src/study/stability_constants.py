"""The constants of (3.4) and of Theorem 5 for one mesh and one partition, and what they say of a run.

The proof of Theorem 5 pairs P0(T_H) with functions that are linear between inner nodes: one node in each cell
is kept, that of `innermost_nodes`. V holds the continuous functions on the boundary that are linear in arc
length from one kept node to the next; they are traces of functions in V_h.
"""

from __future__ import annotations

import math

import numpy as np
import xarray as xr
from scipy.linalg import eigh

from study.tables import ZERO_ERROR_SHARE
from unilateral.arrays import Array
from unilateral.fem.condense import form_matrix
from unilateral.fem.spaces import DualOperator, MixedSpaces
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.dual import Bracket, Gram
from unilateral.norms.fortin import beta_lower_bound, extend_hats
from unilateral.norms.infsup import InfSup, infsup_constants
from unilateral.norms.resolution import Resolution, innermost_nodes, resolution

PAIR_CONSTANTS = (
    "h",
    "h_over_H",
    *Resolution._fields,
    *InfSup._fields,
    "beta_fortin",
    "beta_0_cellwise",
    "beta_0_certified",
    "pairing",
)


def pair_constants(spaces: MixedSpaces, gram: Bracket) -> dict[str, float]:
    """The constants of (3.4) and of Theorem 5 of one pair, and how finely the mesh resolves the cells.

    The bound `beta_0_certified` is not computed where a side is clamped.
    """
    mesh = spaces.mesh
    partition = spaces.partition
    form = spaces.condensed.form
    return {
        **resolution(mesh, partition)._asdict(),
        **infsup_constants(spaces.operator, gram)._asdict(),
        "beta_fortin": beta_lower_bound(mesh, partition, form),
        "beta_0_cellwise": cellwise_constant(spaces.operator),
        "beta_0_certified": math.nan if form.clamped else cellwise_lower_bound(mesh, partition),
        "pairing": pairing_constant(mesh.s, partition),
    }


def cellwise_constant(operator: DualOperator) -> float:
    """The constant of Theorem 5: sup over V_h of <mu, v>/||v||_1 against (sum_i H_i^2 mu_i^2)^{1/2}.

    On cells of one length it is beta_0, else it is larger.
    """
    # mu.D mu = sup <mu, v>^2 / ||v||_1^2; in z_i = H_i mu_i the least eigenvalue is the constant's square
    weighted = operator.D / operator.H_i[:, None] / operator.H_i
    return math.sqrt(max(float(eigh(weighted, eigvals_only=True, subset_by_index=[0, 0])[0]), 0.0))


def pairing_matrix(nodes: Array, partition: Partition) -> Array:
    """Matrix M (m, m) with <mu, v> = sum_i H_i mu_i (M y)_i for v in V with the values y at `nodes`.

    M = diag(H_i)^{-1} B, B the integrals of V's hats over the cells; node i lies inside cell i.
    """
    # The distances p_i, q_i of node i from both ends of cell i, and from it to the next node
    before = nodes - partition.points[:-1]
    after = partition.points[1:] - nodes
    between = after + np.roll(before, -1)
    # On cell i the hats of the nodes beside it are triangles with the bases q_i and p_i
    next_one = after**2 / (2 * between * partition.lengths)
    last_one = before**2 / (2 * np.roll(between, 1) * partition.lengths)
    identity = np.eye(len(nodes))
    return (
        np.diag(1 - next_one - last_one)
        + next_one[:, None] * np.roll(identity, 1, axis=1)
        + last_one[:, None] * np.roll(identity, -1, axis=1)
    )


def pairing_constant(s: Array, partition: Partition) -> float:
    """The smallest singular value of M for mesh nodes s (nb + 1,); NaN where a cell has none inside."""
    nodes, deltas = innermost_nodes(s, partition)
    if not deltas.all():
        return math.nan
    return float(np.linalg.svd(pairing_matrix(nodes, partition), compute_uv=False)[-1])


def pairing_constant_bound(delta: Array) -> Array:
    """Lower bound delta/4 on the pairing constant, (6) in the proof of Theorem 5.

    The values w of v at the cells' ends solve K w = 2 (q_i m_i + p_i m_{i+1}), m the means M y. K is
    diagonally dominant by 2 delta in rows and by delta in columns.
    """
    return 0.25 * delta


def cellwise_lower_bound(mesh: Mesh, partition: Partition) -> float:
    """A guaranteed lower bound on `cellwise_constant`, without a solution; 0 where a cell has no node inside.

    For mu let y = M^{-1} z, z_i = H_i mu_i, and v = W y in V_h. Then <mu, v> = |z|^2, |y| <= |z| / sigma with
    the pairing constant sigma, and ||v||_1^2 = y . W^T A W y <= E |y|^2 with E the largest row sum of
    |W^T A W|. So the supremum is at least sigma |z| / E^{1/2}, whatever `extend_hats` is.
    """
    sigma = pairing_constant(mesh.s, partition)
    if math.isnan(sigma):
        return 0.0
    # sigma / E^{1/2}: for a symmetric matrix the largest row sum bounds the largest eigenvalue
    W = extend_hats(mesh, innermost_nodes(mesh.s, partition)[0])
    return sigma / math.sqrt(abs(W.T @ form_matrix(mesh) @ W).sum(axis=1).max())


def bound_multiplier_error(
    gram: Gram, case_index: int, mean_errors: Array, discrete_error: float
) -> tuple[float, float]:
    """The lower and the upper bound on ||lambda - mu||_{-1/2}, for mu constant on the cells of `gram`.

    Lambda is number `case_index` of the functions in `gram`, `mean_errors` (m,) are the means of lambda - mu,
    and `discrete_error` is ||lambda - mu||_{-1/2,h}, which by its definition is a lower bound, too.
    """
    lower, upper = gram.error_bounds(case_index, mean_errors[None])
    return max(float(lower[0]), discrete_error), float(upper[0])


def lemma_quotients(errors: xr.Dataset) -> xr.Dataset:
    """Quotients of the sides of Lemmas 3.1 and 4.3 for every run of a scene, with its measured errors.

    `norm_ratio_lower` and `norm_ratio_upper` bound ||e||_{-1/2,h} / ||e||_{-1/2} for e = lambda - lambda_H,
    which lies in [0, 1] and, if e were in P0(T_H), above beta; `lemma_4_3` is the left side of (4.6) over the
    right one with the constants 1 + 1/beta and 1/beta, every factor taken on its unfavourable side. NaN where
    beta or, to round-off, the error is 0.
    """
    beta = errors["beta_upper"]
    upper = errors["hm12_error_upper"]
    is_known = (beta > 0) & (upper > ZERO_ERROR_SHARE * errors["u_norm"])
    # (4.6): ||lambda - lambda_H||_{-1/2} <= (1 + 1/beta) inf ||lambda - mu||_{-1/2} + ||u - u_h||_1 / beta
    right_side = (1 + 1 / beta) * errors["hm12_best"] + errors["h1_error"] / beta
    ratios = {
        "norm_ratio_lower": errors["discrete_error"] / upper,
        "norm_ratio_upper": errors["discrete_error"] / errors["hm12_error_lower"],
        "lemma_4_3": upper / right_side,
    }
    table = xr.Dataset(
        {name: q.where(is_known).transpose("case", "mesh", "partition") for name, q in ratios.items()}
    )
    return table.merge(errors[["beta_lower", "beta_upper", "beta_0"]])
