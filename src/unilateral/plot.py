"""The picture of a solution."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from unilateral.arrays import Array
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition

CONTACT = "tab:red"


def figure(mesh: Mesh, u_h: Array, partition: Partition, multiplier: Array, gap: Array) -> Figure:
    """u_h (n,) on the mesh with the cells in contact, above lambda_H and u_h - g (m,) along the boundary."""
    page = Figure(figsize=(6.7, 7.5), layout="constrained")
    top, bottom = page.subplots(2, 1, height_ratios=(2, 1))
    field = top.tripcolor(*mesh.points.T, mesh.triangles, u_h, shading="gouraud")
    page.colorbar(field, ax=top, label="$u_h$")
    s, polygon = partition.points, partition.polygon
    for first, last in zip(*(each[multiplier > 0] for each in partition.ends), strict=True):
        top.plot(*np.stack([first, last]).T, color=CONTACT, linewidth=3, solid_capstyle="butt")
    top.set(aspect="equal", xlabel="x", ylabel="y", title="$u_h$; red: cells with $\\lambda_H > 0$")
    bottom.stairs(multiplier, s, color=CONTACT, label="$\\lambda_H$")
    bottom.stairs(gap, s, baseline=None, color="tab:blue", label="mean of $u_h - g$")
    for start in polygon.starts:
        bottom.axvline(start, color="0.8", linewidth=0.8, zorder=0)
    bottom.set(xlabel="arc length along the boundary, a line at each vertex", xlim=(0, polygon.perimeter))
    bottom.legend()
    return page
