"""A solution as a page of HTML: a surface to turn and zoom, by plotly, in one file that needs no network."""

from __future__ import annotations

import math
from html import escape
from importlib import resources
from itertools import zip_longest
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np

from unilateral import __version__
from unilateral.arrays import Array
from unilateral.formulas.decimals import add_guarantee, format_interval
from unilateral.solution.contact import describe_certain_arcs
from unilateral.solution.plot_data import PlotData, collect_plot_data, describe_force, select_numbered_sides

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

    from unilateral.bounds.forces import Force
    from unilateral.geometry.polygon import Polygon
    from unilateral.solution.forces import Forces
    from unilateral.solution.solution import Solution

PAGE_CONTACT_COLOUR = "#d62728"
PAGE_OBSTACLE_COLOUR = "#222222"
PAGE_GAP_COLOUR = "#1f77b4"
PAGE_FREE_COLOUR = "#888888"
PAGE_CLAMPED_COLOUR = "#000000"
MAX_LISTED_FORCES = 12
"""The forces of at most this many sides are listed."""
SURFACE_HEIGHT_RATIO = 0.6
MIN_SIDES_RATIO = 0.1
EYE_DISTANCE_RATIO = 1.3
"""Height of the surface over the longer side of the domain, least ratio of the sides that are drawn, and
distance of the eye over the diagonal of the scene."""
OBSTACLE_DEPTH_RATIO = 1.0
VERTICAL_MARGIN_RATIO = 0.05
"""The obstacle is drawn down to this many heights of the surface below it; margin over that height."""
STROKES_PER_PERIMETER = 60
STROKE_LENGTH_RATIO = 0.04
"""Strokes that would go around the boundary, and their length over the shorter side of the domain."""
PAGE_LEGEND_LAYOUT = {"orientation": "h", "x": 0, "y": 1, "yanchor": "bottom"}
COLOUR_BAR_TITLE = {"text": "u<sub>h</sub>", "side": "top"}
PAGE_COLOUR_BAR = {
    "title": COLOUR_BAR_TITLE,
    "orientation": "h",
    "thickness": 12,
    "len": 0.6,
    "y": 0,
    "yanchor": "top",
}
HOVER_TEMPLATE = "{} = %{{z:.4g}}<br>x = %{{x:.4g}}<br>y = %{{y:.4g}}<extra></extra>"
GREY_BAND_STYLE = {"fillcolor": "#eeeeee", "line_width": 0, "layer": "below"}


def render_solution_page(solution: Solution) -> str:
    """The page, with the same bytes for the same solution."""
    from plotly.offline import get_plotlyjs

    plot_data = collect_plot_data(solution)
    template = resources.files("unilateral.solution") / "interactive.template.html"
    sentences = [describe_force(solution, plot_data), plot_data.contact_text, plot_data.accuracy_text]
    sentences.append(_explain_coarse_surface(plot_data))
    return Template(template.read_text(encoding="utf-8")).substitute(
        title=escape(plot_data.title),
        sentences="\n".join(f"<p>{escape(text[0].upper() + text[1:])}.</p>" for text in sentences if text),
        forces=render_forces_table(solution, plot_data),
        described=escape(describe_surface(plot_data)),
        no_gap=f"There is no gap: {escape(plot_data.no_gap_text)}." if plot_data.no_gap_text else "",
        plotly=get_plotlyjs(),
        surface=draw_surface(plot_data).to_json(),
        boundary=draw_boundary_graphs(plot_data).to_json(),
        version=__version__,
    )


def render_forces_table(solution: Solution, plot_data: PlotData) -> str:
    """A table of the forces and the contact on sides with contact, and of the reactions on clamped ones.

    At most MAX_LISTED_FORCES sides are in it. It is left out where bounds take more memory than is free.
    """
    if not plot_data.accuracy_text:
        return ""
    contact = plot_data.contact
    contact_sides = np.unique(contact.partition.side[~plot_data.no_contact]).tolist()
    listed_sides = contact_sides[:MAX_LISTED_FORCES]
    forces = _name_forces(solution.forces(), solution.polygon, listed_sides)
    # texts by the headings of the columns; below the sides with contact the last columns are empty
    columns = {
        "": [escape(name) for name in forces],
        "force": [
            add_guarantee(format_interval(lower, upper, value), lower, upper)
            for value, lower, upper in forces.values()
        ],
        "contact, guaranteed": [
            describe_certain_arcs([arc for arc in contact.certain if arc.side == side])
            for side in listed_sides
        ],
        "length of contact, computed": [
            f"{contact.lengths[side]:.4g} of {solution.polygon.lengths[side]:.4g}" for side in listed_sides
        ],
    }
    return _render_table(columns)


