"""The panels of a picture that show the domain: u_h with the contact set, and the mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, TriMesh
from matplotlib.colorbar import Colorbar
from matplotlib.colors import LogNorm, Normalize
from matplotlib.patheffects import withStroke, withTickedStroke
from matplotlib.ticker import FixedLocator, MaxNLocator
from matplotlib.tri import Triangulation

from unilateral.arrays import Array
from unilateral.solution.shown import Shown, numbered

CONTACT = "tab:red"
FREE = "0.45"
LINE = 20.0
TRIANGLES = 20_000
"""The mesh's lines are LINE points over the root of the number of triangles wide, or less.

Above so many TRIANGLES lines would be grey, and the lengths of their edges are shown by colours.
"""
TALLEST = 1.2
LONG = 8.0
"""The largest height over width of the space for the domain.

One with longer sides by a factor LONG is not drawn to scale, for it would be a line.
"""
MARGIN = 0.03
"""The margin around the domain, as a fraction of its size."""
LEVELS = 12
"""At most this many levels of u_h have a line."""
OUTSIDE = withTickedStroke(spacing=6, angle=-135, length=1.4)
CLAMPED: Any = {"color": "k", "linewidth": 1.5, "path_effects": [OUTSIDE], "clip_on": False, "zorder": 2}
"""Oblique strokes, as for walls: to the right of a side as one goes anticlockwise, which is outside."""


def domain(axes: Axes, of: Shown, inside: bool = False) -> None:
    """u_h with its lines of level, a colour bar of the panel's height, sides with numbers, and contact.

    The colour bar is beside the axes, or takes a part of them if all has to stay `inside`.
    """
    field = _shaded(axes, of, of.u, Normalize(*of.limits))
    lines = {"linewidths": 0.5, "linestyles": "solid"}
    if of.varies:
        axes.tricontour(_surface(of), of.u[of.surface[0]], LEVELS, colors="w", alpha=0.6, **lines)
    bar = _bar_in_slot(axes, field, "$u_h$") if inside else _bar(axes, field, "$u_h$")
    bar.set_ticks(ticks() if of.varies else FixedLocator([float(of.u[0])]))
    _outline(axes, of)
    axes.set(xlabel="x", ylabel="y", title=of.where)
    _fitted(axes, of)


def mesh(axes: Axes, of: Shown) -> None:
    """The triangles, or where they are many their sizes: the mean on a logarithmic scale at each node."""
    n = len(of.mesh.triangles)
    if n <= TRIANGLES:
        whole = Triangulation(of.mesh.points[:, 0], of.mesh.points[:, 1], of.mesh.triangles)
        axes.triplot(whole, color="k", linewidth=min(0.5, LINE / np.sqrt(n)), rasterized=True)
    else:
        nodes = of.mesh.triangles.ravel()
        logs = np.bincount(nodes, np.repeat(np.log(of.mesh.longest_edges), 3)) / np.bincount(nodes)
        _bar(axes, _shaded(axes, of, np.exp(logs), LogNorm(), "cividis"), "longest edge")
    axes.set(xlabel="x", title=f"the mesh: {n:,} triangles".replace(",", " "))
    _fitted(axes, of)


def _surface(of: Shown) -> Triangulation:
    nodes, triangles = of.surface
    return Triangulation(of.mesh.points[nodes, 0], of.mesh.points[nodes, 1], triangles)


def _shaded(axes: Axes, of: Shown, values: Array, norm: Normalize, colours: str | None = None) -> TriMesh:
    """Colours for the values (n,) at the nodes of the mesh."""
    look: Any = {"shading": "gouraud", "norm": norm, "cmap": colours, "rasterized": True}
    return axes.tripcolor(_surface(of), values[of.surface[0]], **look)


def _bar(axes: Axes, field: ScalarMappable, label: str) -> Colorbar:
    """A colour bar of the panel's height."""
    assert axes.figure is not None
    return axes.figure.colorbar(field, cax=axes.inset_axes((1.03, 0, 0.04, 1)), label=label)


def _bar_in_slot(axes: Axes, field: ScalarMappable, label: str) -> Colorbar:
    """A colour bar below the axes, which give up a part of their height to it; nothing is at their sides."""
    assert axes.figure is not None
    return axes.figure.colorbar(field, ax=axes, label=label, location="bottom", fraction=0.06, pad=0.22)


def ticks(room: float = 1.0) -> MaxNLocator:
    """Few ticks at round numbers, the fewer the smaller the room is."""
    return MaxNLocator(int(np.clip(np.ceil(4 * room), 1, 4)), steps=[1, 2, 2.5, 5, 10])


def _outline(axes: Axes, of: Shown) -> None:
    """The contact set in red, clamped sides hatched, free ones dashed, others solid, and numbers at sides."""
    polygon = of.mesh.polygon
    free = np.setdiff1d(of.contact.partition.side[of.free], of.clamped)
    sides = np.stack([polygon.vertices, np.roll(polygon.vertices, -1, axis=0)], axis=1)
    held = np.delete(np.arange(polygon.n_sides), free)
    for these, look in ((held, {"colors": "k"}), (free, {"colors": FREE, "linestyles": "dashed"})):
        axes.add_collection(LineCollection([*sides[these]], linewidths=1.2, zorder=2, **look))
    for side in of.clamped:
        axes.plot(*sides[side].T, **CLAMPED, label="clamped" if side == of.clamped[0] else None)
    if of.clamped:
        axes.legend(
            loc="upper right", bbox_to_anchor=(1.15, 0), fontsize="small", borderaxespad=2, frameon=False
        )
    lines = [(each.first, each.last) for each in of.contact.intervals]
    axes.add_collection(LineCollection(lines, colors=CONTACT, linewidths=4, capstyle="butt", zorder=3))
    for side in numbered(of):
        inside = -10 * polygon.normals[side]
        around = [withStroke(linewidth=2, foreground="w")]
        axes.annotate(str(side), sides[side].mean(axis=0), inside, textcoords="offset points", ha="center",
                      va="center", fontsize="small", zorder=4, path_effects=around)  # fmt: skip


def _fitted(axes: Axes, of: Shown) -> None:
    """Fits axes to the domain, with room around it for lines of contact; contour lines would leave none."""
    width, height = np.ptp(of.mesh.points, axis=0)
    to_scale = 1 / LONG <= height / width <= LONG
    axes.use_sticky_edges = False
    axes.set_aspect("equal" if to_scale else "auto")
    axes.margins(MARGIN)
    if not to_scale:
        axes.set_title(f"{axes.get_title()}; not to scale")
    for axis, room in ((axes.xaxis, width / height), (axes.yaxis, height / width)):
        axis.set_major_locator(ticks(room if to_scale else 1.0))
