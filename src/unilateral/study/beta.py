"""The constants of (3.4) and of Theorem 5 for one mesh and one partition."""

from __future__ import annotations

from unilateral.fem.spaces import DualOperator
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.norms.dual import Bracket
from unilateral.norms.infsup import InfSup, cellwise, infsup
from unilateral.norms.pairing import certified_cellwise, pairing_constant
from unilateral.norms.resolution import Resolution, resolution

OF_PAIR = (
    "h",
    "h_over_H",
    *Resolution._fields,
    *InfSup._fields,
    "beta_0_cellwise",
    "beta_0_certified",
    "pairing",
)


def constants(mesh: Mesh, partition: Partition, operator: DualOperator, gram: Bracket) -> dict[str, float]:
    """The constants of (3.4) and of Theorem 5 of one pair, and how finely the mesh resolves the cells."""
    return {
        **resolution(mesh, partition)._asdict(),
        **infsup(operator, gram)._asdict(),
        "beta_0_cellwise": cellwise(operator),
        "beta_0_certified": certified_cellwise(mesh, partition),
        "pairing": pairing_constant(mesh.s, partition),
    }
