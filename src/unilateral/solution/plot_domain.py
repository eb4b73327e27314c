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
from unilateral.solution.plot_data import PlotData, select_numbered_sides

CONTACT_COLOUR = "tab:red"
FREE_COLOUR = "0.45"
MESH_LINE_POINTS = 20.0
MAX_OUTLINED_TRIANGLES = 20_000
"""Width in points of a mesh's lines, over the root of the number of triangles. With more than so many
triangles the lines would merge to grey, and colours show the lengths of edges instead."""
MAX_HEIGHT_OVER_WIDTH = 1.2
MAX_SCALED_ASPECT = 8.0
"""Largest height over width of a panel; a domain that is longer than wide by more is not drawn to scale."""
DOMAIN_MARGIN = 0.03
"""The margin around the domain, as a fraction of its size."""
MAX_CONTOUR_LEVELS = 12
"""At most this many levels of u_h have a line."""
OUTWARD_STROKES = withTickedStroke(spacing=6, angle=-135, length=1.4)
CLAMPED_SIDE_STYLE: Any = {
    "color": "k",
    "linewidth": 1.5,
    "path_effects": [OUTWARD_STROKES],
    "clip_on": False,
    "zorder": 2,
}
"""Oblique strokes, as for walls: to the right of a side as one goes anticlockwise, which is outside."""


def draw_domain(axes: Axes, plot_data: PlotData, is_bar_inside: bool = False) -> None:
    """Draws u_h with its contour lines, a colour bar, sides with numbers, and contact.

    The colour bar is beside the axes, or takes a part of them if `is_bar_inside`.
    """
    field = _shade_nodal_values(axes, plot_data, plot_data.u, Normalize(*plot_data.colour_limits))
    if plot_data.has_variation:
        lines: Any = {"colors": "w", "alpha": 0.6, "linewidths": 0.5, "linestyles": "solid"}
        u = plot_data.u[plot_data.surface[0]]
        axes.tricontour(_triangulate_surface(plot_data), u, MAX_CONTOUR_LEVELS, **lines)
    add_bar = _add_colour_bar_below if is_bar_inside else _add_colour_bar
    bar = add_bar(axes, field, "$u_h$")
    bar.set_ticks(choose_ticks() if plot_data.has_variation else FixedLocator([float(plot_data.u[0])]))
    # in a figure of the user's, labels beyond the axes would reach into the next ones
    _draw_outline(axes, plot_data, legend_right=1.0 if is_bar_inside else 1.15)
    axes.set(xlabel="x", ylabel="" if is_bar_inside else "y", title=plot_data.contact_text)
    _fit_axes(axes, plot_data)


def draw_mesh(axes: Axes, plot_data: PlotData) -> None:
    """Draws the triangles, or where they are many the lengths of their longest edges."""
    n = len(plot_data.mesh.triangles)
    if n <= MAX_OUTLINED_TRIANGLES:
        x, y = plot_data.mesh.points.T
        triangulation = Triangulation(x, y, plot_data.mesh.triangles)
        linewidth = min(0.5, MESH_LINE_POINTS / np.sqrt(n))
        axes.triplot(triangulation, color="k", linewidth=linewidth, rasterized=True)
    else:
        # at each node the geometric mean over its triangles
        nodes = plot_data.mesh.triangles.ravel()
        logs = np.bincount(nodes, np.repeat(np.log(plot_data.mesh.longest_edges), 3)) / np.bincount(nodes)
        field = _shade_nodal_values(axes, plot_data, np.exp(logs), LogNorm(), "cividis")
        _add_colour_bar(axes, field, "longest edge")
    axes.set(xlabel="x", title=f"the mesh: {n:,} triangles".replace(",", " "))
    _fit_axes(axes, plot_data)


def _triangulate_surface(plot_data: PlotData) -> Triangulation:
    nodes, triangles = plot_data.surface
    return Triangulation(plot_data.mesh.points[nodes, 0], plot_data.mesh.points[nodes, 1], triangles)


