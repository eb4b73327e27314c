"""One solution: u_h on its mesh with the contact set, and the boundary values beside the exact ones."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from unilateral.discrete import Solution, discretise, solve
from unilateral.formulas.formula import real
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, uniform
from unilateral.geometry.polygon import named
from unilateral.geometry.structured import structured
from unilateral.problems.case import Case, load
from unilateral.problems.certificate import certify
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

Array = NDArray[np.float64]
BOUNDARY_COLUMNS = ("kind", "side", "s", "end", "computed", "exact", "contact", "x", "y")
SAMPLES_PER_SIDE = 200
COMPUTED: dict[str, Any] = {"color": COLOURS[0], "lw": 1.6}
ANALYTIC: dict[str, Any] = {"color": "black", "lw": 1.0, "ls": (0, (4, 2))}
CONTACT: dict[str, Any] = {
    "color": COLOURS[1],
    "lw": 3.5,
    "solid_capstyle": "butt",
    "path_effects": [withStroke(linewidth=5.5, foreground="white")],
}


def table(polygon: str, case: str, h: str, H: str, side: int = 0) -> dict[str, pd.DataFrame]:
    """`mesh`: u_h on the triangles; `boundary`: u_h - g, lambda_H and what they approximate."""
    domain = named(polygon)
    solved, mesh, cells = (
        load(case, domain, side),
        structured(domain, real(h, "h")),
        uniform(domain, real(H, "H")),
    )
    solution = _solve(solved, mesh, cells)
    trace = np.append(solution.u_h[mesh.boundary], solution.u_h[mesh.boundary[0]])
    exact = _along_boundary(solved, lambda s: np.interp(s, mesh.s, trace))
    multiplier = {
        "kind": "multiplier",
        "s": cells.points[:-1],
        "end": cells.points[1:],
        "side": cells.side,
        "computed": solution.lambda_H,
    }
    boundary = pd.concat([*exact, pd.DataFrame(multiplier)])[list(BOUNDARY_COLUMNS)]
    return {"mesh": _on_triangles(mesh, solution.u_h).assign(H=cells.H), "boundary": boundary}


def _solve(case: Case, mesh: Mesh, cells: Partition) -> Solution:
    return solve(discretise(case, mesh, cells))


def _on_triangles(mesh: Mesh, u_h: Array) -> pd.DataFrame:
    """Three rows for each triangle."""
    corners = mesh.triangles.ravel()
    return pd.DataFrame(
        {
            "triangle": np.repeat(np.arange(len(mesh.triangles)), 3),
            "x": mesh.points[corners, 0],
            "y": mesh.points[corners, 1],
            "u_h": u_h[corners],
            "h": mesh.h,
        }
    )


def _along_boundary(case: Case, trace: Callable[[Array], Array]) -> list[pd.DataFrame]:
    """Rows `trace` and `flux` at points of every side, its ends included; `trace` gives u_h there."""
    polygon = case.polygon
    side = np.repeat(np.arange(polygon.n_sides), SAMPLES_PER_SIDE + 1)
    s = np.tile(np.linspace(0, 1, SAMPLES_PER_SIDE + 1), polygon.n_sides) * polygon.lengths[side]
    position = polygon.starts[side] + s
    u, flux, gap = case.boundary(side, s)
    x, y = polygon.at(side, s).T
    along = {"s": position, "side": side, "contact": _in_contact(case, side, s), "x": x, "y": y}
    return [
        pd.DataFrame({"kind": "trace", **along, "computed": trace(position) - (u - gap), "exact": gap}),
        pd.DataFrame({"kind": "flux", **along, "exact": flux}),
    ]


def _in_contact(case: Case, side: NDArray[np.intp], s: Array) -> NDArray[np.intp]:
    t = s / case.polygon.lengths[side]
    held = [(side == i) & (t >= a) & (t <= b) for i, a, b in certify(case).contact]
    return np.any(held, axis=0).astype(int) if held else np.zeros(len(s), dtype=int)


def draw(mesh_csv: FilePath, boundary_csv: FilePath, svg_path: FilePath) -> None:
    """u_h on its mesh with the contact set; along the boundary, u_h - g and lambda_H against the exact ones.

    `mesh_csv`: triangle, x, y, u_h, h, H, three rows per triangle. `boundary_csv`: kind, side, s, end,
    computed, exact, contact, x, y. Rows `trace` are points in the order of s, a vertex once for either
    side: u_h - g, u - g, contact (0, 1), and where the point lies; `multiplier` are cells from s to end:
    lambda_H; `flux` are points: lambda.
    """
    triangles = read(mesh_csv)
    boundary = read(boundary_csv)
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
