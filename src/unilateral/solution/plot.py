"""The picture of a solution."""

from __future__ import annotations

from io import StringIO
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from unilateral.arrays import Array
from unilateral.geometry.mesh import Mesh
from unilateral.solution.contact import Contact

CONTACT, GAP = "tab:red", "tab:blue"
DOTS = 150
"""Dots per inch of what has as many parts as the mesh."""
LINE = 20.0
"""The width of the mesh's lines is this many points over the root of the number of triangles, or less."""
WIDTH, ALONG = 5.5, 2.2
"""WIDTH is that of a panel with the domain, ALONG the height of both panels along the boundary, in inches."""
FLATTEST, TALLEST = 0.25, 1.2
"""The least and the largest height over width of the space for the domain."""
MARGIN = 0.03
"""The margin around the domain, as a fraction of its size."""
LEVELS = 12
"""At most this many levels of u_h have a line."""
NUMBERED = 0.07
"""Sides longer than this fraction of the perimeter have their number along the boundary."""


def figure(mesh: Mesh, u_h: Array, contact: Contact, gap: Array, with_mesh: bool, title: str) -> Figure:
    """u_h (n,) with the contact set, above lambda_H and u_h - g (m,) along the boundary.

    The mesh is drawn beside u_h if that is asked for.
    """
    width, height = np.ptp(mesh.points, axis=0)
    tall = WIDTH * float(np.clip(height / width, FLATTEST, TALLEST))
    columns = 2 if with_mesh else 1
    page = Figure(figsize=(columns * WIDTH + 1.0, tall + 2 * ALONG), layout="constrained", dpi=DOTS)
    grid = page.add_gridspec(3, columns, height_ratios=(tall, ALONG / 2, ALONG / 2))
    top = page.add_subplot(grid[0, 0])
    triangles = Triangulation(mesh.points[:, 0], mesh.points[:, 1], mesh.triangles)
    _solution(top, triangles, u_h, contact)
    if with_mesh:
        _mesh(page.add_subplot(grid[0, 1]), triangles)
    flux = page.add_subplot(grid[1, :])
    _along(flux, page.add_subplot(grid[2, :], sharex=flux), contact, gap)
    page.suptitle(title)
    return page


def _solution(axes: Axes, triangles: Triangulation, u_h: Array, contact: Contact) -> None:
    """u_h with its lines of level, a colour bar of the panel's height, and the contact set."""
    field = axes.tripcolor(triangles, u_h, shading="gouraud", rasterized=True)
    if np.ptp(u_h) > 0:
        axes.tricontour(
            triangles, u_h, levels=LEVELS, colors="w", linewidths=0.5, alpha=0.6, linestyles="solid"
        )
    axes.figure.colorbar(field, cax=axes.inset_axes((1.03, 0, 0.04, 1)))
    lines = [(each.first, each.last) for each in contact.intervals]
    axes.add_collection(LineCollection(lines, colors=CONTACT, linewidths=4, capstyle="butt", zorder=3))
    where = "the whole boundary" if contact.full else f"length {contact.length:.4g}"
    axes.set(xlabel="x", ylabel="y", title=f"$u_h$; contact in red, {where}")
    _fitted(axes)


def _mesh(axes: Axes, triangles: Triangulation) -> None:
    n = len(triangles.triangles)
    axes.triplot(triangles, color="k", linewidth=min(0.5, LINE / np.sqrt(n)), rasterized=True)
    axes.set(xlabel="x", title=f"the mesh: {n} triangles")
    _fitted(axes)


def _fitted(axes: Axes) -> None:
    """Fits axes to the domain, with room around it for lines of contact; contour lines would leave none."""
    axes.use_sticky_edges = False
    axes.set_aspect("equal")
    axes.margins(MARGIN)


def _along(above: Axes, below: Axes, contact: Contact, gap: Array) -> None:
    """lambda_H, and below it u_h - g, over the arc length; sides have a line at their ends, and a number."""
    s, polygon = contact.partition.points, contact.partition.polygon
    above.stairs(contact.lambda_H, s, color=CONTACT, fill=True, alpha=0.3)
    above.stairs(contact.lambda_H, s, color=CONTACT)
    below.stairs(gap, s, baseline=0, color=GAP)
    if not np.nan_to_num(gap).any():
        where = "on the whole boundary" if np.isfinite(gap).all() else "on all sides that are not free"
        below.text(0.5, 0.75, f"$u_h = g$ {where}", ha="center", va="center", transform=below.transAxes)
        below.set(ylim=(-1, 1), yticks=[0])
    for axes, label in ((above, "$\\lambda_H$"), (below, "mean of $u_h - g$")):
        for start in polygon.starts:
            axes.axvline(start, color="0.8", linewidth=0.8, zorder=0)
        axes.axhline(0, color="0.8", linewidth=0.8, zorder=0)
        axes.set(ylabel=label, xlim=(0, polygon.perimeter))
    above.tick_params(labelbottom=False)
    below.set(xlabel="arc length along the boundary")
    long, sides = np.flatnonzero(polygon.lengths > NUMBERED * polygon.perimeter), above.secondary_xaxis("top")
    sides.set_xticks((polygon.starts[:-1] + polygon.lengths / 2)[long], [f"side {i}" for i in long])
    sides.tick_params(length=0)


def settled(gap: Array, lambda_H: Array) -> Array:
    """u_h - g (m,), but 0 where it is no larger than what a converged iteration has left of 0; NaN stays.

    In exact arithmetic it is 0 where lambda_H > 0, and nowhere below 0. Values that differ from this tell the
    size of what is left.
    """
    held = np.isfinite(gap)
    rest = np.where(lambda_H[held] > 0, np.abs(gap[held]), np.maximum(-gap[held], 0.0))
    return np.where(np.abs(gap) <= rest.max(initial=0.0), 0.0, gap)


def draw(page: Figure, path: Path) -> None:
    """Writes the figure into a file, with the same bytes for the same figure."""
    undated = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    with mpl.rc_context({"svg.hashsalt": "unilateral", "svg.fonttype": "path"}):
        page.savefig(path, metadata=undated.get(path.suffix))


def svg(page: Figure) -> str:
    """The figure as an element of a page of HTML, the same for the same figure."""
    found = StringIO()
    with mpl.rc_context({"svg.hashsalt": "unilateral", "svg.fonttype": "path"}):
        page.savefig(found, format="svg", metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))
    return "<svg" + found.getvalue().partition("<svg")[2]
