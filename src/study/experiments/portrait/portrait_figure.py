"""One solution: u_h as a surface over its mesh, and lambda_H and u_h along the boundary, where g = 0."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.tri import Triangulation

from study import style
from unilateral.arrays import Array
from unilateral.discrete.condensed import discretise, solve_condensed_problem
from unilateral.discrete.solution import DiscreteSolution
from unilateral.formulas.formula import parse_real
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, make_uniform_partition
from unilateral.geometry.polygon import Polygon, find_polygon
from unilateral.geometry.structured import make_structured_mesh
from unilateral.problems.problem_file import build_from_declaration

COLUMNS = ["kind", "of", "h", "H", "side", "s", "end", "x", "y", "value"]
FIGURE_HEIGHT_CM = 6.8
COMPUTED_LOOK: style.Look = {"color": style.COLOURS[0], "lw": 1.4}
REFERENCE_LOOK: style.Look = {"color": "black", "lw": 0.9, "ls": (0, (4, 2))}
CONTACT_LOOK: style.Look = {
    "color": style.COLOURS[1],
    "lw": 3,
    "solid_capstyle": "butt",
    "path_effects": [withStroke(linewidth=4.2, foreground="white")],
}
RIM_LOOK: style.Look = {
    "color": "0.3",
    "lw": 0.7,
    "ls": (0, (2, 2)),
    "path_effects": [withStroke(linewidth=1.6, foreground="white")],
}
VIEW_DEGREES = {"elev": 30, "azim": -35}


def table(polygon: str, f: str, h: str, H: str, reference: str) -> pd.DataFrame:
    """The solution with g = 0, by `kind`; on the boundary also its `reference`, that on a finer mesh.

    `mesh`: u_h at the corners of the triangles, three rows each; `node`: u_h at the boundary nodes, a vertex
    once for either side; `cell`: lambda_H, from s to end, with the middle (x, y). The reference has H = 2h.
    """
    domain = find_polygon(polygon)
    problem = build_from_declaration({"polygon": domain.vertices.tolist(), "f": f, "g": 0}, polygon)
    fine = parse_real(reference, "reference")
    sizes = {"computed": (parse_real(h, "h"), parse_real(H, "H")), "reference": (fine, 2 * fine)}
    frames = []
    for role, (edge, cell) in sizes.items():
        mesh = make_structured_mesh(domain, edge)
        cells = make_uniform_partition(domain, cell)
        solution = solve_condensed_problem(discretise(problem, mesh, cells))
        frames += [rows.assign(of=role) for rows in _tabulate_boundary(domain, mesh, cells, solution)]
        if role == "computed":
            frames.append(_tabulate_surface(mesh, cells, solution).assign(of=role))
    return pd.concat(frames)[COLUMNS]


def _tabulate_surface(mesh: Mesh, cells: Partition, solution: DiscreteSolution) -> pd.DataFrame:
    """The rows of the kind `mesh`."""
    corners = mesh.triangles.ravel()
    x, y = mesh.points[corners].T
    u_h = solution.u_h[corners]
    return pd.DataFrame({"kind": "mesh", "h": mesh.h, "H": cells.H, "x": x, "y": y, "value": u_h})


def _tabulate_boundary(
    polygon: Polygon, mesh: Mesh, cells: Partition, solution: DiscreteSolution
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The rows of the kinds `node` and `cell`."""
    node = np.column_stack([mesh.boundary, np.roll(mesh.boundary, -1)]).ravel()
    position = np.column_stack([mesh.s[:-1], mesh.s[1:]]).ravel()
    x, y = mesh.points[node].T
    columns = {"s": position, "side": np.repeat(mesh.side, 2), "x": x, "y": y, "value": solution.u_h[node]}
    nodes = pd.DataFrame({"kind": "node", **columns}).drop_duplicates(["side", "s"])
    s = cells.points[:-1]
    end = cells.points[1:]
    x, y = polygon.at(cells.side, (s + end) / 2 - polygon.starts[cells.side]).T
    columns = {"s": s, "end": end, "side": cells.side, "x": x, "y": y, "value": solution.lambda_H}
    return nodes, pd.DataFrame({"kind": "cell", **columns})


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """u_h as a surface above its mesh, with the contact set; along the boundary, lambda_H and u_h.

    Columns: kind (mesh, node, cell), of (computed, reference), h and H (of the mesh), side, s, of cells end,
    x, y, value. Rows `mesh` are the triangles' corners, one triangle after the other; the others are in the
    order of s. The contact set is where the reference has a multiplier.
    """
    data = style.read_figure_table(csv_path)
    with style.open_figure(svg_path, FIGURE_HEIGHT_CM) as figure:
        _draw_surface(figure, data)
        upper = style.add_axes(figure, 9.75, 3.45, 7.05, 2.2)
        lower = style.add_axes(figure, 9.75, 1.05, 7.05, 2.2)
        _draw_multiplier(upper, data)
        _draw_trace(lower, data)
        ends = data[data["kind"] == "node"].groupby("side")["s"].agg(start="min", end="max")
        for axes, names in ((upper, [f"side {side:.0f}" for side in ends.index]), (lower, [])):
            axes.yaxis.set_label_coords(-0.11, 0.5)
            axes.set_xlim(0, ends["end"].max())
            style.draw_sides(axes, ends, names, 1.04, color="0.75", lw=0.5, zorder=0)
        handles = [
            style.legend_entry("$u_h$, $\\lambda_H$", **COMPUTED_LOOK),
            style.legend_entry("on a fine mesh", **REFERENCE_LOOK),
            style.legend_entry("contact set", **CONTACT_LOOK),
        ]
        place = (9.75 / style.PAGE_WIDTH_CM, 6.2 / FIGURE_HEIGHT_CM, 7.05 / style.PAGE_WIDTH_CM, 0.07)
        figure.legend(
            handles=handles, loc="center", bbox_to_anchor=place, ncols=3, columnspacing=1, handlelength=1.6
        )


