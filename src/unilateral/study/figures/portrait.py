"""One solution: u_h on its mesh with the contact set, and the boundary values beside the exact ones."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from unilateral.discrete import discretise, solve
from unilateral.discrete_solution import Solution
from unilateral.formulas.formula import real
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import uniform
from unilateral.geometry.polygon import named
from unilateral.geometry.structured import structured
from unilateral.problems.case import Case, load
from unilateral.problems.certificate import certify
from unilateral.study.figures import style

Array = NDArray[np.float64]
COLUMNS = ["kind", "h", "H", "side", "s", "end", "x", "y", "computed", "exact", "contact"]
SAMPLES_PER_SIDE = 200
COMPUTED: style.Look = {"color": style.COLOURS[0], "lw": 1.6}
ANALYTIC: style.Look = {"color": "black", "lw": 1.0, "ls": (0, (4, 2))}
CONTACT: style.Look = {
    "color": style.COLOURS[1],
    "lw": 3.5,
    "solid_capstyle": "butt",
    "path_effects": [withStroke(linewidth=5.5, foreground="white")],
}


def table(polygon: str, case: str, h: str, H: str, side: int = 0) -> pd.DataFrame:
    """u_h on the triangles, and along the boundary u_h - g, lambda_H and what they approximate, by `kind`.

    `mesh`: u_h at the corners of the triangles, three rows each; `trace`: u_h - g and u - g at points of
    every side, its ends included; `flux`: lambda there; `multiplier`: lambda_H on the cells.
    """
    domain = named(polygon)
    of, mesh, cells = (
        load(case, domain, side),
        structured(domain, real(h, "h")),
        uniform(domain, real(H, "H")),
    )
    solution = solve(discretise(of, mesh, cells))
    x, y = mesh.points[mesh.triangles.ravel()].T
    on_mesh = {"kind": "mesh", "h": mesh.h, "H": cells.H, "x": x, "y": y}
    multiplier = {"kind": "multiplier", "s": cells.points[:-1], "end": cells.points[1:], "side": cells.side}
    parts = [
        pd.DataFrame({**on_mesh, "computed": solution.u_h[mesh.triangles.ravel()]}),
        *_along_boundary(of, mesh, solution),
        pd.DataFrame({**multiplier, "computed": solution.lambda_H}),
    ]
    return pd.concat(parts)[COLUMNS]


def _along_boundary(case: Case, mesh: Mesh, solution: Solution) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The rows `trace` and `flux`."""
    polygon, boundary = case.polygon, np.append(mesh.boundary, mesh.boundary[0])
    side = np.repeat(np.arange(polygon.n_sides), SAMPLES_PER_SIDE + 1)
    s = np.tile(np.linspace(0, 1, SAMPLES_PER_SIDE + 1), polygon.n_sides) * polygon.lengths[side]
    position = polygon.starts[side] + s
    u, flux, gap = case.boundary(side, s)
    u_h = np.interp(position, mesh.s, solution.u_h[boundary])
    x, y = polygon.at(side, s).T
    along = {"s": position, "side": side, "contact": _in_contact(case, side, s), "x": x, "y": y}
    trace = pd.DataFrame({"kind": "trace", **along, "computed": u_h - (u - gap), "exact": gap})
    return trace, pd.DataFrame({"kind": "flux", **along, "exact": flux})


