"""One solution: u_h on its mesh with the contact set, and the boundary values beside the exact ones."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation

from unilateral.errors import InputError
from unilateral.study.figures.style import (
    COLOURS,
    SMALL,
    WIDTH,
    FilePath,
    as_fraction,
    axes_at,
    figure_in,
    plain_bar,
    read,
)

MESH_COLUMNS = ("triangle", "x", "y", "u_h", "h", "H")
BOUNDARY_COLUMNS = ("kind", "side", "s", "end", "computed", "exact", "contact", "x", "y")
COMPUTED: dict[str, Any] = {"color": COLOURS[0], "lw": 1.6}
ANALYTIC: dict[str, Any] = {"color": "black", "lw": 1.0, "ls": (0, (4, 2))}
CONTACT: dict[str, Any] = {
    "color": COLOURS[1],
    "lw": 3.5,
    "solid_capstyle": "butt",
    "path_effects": [withStroke(linewidth=5.5, foreground="white")],
}


def portrait(mesh_csv: FilePath, boundary_csv: FilePath, svg_path: FilePath) -> None:
    """u_h on its mesh with the contact set; along the boundary, u_h - g and lambda_H against the exact ones.

    `mesh_csv`: triangle, x, y, u_h, h, H, three rows per triangle. `boundary_csv`: kind, side, s, end,
    computed, exact, contact, x, y. Rows `trace` are points in the order of s, a vertex once for either
    side: u_h - g, u - g, contact (0, 1), and where the point lies; `multiplier` are cells from s to end:
    lambda_H; `flux` are points: lambda. Raises InputError for tables without them.
    """
    triangles = read(mesh_csv, MESH_COLUMNS)
    if (triangles["triangle"].value_counts() != 3).any():
        raise InputError(f"{mesh_csv}, column 'triangle': every triangle has to have three rows")
    boundary = read(boundary_csv, BOUNDARY_COLUMNS, {"kind": ("trace", "multiplier", "flux")})
    with figure_in(svg_path, 7.5) as figure:
        _solution(figure, triangles, boundary[boundary["kind"] == "trace"])
        upper, lower = (axes_at(figure, 9.45, bottom, 7.3, 2.425) for bottom in (3.875, 1.15))
        _trace(upper, boundary[boundary["kind"] == "trace"])
        _multiplier(lower, boundary)
        for axes in (upper, lower):
            _sides(axes, boundary, named=axes is upper)
        handles = [
            Line2D([], [], label="computed", **COMPUTED),
            Line2D([], [], label="exact", **ANALYTIC),
            Line2D([], [], label="contact set $\\{u=g\\}$", **CONTACT),
        ]
        place = (9.45 / WIDTH, 6.85 / 7.5, 7.3 / WIDTH, 0.07)
        figure.legend(
            handles=handles, loc="center", bbox_to_anchor=place, ncols=3, columnspacing=1.4, borderpad=0
        )


def _solution(figure: Figure, triangles: pd.DataFrame, trace: pd.DataFrame) -> None:
    """u_h as filled contours, the edges of the mesh, and the contact set on the boundary."""
    corners = triangles.sort_values("triangle", kind="stable")[["x", "y", "u_h"]].to_numpy()
    nodes, number = np.unique(corners, axis=0, return_inverse=True)
    mesh = Triangulation(nodes[:, 0], nodes[:, 1], number.reshape(-1, 3))
    axes = axes_at(figure, 1.25, 1.15, 5.15, 5.15)
    filled = axes.tricontourf(mesh, nodes[:, 2], levels=16, cmap="cividis")
    filled.set_rasterized(True)
    axes.triplot(mesh, color="black", lw=0.2, alpha=0.6)
    axes.plot(trace["x"], trace["y"], color="black", lw=0.7)
    touching = trace[["x", "y"]].where(trace["contact"] == 1)
    axes.plot(touching["x"], touching["y"], clip_on=False, **CONTACT)
    axes.set(aspect="equal", anchor="S", xlabel="$x$")
    h, H = triangles[["h", "H"]].iloc[0]
    axes.set_title(f"$h={as_fraction(h)}$,  $h/H={as_fraction(h / H)}$", pad=9)
    axes.set_ylabel("$y$")
    axes.yaxis.set_label_coords(-0.17, 0.5)
    axes.tick_params(length=5)
    axes.locator_params(nbins=4, steps=[1, 2, 5, 10])
    axes.spines[:].set_visible(False)
    bar = figure.colorbar(filled, cax=axes_at(figure, 6.6, 1.15, 0.25, 5.15))
    bar.ax.set_title("$u_h$", fontsize=9.5, pad=5)
    bar.locator = MaxNLocator(7)
    plain_bar(bar)


def _trace(axes: Axes, trace: pd.DataFrame) -> None:
    axes.plot(trace["s"], trace["computed"], **COMPUTED)
    axes.plot(trace["s"], trace["exact"], **ANALYTIC)
    axes.set_ylabel("$u_h-g$,  $u-g$")
    touching = trace["s"].where(trace["contact"] == 1)
    axes.plot(
        touching,
        np.zeros(len(trace)),
        transform=axes.get_xaxis_transform(),
        clip_on=False,
        zorder=3,
        **CONTACT,
    )
    axes.tick_params(bottom=False, labelbottom=False)


def _multiplier(axes: Axes, boundary: pd.DataFrame) -> None:
    """Cells as steps and the exact flux as a line, both broken at the vertices."""
    for _, side in boundary.groupby("side"):
        cells, flux = (side[side["kind"] == kind] for kind in ("multiplier", "flux"))
        axes.stairs(cells["computed"], [*cells["s"], cells["end"].iloc[-1]], baseline=None, **COMPUTED)
        axes.plot(flux["s"], flux["exact"], **ANALYTIC)
    axes.set(ylabel=r"$\lambda_H$,  $\lambda$", xlabel=r"arc length $s$ along $\partial\Omega$")


def _sides(axes: Axes, boundary: pd.DataFrame, named: bool) -> None:
    """Thin lines at the vertices, and the numbers of the sides between them."""
    trace = boundary[boundary["kind"] == "trace"]
    axes.yaxis.set_label_coords(-0.145, 0.5)
    axes.set_xlim(trace["s"].min(), trace["s"].max())
    for side, points in trace.groupby("side")["s"]:
        axes.axvline(points.min(), color="0.55", lw=0.5, zorder=0)
        if named:
            middle = (points.min() + points.max()) / 2
            axes.text(
                middle,
                1.03,
                f"side {side:.0f}",
                transform=axes.get_xaxis_transform(),
                fontsize=SMALL,
                ha="center",
            )