def _draw_surface(figure: Figure, data: pd.DataFrame) -> None:
    """u_h above the mesh, its boundary values, the rim g = 0 and the contact set on it."""
    mesh = data[data["kind"] == "mesh"]
    contact = _contact_middles(data)
    triangles, u_h = _join_corners(mesh)
    place = (0.0, 0.0, 9.1 / style.PAGE_WIDTH_CM, 1.0)
    axes: Any = figure.add_axes(place, projection="3d", computed_zorder=False)
    look: style.Look = {"cmap": "cividis", "edgecolor": "black", "linewidth": 0.15, "clip_on": False}
    surface = axes.plot_trisurf(triangles, u_h, zorder=1, **look)
    rim = _select_nodes(data, "computed")
    axes.plot(rim["x"], rim["y"], 0 * rim["x"], zorder=2, clip_on=False, **RIM_LOOK)
    axes.plot(rim["x"], rim["y"], rim["value"], color="black", lw=0.8, zorder=2, clip_on=False)
    axes.plot(contact["x"], contact["y"], 0 * contact["x"], zorder=3, clip_on=False, **CONTACT_LOOK)
    x, y = rim[["x", "y"]].iloc[0]
    axes.text(x, y, -0.3, "$s=0$", fontsize=style.SMALL_FONT_POINTS, ha="center", va="top")
    axes.set_axis_off()
    axes.view_init(**VIEW_DEGREES)
    axes.set_box_aspect((1, 1, 0.6), zoom=1.37)
    h, H = mesh[["h", "H"]].iloc[0]
    title = f"$u_h$,  $h={style.format_fraction(h)}$,  $H={style.format_fraction(H)}$"
    figure.text(0.02, 0.92, title, fontsize=10.5)
    bar = figure.colorbar(surface, cax=style.add_axes(figure, 0.4, 3.45, 0.22, 2.2))
    style.simplify_colour_bar(bar)


def _join_corners(mesh: pd.DataFrame) -> tuple[Triangulation, Array]:
    """The triangulation, and u_h at its nodes, from a table with the three corners of each triangle."""
    corners = mesh[["x", "y", "value"]].to_numpy()
    nodes, number = np.unique(corners, axis=0, return_inverse=True)
    return Triangulation(nodes[:, 0], nodes[:, 1], number.reshape(-1, 3)), nodes[:, 2]


def _select_nodes(data: pd.DataFrame, solution: str) -> pd.DataFrame:
    return data[(data["kind"] == "node") & (data["of"] == solution)]


def _select_cells(data: pd.DataFrame, solution: str) -> pd.DataFrame:
    return data[(data["kind"] == "cell") & (data["of"] == solution)]


def _contact_middles(data: pd.DataFrame) -> pd.DataFrame:
    """x, y and s of the middles of the reference's cells, NaN where there is no multiplier."""
    cells = _select_cells(data, "reference")
    middle = cells.assign(s=(cells["s"] + cells["end"]) / 2)
    return middle[["x", "y", "s"]].where(cells["value"] > 0)


def _draw_multiplier(axes: Axes, data: pd.DataFrame) -> None:
    """lambda_H as steps, and the reference as a line, both broken at the vertices."""
    for _, side in _select_cells(data, "computed").groupby("side"):
        ends = [*side["s"], side["end"].iloc[-1]]
        axes.stairs(side["value"], ends, fill=True, color=style.COLOURS[0], alpha=0.2)
        axes.stairs(side["value"], ends, baseline=None, **COMPUTED_LOOK)
    for _, side in _select_cells(data, "reference").groupby("side"):
        axes.plot((side["s"] + side["end"]) / 2, side["value"], **REFERENCE_LOOK)
    axes.set_ylabel(r"$\lambda_H$")
    axes.set_ylim(bottom=0)
    axes.tick_params(bottom=False, labelbottom=False)


def _draw_trace(axes: Axes, data: pd.DataFrame) -> None:
    """u_h with its nodes, the reference, and the contact set at the foot."""
    computed = _select_nodes(data, "computed")
    reference = _select_nodes(data, "reference")
    axes.plot(computed["s"], computed["value"], marker=".", markersize=3.5, **COMPUTED_LOOK)
    axes.plot(reference["s"], reference["value"], **REFERENCE_LOOK)
    contact = _contact_middles(data)
    foot_look: style.Look = {"transform": axes.get_xaxis_transform(), "clip_on": False, "zorder": 3}
    axes.plot(contact["s"], 0 * contact["s"], **foot_look, **CONTACT_LOOK)
    axes.set(ylabel="$u_h-g$", xlabel=r"arc length $s$ along $\partial\Omega$")