def _in_contact(case: Case, side: NDArray[np.intp], s: Array) -> NDArray[np.intp]:
    t = s / case.polygon.lengths[side]
    held = [(side == i) & (t >= a) & (t <= b) for i, a, b in certify(case).contact]
    return np.any(held, axis=0).astype(int) if held else np.zeros(len(s), dtype=int)


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """u_h on its mesh with the contact set; along the boundary, u_h - g and lambda_H against the exact ones.

    Columns: kind (mesh, trace, flux, multiplier), h and H (of the mesh), side, s, of cells end, x, y,
    computed, exact, contact (0, 1). Rows `mesh` are the triangles' corners, one triangle after the other;
    `trace` are in the order of s, a vertex once for either side.
    """
    data = style.read(csv_path)
    mesh, trace = (data[data["kind"] == kind] for kind in ("mesh", "trace"))
    with style.figure_in(svg_path, 7.5) as figure:
        _solution(figure, mesh, trace)
        upper, lower = (style.axes_at(figure, 9.45, bottom, 7.3, 2.425) for bottom in (3.875, 1.15))
        _trace(upper, trace)
        _multiplier(lower, data[data["kind"].isin(["multiplier", "flux"])])
        ends = trace.groupby("side")["s"].agg(start="min", end="max")
        for axes, names in ((upper, [f"side {side:.0f}" for side in ends.index]), (lower, [])):
            axes.yaxis.set_label_coords(-0.145, 0.5)
            axes.set_xlim(trace["s"].min(), trace["s"].max())
            style.sides(axes, ends, names, 1.03, color="0.55", lw=0.5, zorder=0)
        handles = [
            style.key("computed", **COMPUTED),
            style.key("exact", **ANALYTIC),
            style.key("contact set $\\{u=g\\}$", **CONTACT),
        ]
        space = {"columnspacing": 1.4, "borderpad": 0}
        place = (9.45 / style.WIDTH, 6.85 / 7.5, 7.3 / style.WIDTH, 0.07)
        figure.legend(handles=handles, loc="center", bbox_to_anchor=place, ncols=3, **space)


def _solution(figure: Figure, mesh: pd.DataFrame, trace: pd.DataFrame) -> None:
    """u_h as filled contours, the edges of the mesh, and the contact set on the boundary."""
    corners = mesh[["x", "y", "computed"]].to_numpy()
    nodes, number = np.unique(corners, axis=0, return_inverse=True)
    triangles = Triangulation(nodes[:, 0], nodes[:, 1], number.reshape(-1, 3))
    axes = style.axes_at(figure, 1.25, 1.15, 5.15, 5.15)
    filled = axes.tricontourf(triangles, nodes[:, 2], levels=16, cmap="cividis")
    filled.set_rasterized(True)
    axes.triplot(triangles, color="black", lw=0.2, alpha=0.6)
    axes.plot(trace["x"], trace["y"], color="black", lw=0.7)
    touching = trace[["x", "y"]].where(trace["contact"] == 1)
    axes.plot(touching["x"], touching["y"], clip_on=False, **CONTACT)
    axes.set(aspect="equal", anchor="S", xlabel="$x$")
    h, H = mesh[["h", "H"]].iloc[0]
    axes.set_title(f"$h={style.as_fraction(h)}$,  $h/H={style.as_fraction(h / H)}$", pad=9)
    axes.set_ylabel("$y$")
    axes.yaxis.set_label_coords(-0.17, 0.5)
    axes.tick_params(length=5)
    axes.locator_params(nbins=4, steps=[1, 2, 5, 10])
    axes.spines[:].set_visible(False)
    bar = figure.colorbar(filled, cax=axes.inset_axes((1.04, 0, 0.05, 1)))
    bar.ax.set_title("$u_h$", fontsize=9.5, pad=5)
    bar.locator = MaxNLocator(7)
    style.plain_bar(bar)


def _trace(axes: Axes, trace: pd.DataFrame) -> None:
    axes.plot(trace["s"], trace["computed"], **COMPUTED)
    axes.plot(trace["s"], trace["exact"], **ANALYTIC)
    axes.set_ylabel("$u_h-g$,  $u-g$")
    touching = trace["s"].where(trace["contact"] == 1)
    at_the_foot: style.Look = {"transform": axes.get_xaxis_transform(), "clip_on": False, "zorder": 3}
    axes.plot(touching, np.zeros(len(trace)), **at_the_foot, **CONTACT)
    axes.tick_params(bottom=False, labelbottom=False)


def _multiplier(axes: Axes, boundary: pd.DataFrame) -> None:
    """Cells as steps and the exact flux as a line, both broken at the vertices."""
    for _, side in boundary.groupby("side"):
        cells, flux = (side[side["kind"] == kind] for kind in ("multiplier", "flux"))
        axes.stairs(cells["computed"], [*cells["s"], cells["end"].iloc[-1]], baseline=None, **COMPUTED)
        axes.plot(flux["s"], flux["exact"], **ANALYTIC)
    axes.set(ylabel=r"$\lambda_H$,  $\lambda$", xlabel=r"arc length $s$ along $\partial\Omega$")