def _name_forces(forces: Forces, polygon: Polygon, listed_sides: list[int]) -> dict[str, Force]:
    """The forces on the listed sides, all reactions, and the sum of several of them, by their names."""
    rows = {f"force, side {polygon.label_side(side)}": forces.sides[side] for side in listed_sides}
    for row, reaction in forces.reactions.items():
        rows[f"reaction, side{'s' * (len(row) > 1)} {' and '.join(map(polygon.label_side, row))}"] = reaction
    if forces.total and len(rows) > 1:
        rows["sum of forces, reactions"] = forces.total
    return rows


def _render_table(columns: dict[str, list[str]]) -> str:
    """A table in HTML of columns by their headings; a shorter column is empty at its end."""
    head = "".join(f'<th scope="col">{heading}</th>' for heading in columns)
    lines = [f"<tr>{head}</tr>"]
    for name, *texts in zip_longest(*columns.values(), fillvalue=""):
        lines.append(f"<tr><th>{name}</th>{''.join(f'<td>{text}</td>' for text in texts)}</tr>")
    return f"<table>{''.join(lines)}</table>"


def _explain_coarse_surface(plot_data: PlotData) -> str:
    """Sentence that the surface is coarser than the mesh, empty if it is not."""
    drawn = len(plot_data.surface[1])
    total = len(plot_data.mesh.triangles)
    if drawn == total:
        return ""
    return f"the surface is drawn coarser than the mesh: with {drawn} triangles in place of {total}"


def describe_surface(plot_data: PlotData) -> str:
    """Description of the surface in words, for those who do not see it."""
    lowest = float(plot_data.u.min())
    highest = float(plot_data.u.max())
    return (
        f"The solution u_h as a surface over the domain, between {lowest:.4g} and {highest:.4g}; "
        f"{plot_data.contact_text}; on a mesh of {len(plot_data.mesh.triangles)} triangles."
    )


def draw_surface(plot_data: PlotData) -> Figure:
    """u_h over the domain, with the contact set and the obstacle as lines."""
    import plotly.graph_objects as go

    nodes, triangles = plot_data.surface
    (x, y) = plot_data.mesh.points[nodes].T
    u = plot_data.u[nodes]
    (i, j, k) = triangles.T.astype(np.int32)
    u_min, u_max = plot_data.colour_limits
    look: Any = {"cmin": u_min, "cmax": u_max, "colorscale": "Viridis", "colorbar": PAGE_COLOUR_BAR}
    look["lighting"] = {"ambient": 0.8, "specular": 0.1}
    look["hovertemplate"] = HOVER_TEMPLATE.format("u<sub>h</sub>")
    drawn = [go.Mesh3d(x=x, y=y, z=u, i=i, j=j, k=k, intensity=u, **look)]
    drawn.append(_draw_space_line(_contact_curve(plot_data), PAGE_CONTACT_COLOUR, 9, "contact"))
    name = "obstacle g, mean over each cell without contact"
    drawn.append(_draw_space_line(_obstacle_steps(plot_data), PAGE_OBSTACLE_COLOUR, 4, name))
    if plot_data.clamped_sides:
        drawn.append(_draw_space_line(_clamped_strokes(plot_data), PAGE_CLAMPED_COLOUR, 5, "clamped"))
    drawn.append(_draw_side_numbers(plot_data))
    layout = {"template": "none", "margin": {"l": 0, "r": 0, "t": 0, "b": 50}, "legend": PAGE_LEGEND_LAYOUT}
    return go.Figure(drawn, layout | {"scene": _lay_out_scene(plot_data)})