def _shade_nodal_values(
    axes: Axes, plot_data: PlotData, values: Array, norm: Normalize, colours: str | None = None
) -> TriMesh:
    """Colours for the values (n,) at the nodes of the mesh."""
    look: Any = {"shading": "gouraud", "norm": norm, "cmap": colours, "rasterized": True}
    return axes.tripcolor(_triangulate_surface(plot_data), values[plot_data.surface[0]], **look)


def _add_colour_bar(axes: Axes, field: ScalarMappable, label: str) -> Colorbar:
    """A colour bar of the panel's height."""
    assert axes.figure is not None
    return axes.figure.colorbar(field, cax=axes.inset_axes((1.03, 0, 0.04, 1)), label=label)


def _add_colour_bar_below(axes: Axes, field: ScalarMappable, label: str) -> Colorbar:
    """A colour bar below the axes, which give up a part of their height to it; nothing is at their sides."""
    assert axes.figure is not None
    return axes.figure.colorbar(field, ax=axes, label=label, location="bottom", fraction=0.06, pad=0.22)


def choose_ticks(relative_length: float = 1.0) -> MaxNLocator:
    """Locator of one to four ticks at round numbers, for an axis of that length."""
    return MaxNLocator(int(np.clip(np.ceil(4 * relative_length), 1, 4)), steps=[1, 2, 2.5, 5, 10])


def _draw_outline(axes: Axes, plot_data: PlotData, legend_right: float) -> None:
    """Draws contact in red, clamped sides hatched, free ones dashed, others solid, with numbers at sides.

    The legend ends at `legend_right` times the width of the axes.
    """
    polygon = plot_data.mesh.polygon
    free = np.setdiff1d(plot_data.contact.partition.side[plot_data.no_contact], plot_data.clamped_sides)
    sides = np.stack([polygon.vertices, np.roll(polygon.vertices, -1, axis=0)], axis=1)
    solid = np.delete(np.arange(polygon.n_sides), free)
    for group, style in ((solid, {"colors": "k"}), (free, {"colors": FREE_COLOUR, "linestyles": "dashed"})):
        axes.add_collection(LineCollection([*sides[group]], linewidths=1.2, zorder=2, **style))
    for side in plot_data.clamped_sides:
        label = "clamped" if side == plot_data.clamped_sides[0] else None  # once in the legend
        axes.plot(*sides[side].T, **CLAMPED_SIDE_STYLE, label=label)
    if plot_data.clamped_sides:
        axes.legend(
            loc="upper right",
            bbox_to_anchor=(legend_right, 0),
            fontsize="small",
            borderaxespad=2,
            frameon=False,
        )
    lines = [(interval.first, interval.last) for interval in plot_data.contact.intervals]
    axes.add_collection(LineCollection(lines, colors=CONTACT_COLOUR, linewidths=4, capstyle="butt", zorder=3))
    for side in select_numbered_sides(plot_data.mesh.polygon):
        offset = -10 * polygon.normals[side]
        halo = [withStroke(linewidth=2, foreground="w")]
        axes.annotate(str(side), sides[side].mean(axis=0), offset, textcoords="offset points", ha="center",
                      va="center", fontsize="small", zorder=4, path_effects=halo)  # fmt: skip


def _fit_axes(axes: Axes, plot_data: PlotData) -> None:
    """Fits axes to the domain, with room around it for lines of contact; contour lines would leave none."""
    width, height = np.ptp(plot_data.mesh.points, axis=0)
    to_scale = 1 / MAX_SCALED_ASPECT <= height / width <= MAX_SCALED_ASPECT
    axes.use_sticky_edges = False
    axes.set_aspect("equal" if to_scale else "auto")
    axes.margins(DOMAIN_MARGIN)
    if not to_scale:
        axes.set_title(f"{axes.get_title()}; not to scale")
    for axis, relative_length in ((axes.xaxis, width / height), (axes.yaxis, height / width)):
        axis.set_major_locator(choose_ticks(relative_length if to_scale else 1.0))
