"""The picture of a solution."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from unilateral.arrays import Array
from unilateral.contact import Contact
from unilateral.geometry.mesh import Mesh

CONTACT = "tab:red"
DOTS = 200
"""Per inch, of what has as many parts as the mesh."""
LINE = 20.0
"""Points; over the root of the number of triangles it is the width of the mesh's lines."""


def figure(mesh: Mesh, u_h: Array, contact: Contact, gap: Array, with_mesh: bool) -> Figure:
    """u_h (n,) with the contact set, above lambda_H and u_h - g (m,) along the boundary.

    The mesh is drawn beside u_h if that is asked for.
    """
    page = Figure(figsize=(10 if with_mesh else 6.7, 7.5), layout="constrained", dpi=DOTS)
    grid = page.add_gridspec(2, 2 if with_mesh else 1, height_ratios=(2, 1))
    top, bottom = page.add_subplot(grid[0, 0]), page.add_subplot(grid[1, :])
    triangles = Triangulation(mesh.points[:, 0], mesh.points[:, 1], mesh.triangles)
    field = top.tripcolor(triangles, u_h, shading="gouraud", rasterized=True)
    page.colorbar(field, ax=top, label="$u_h$")
    lines = [(each.first, each.last) for each in contact.intervals]
    top.add_collection(LineCollection(lines, colors=CONTACT, linewidths=3, capstyle="butt"))
    where = "the whole boundary" if contact.full else f"length {contact.length:.4g}"
    top.set(aspect="equal", xlabel="x", ylabel="y", title=f"$u_h$; red: contact, {where}")
    if with_mesh:
        beside = page.add_subplot(grid[0, 1], sharex=top, sharey=top)
        width = min(0.5, LINE / np.sqrt(len(mesh.triangles)))
        beside.triplot(triangles, color="k", linewidth=width, rasterized=True)
        beside.set(aspect="equal", xlabel="x", title=f"the mesh: {len(mesh.triangles)} triangles")
    s, polygon = contact.partition.points, contact.partition.polygon
    bottom.stairs(contact.lambda_H, s, color=CONTACT, label="$\\lambda_H$")
    bottom.stairs(gap, s, baseline=None, color="tab:blue", label="mean of $u_h - g$")
    for start in polygon.starts:
        bottom.axvline(start, color="0.8", linewidth=0.8, zorder=0)
    bottom.set(xlabel="arc length along the boundary, a line at each vertex", xlim=(0, polygon.perimeter))
    bottom.legend()
    return page


def draw(page: Figure, path: Path) -> None:
    """Into a file, the same bytes for the same figure."""
    undated = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    with mpl.rc_context({"svg.hashsalt": "unilateral", "svg.fonttype": "path"}):
        page.savefig(path, metadata=undated.get(path.suffix))


def svg(page: Figure) -> str:
    """As an element of a page of HTML, the same for the same figure."""
    found = StringIO()
    with mpl.rc_context({"svg.hashsalt": "unilateral", "svg.fonttype": "path"}):
        page.savefig(found, format="svg", metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))
    return "<svg" + found.getvalue().partition("<svg")[2]