def _lay_out_scene(plot_data: PlotData) -> dict[str, Any]:
    """Layout of the axes: x and y to scale unless the domain is long, u_h so that it is seen."""
    sizes = np.ptp(plot_data.mesh.points, axis=0)
    (u_min, u_max) = plot_data.colour_limits
    aspect = np.maximum(sizes / sizes.max(), MIN_SIDES_RATIO)
    height = u_max - u_min
    lowest = float(np.nanmin(plot_data.obstacle, initial=u_min))
    bottom = max(lowest, u_min - OBSTACLE_DEPTH_RATIO * height) - VERTICAL_MARGIN_RATIO * height
    top = u_max + VERTICAL_MARGIN_RATIO * height
    eye = EYE_DISTANCE_RATIO * math.hypot(*aspect, SURFACE_HEIGHT_RATIO)
    return {
        "xaxis": {"title": "x"},
        "yaxis": {"title": "y"},
        "zaxis": {"title": "u_h", "range": [bottom, top]},
        "aspectmode": "manual",
        "aspectratio": {"x": aspect[0], "y": aspect[1], "z": SURFACE_HEIGHT_RATIO},
        "camera": {"eye": {"x": -0.45 * eye, "y": -0.75 * eye, "z": 0.5 * eye}},
    }


def _draw_space_line(points: Array, colour: str, width: float, name: str) -> Any:
    """A line through points (k, 3), broken at NaN."""
    import plotly.graph_objects as go

    (x, y, z) = points.T
    look = {"color": colour, "width": width}
    return go.Scatter3d(
        x=x, y=y, z=z, mode="lines", line=look, name=name, hovertemplate=HOVER_TEMPLATE.format(name)
    )


def _draw_side_numbers(plot_data: PlotData) -> Any:
    """The numbers of the sides, a little outside at the height of u_h."""
    import plotly.graph_objects as go

    polygon = plot_data.mesh.polygon
    sides = select_numbered_sides(plot_data.mesh.polygon)
    middles = np.concatenate(
        [_boundary_curve(plot_data, i, polygon.starts[[i]] + polygon.lengths[i] / 2) for i in sides]
    )
    offset = STROKE_LENGTH_RATIO * np.ptp(plot_data.mesh.points, axis=0).min() * polygon.normals[sides]
    (x, y) = (middles[:, :2] + offset).T
    z = middles[:, 2]
    look: Any = {"mode": "text", "text": [str(i) for i in sides], "hoverinfo": "skip", "showlegend": False}
    return go.Scatter3d(x=x, y=y, z=z, name="numbers of sides", **look)


def _contact_curve(plot_data: PlotData) -> Array:
    """Points (k, 3) of the contact intervals at the height of u_h, with NaN between intervals."""
    curves = [np.empty((0, 3))]
    for interval in plot_data.contact.intervals:
        start, end = plot_data.mesh.polygon.starts[interval.side] + np.array([interval.start, interval.end])
        # u_h bends at the nodes between
        inner = plot_data.mesh.s[(plot_data.mesh.s > start) & (plot_data.mesh.s < end)]
        curve = _boundary_curve(plot_data, interval.side, np.concatenate([[start], inner, [end]]))
        curves += [curve, np.full((1, 3), np.nan)]
    return np.concatenate(curves)


def _boundary_curve(plot_data: PlotData, side: int, s: Array) -> Array:
    """Points (k, 3) at arc lengths s (k,) on a side, at the height of u_h."""
    polygon = plot_data.mesh.polygon
    trace = np.append(plot_data.u[plot_data.mesh.boundary], plot_data.u[plot_data.mesh.boundary[0]])
    places = polygon.at(np.full(len(s), side), s - polygon.starts[side])
    return np.column_stack([places, np.interp(s, plot_data.mesh.s, trace)])


def _clamped_strokes(plot_data: PlotData) -> Array:
    """Points (k, 3) of clamped sides at the height of u_h, with strokes outside and NaN between sides."""
    polygon = plot_data.mesh.polygon
    curves = []
    stroke = STROKE_LENGTH_RATIO * np.ptp(plot_data.mesh.points, axis=0).min()
    for side in plot_data.clamped_sides:
        n = int(STROKES_PER_PERIMETER * polygon.lengths[side] / polygon.perimeter)
        (start, end) = polygon.starts[side:][:2]
        feet = _boundary_curve(plot_data, side, np.linspace(start, end, n + 2))
        tangent = (feet[-1] - feet[0])[:2] / polygon.lengths[side]
        tips = feet + np.append(stroke * (polygon.normals[side] - tangent), 0.0)
        # from each foot to its tip and back, so that one line draws all
        curves += [np.stack([feet, tips, feet], axis=1).reshape(-1, 3), np.full((1, 3), np.nan)]
    return np.concatenate(curves)


def _obstacle_steps(plot_data: PlotData) -> Array:
    """Both ends (2 m, 3) of each cell at the height of the mean of g, NaN in contact, where u_h hides it."""
    ends = np.stack(plot_data.contact.partition.ends, axis=1).reshape(-1, 2)
    heights = np.where(plot_data.contact.lambda_H > 0, np.nan, plot_data.obstacle)
    return np.column_stack([ends, np.repeat(heights, 2)])


def draw_boundary_graphs(plot_data: PlotData) -> Figure:
    """lambda_H and the gap over the arc length."""
    import plotly.graph_objects as go
    from plotly.subplots import make_subplots

    figure = make_subplots(rows=2, shared_xaxes=True, vertical_spacing=0.06)
    lines = [
        (plot_data.contact.lambda_H, 1, "λ<sub>H</sub>", {"color": PAGE_CONTACT_COLOUR}, "tozeroy"),
        (plot_data.gap, 2, "mean of u<sub>h</sub> − g", {"color": PAGE_GAP_COLOUR}, None),
    ]
    if plot_data.given_flux.any():
        given_flux = np.where(plot_data.no_contact, plot_data.given_flux, np.nan)
        lines.append((given_flux, 1, "given flux q", {"color": PAGE_FREE_COLOUR, "dash": "dash"}, None))
    # values on cells are steps, between both ends of each
    partition = plot_data.contact.partition
    s = np.repeat(partition.points, 2)[1:-1]
    sides = np.repeat(partition.side, 2)
    for values, row, name, look, fill in lines:
        hover = f"side %{{customdata}}, s = %{{x:.4g}}<br>{name} = %{{y:.4g}}<extra></extra>"
        line_style: Any = {"line": look | {"width": 1.5}, "fill": fill, "name": name, "hovertemplate": hover}
        line = go.Scatter(x=s, y=np.repeat(values, 2), customdata=sides, mode="lines", **line_style)
        figure.add_trace(line, row=row, col=1)
    _mark_sides(figure, plot_data)
    figure.update_xaxes(range=[0, plot_data.mesh.polygon.perimeter], zeroline=False)
    figure.update_xaxes(title="arc length from vertex 0, anticlockwise", row=2, col=1)
    figure.update_yaxes(automargin=True, rangemode="tozero")
    margin = {"l": 50, "r": 10, "t": 10, "b": 45}
    figure.update_layout(template="none", margin=margin, legend=PAGE_LEGEND_LAYOUT)
    return figure


def _mark_sides(figure: Figure, plot_data: PlotData) -> None:
    """Marks vertices by lines, sides without contact by grey bands, and sides by their numbers."""
    polygon = plot_data.mesh.polygon
    for start in polygon.starts:
        figure.add_vline(start, line={"color": "#cccccc", "width": 1}, layer="below")
    for side in np.unique(plot_data.contact.partition.side[plot_data.no_contact]):
        annotation: Any = {}
        if side in plot_data.clamped_sides:
            annotation = {"annotation_text": "clamped", "annotation_textangle": -90}
        figure.add_vrect(*polygon.starts[[side, side + 1]], **GREY_BAND_STYLE, **annotation)
    for side in select_numbered_sides(plot_data.mesh.polygon):
        middle = polygon.starts[side] + polygon.lengths[side] / 2
        text = str(side) if side else "side 0"
        figure.add_annotation(x=middle, y=1, yref="y domain", yanchor="top", text=text, showarrow=False)
