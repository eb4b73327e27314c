"""A solution as a page of HTML: a surface to turn and zoom, by plotly, in one file that needs no network."""

from __future__ import annotations

import math
from html import escape
from importlib import resources
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np

from unilateral import __version__
from unilateral.arrays import Array
from unilateral.formulas.decimals import guaranteed, interval
from unilateral.solution.bounds import wants_sharp
from unilateral.solution.shown import Shown, force, numbered, shown

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

    from unilateral.solution.solution import Solution

CONTACT = "#d62728"
OBSTACLE = "#222222"
GAP = "#1f77b4"
FREE = "#888888"
CLAMPED = "#000000"
MOST_FORCES = 12
"""The forces of at most this many sides are listed."""
HEIGHT = 0.6
FLATTEST = 0.1
FAR = 1.3
"""The height of the surface over the longer side of the domain, and the least ratio of the domain's sides.

The eye is FAR times the diagonal of what is seen away.
"""
BELOW = 1.0
ROOM = 0.05
"""The obstacle is shown down to BELOW times the height of the surface below that; there is some ROOM."""
STROKES = 60
SHORT = 0.04
"""About STROKES strokes would go around the boundary, SHORT times the domain's shorter side long and deep."""
LEGEND = {"orientation": "h", "x": 0, "y": 1, "yanchor": "bottom"}
TITLE = {"text": "u<sub>h</sub>", "side": "top"}
BAR = {"title": TITLE, "orientation": "h", "thickness": 12, "len": 0.6, "y": 0, "yanchor": "top"}
VALUES = "{} = %{{z:.4g}}<br>x = %{{x:.4g}}<br>y = %{{y:.4g}}<extra></extra>"
GREY = {"fillcolor": "#eeeeee", "line_width": 0, "layer": "below"}


def page(solution: Solution) -> str:
    """The page, with the same bytes for the same solution."""
    from plotly.offline import get_plotlyjs

    of = shown(solution)
    template = resources.files("unilateral.solution") / "interactive.template.html"
    sentences = [of.accuracy, force(solution, of), of.where, _coarser(of)]
    return Template(template.read_text(encoding="utf-8")).substitute(
        title=escape(of.title),
        sentences="\n".join(f"<p>{escape(text[0].upper() + text[1:])}.</p>" for text in sentences if text),
        forces=forces(solution, of),
        described=escape(described(of)),
        no_gap=f"There is no gap: {escape(of.no_gap)}." if of.no_gap else "",
        plotly=get_plotlyjs(),
        surface=surface(of).to_json(),
        boundary=along(of).to_json(),
        version=__version__,
    )


def forces(solution: Solution, of: Shown) -> str:
    """A table of the forces on sides with contact, and of the reactions on clamped ones, with their bounds.

    At most MOST_FORCES sides are in it. It is left out where bounds take more memory than is free.
    """
    if not of.accuracy:
        return ""
    found = solution.forces(wants_sharp(solution))
    with_contact = np.unique(of.contact.partition.side[~of.free])[:MOST_FORCES].tolist()
    rows = {f"force, side {side}": found.sides[side] for side in with_contact}
    for row, reaction in found.reactions.items():
        rows[f"reaction, side{'s' * (len(row) > 1)} {' and '.join(map(str, row))}"] = reaction
    if found.total and len(rows) > 1:
        rows["sum of forces, reactions"] = found.total
    lines = []
    for name, (value, lower, upper) in rows.items():
        text = guaranteed(interval(lower, upper, value), lower, upper)
        lines.append(f"<tr><th>{name}</th><td>{text}</td></tr>")
    return f"<table>{''.join(lines)}</table>"


def _coarser(of: Shown) -> str:
    """Says that the surface is coarser than the mesh, if it is."""
    drawn = len(of.surface[1])
    all_of_them = len(of.mesh.triangles)
    if drawn == all_of_them:
        return ""
    return f"the surface is drawn coarser than the mesh: with {drawn} triangles in place of {all_of_them}"


def described(of: Shown) -> str:
    """What the surface shows, for those who do not see it."""
    least = float(of.u.min())
    largest = float(of.u.max())
    return (
        f"The solution u_h as a surface over the domain, between {least:.4g} and {largest:.4g}; "
        f"{of.where}; on a mesh of {len(of.mesh.triangles)} triangles."
    )


def surface(of: Shown) -> Figure:
    """u_h over the domain, with the contact set and the obstacle as lines."""
    import plotly.graph_objects as go

    nodes, triangles = of.surface
    (x, y) = of.mesh.points[nodes].T
    u = of.u[nodes]
    (i, j, k) = triangles.T.astype(np.int32)
    look: Any = {"cmin": of.limits[0], "cmax": of.limits[1], "colorscale": "Viridis", "colorbar": BAR}
    look |= {"lighting": {"ambient": 0.8, "specular": 0.1}, "hovertemplate": VALUES.format("u<sub>h</sub>")}
    mesh = go.Mesh3d(x=x, y=y, z=u, i=i, j=j, k=k, intensity=u, **look)
    contact = _line(_contact(of), CONTACT, 9, "contact")
    obstacle = _line(_obstacle(of), OBSTACLE, 4, "obstacle g, mean over each cell without contact")
    clamped = [_line(_clamped(of), CLAMPED, 5, "clamped")] if of.clamped else []
    margin = {"l": 0, "r": 0, "t": 0, "b": 50}
    layout = {"template": "none", "margin": margin, "legend": LEGEND, "scene": _scene(of)}
    return go.Figure([mesh, contact, obstacle, *clamped, _sides(of)], layout)


def _scene(of: Shown) -> dict[str, Any]:
    """The axes: x and y to scale unless the domain is long, u_h so that it is seen."""
    sizes = np.ptp(of.mesh.points, axis=0)
    (least, largest) = of.limits
    across = np.maximum(sizes / sizes.max(), FLATTEST)
    height = largest - least
    lowest = float(np.nanmin(of.obstacle, initial=least))
    bottom = max(lowest, least - BELOW * height) - ROOM * height
    top = largest + ROOM * height
    far = FAR * math.hypot(*across, HEIGHT)
    return {
        "xaxis": {"title": "x"},
        "yaxis": {"title": "y"},
        "zaxis": {"title": "u_h", "range": [bottom, top]},
        "aspectmode": "manual",
        "aspectratio": {"x": across[0], "y": across[1], "z": HEIGHT},
        "camera": {"eye": {"x": -0.45 * far, "y": -0.75 * far, "z": 0.5 * far}},
    }


def _line(points: Array, colour: str, width: float, name: str) -> Any:
    """A line through points (k, 3), broken at NaN."""
    import plotly.graph_objects as go

    (x, y, z) = points.T
    look = {"color": colour, "width": width}
    return go.Scatter3d(x=x, y=y, z=z, mode="lines", line=look, name=name, hovertemplate=VALUES.format(name))


def _sides(of: Shown) -> Any:
    """The numbers of the sides, a little outside at the height of u_h."""
    import plotly.graph_objects as go

    polygon = of.mesh.polygon
    sides = numbered(of)
    middles = np.concatenate([_on_side(of, i, polygon.starts[[i]] + polygon.lengths[i] / 2) for i in sides])
    away = SHORT * np.ptp(of.mesh.points, axis=0).min() * polygon.normals[sides]
    (x, y) = (middles[:, :2] + away).T
    z = middles[:, 2]
    look: Any = {"mode": "text", "text": [str(i) for i in sides], "hoverinfo": "skip", "showlegend": False}
    return go.Scatter3d(x=x, y=y, z=z, name="numbers of sides", **look)


def _contact(of: Shown) -> Array:
    """(k, 3) the intervals of contact with u_h, NaN between them."""
    parts = [np.empty((0, 3))]
    for each in of.contact.intervals:
        start, end = of.mesh.polygon.starts[each.side] + np.array([each.start, each.end])
        inner = of.mesh.s[(of.mesh.s > start) & (of.mesh.s < end)]
        parts += [_on_side(of, each.side, np.concatenate([[start], inner, [end]])), np.full((1, 3), np.nan)]
    return np.concatenate(parts)


def _on_side(of: Shown, side: int, s: Array) -> Array:
    """(k, 3) points at arc lengths s (k,) of a side, with u_h."""
    polygon = of.mesh.polygon
    trace = np.append(of.u[of.mesh.boundary], of.u[of.mesh.boundary[0]])
    places = polygon.at(np.full(len(s), side), s - polygon.starts[side])
    return np.column_stack([places, np.interp(s, of.mesh.s, trace)])


def _clamped(of: Shown) -> Array:
    """(k, 3) clamped sides at the height of u_h, with oblique strokes outside, and NaN between them."""
    polygon = of.mesh.polygon
    parts = []
    long = SHORT * np.ptp(of.mesh.points, axis=0).min()
    for side in of.clamped:
        n = int(STROKES * polygon.lengths[side] / polygon.perimeter)
        (start, end) = polygon.starts[side:][:2]
        feet = _on_side(of, side, np.linspace(start, end, n + 2))
        along = (feet[-1] - feet[0])[:2] / polygon.lengths[side]
        tips = feet + np.append(long * (polygon.normals[side] - along), 0.0)
        parts += [np.stack([feet, tips, feet], axis=1).reshape(-1, 3), np.full((1, 3), np.nan)]
    return np.concatenate(parts)


def _obstacle(of: Shown) -> Array:
    """(2 m, 3) both ends of each cell with the mean of g, NaN in contact, where the line would be hidden."""
    ends = np.stack(of.contact.partition.ends, axis=1).reshape(-1, 2)
    return np.column_stack([ends, np.repeat(np.where(of.contact.lambda_H > 0, np.nan, of.obstacle), 2)])


def along(of: Shown) -> Figure:
    """lambda_H and the gap over the arc length."""
    import plotly.graph_objects as go
    from plotly.subplots import make_subplots

    cells = of.contact.partition
    polygon = of.mesh.polygon
    s = np.repeat(cells.points, 2)[1:-1]
    sides = np.repeat(cells.side, 2)
    figure = make_subplots(rows=2, shared_xaxes=True, vertical_spacing=0.06)
    lines = [
        (of.contact.lambda_H, 1, "λ<sub>H</sub>", {"color": CONTACT}, "tozeroy"),
        (of.gap, 2, "mean of u<sub>h</sub> − g", {"color": GAP}, None),
    ]
    if of.flux.any():
        given = np.where(of.free, of.flux, np.nan)
        lines.append((given, 1, "given flux q", {"color": FREE, "dash": "dash"}, None))
    for values, row, name, look, fill in lines:
        value = f"side %{{customdata}}, s = %{{x:.4g}}<br>{name} = %{{y:.4g}}<extra></extra>"
        of_line: Any = {"line": look | {"width": 1.5}, "fill": fill, "name": name, "hovertemplate": value}
        line = go.Scatter(x=s, y=np.repeat(values, 2), customdata=sides, mode="lines", **of_line)
        figure.add_trace(line, row=row, col=1)
    for start in polygon.starts:
        figure.add_vline(start, line={"color": "#cccccc", "width": 1}, layer="below")
    for side in np.unique(cells.side[of.free]):
        named = {"annotation_text": "clamped", "annotation_textangle": -90} if side in of.clamped else {}
        figure.add_vrect(*polygon.starts[[side, side + 1]], **GREY, **named)
    for side in numbered(of):
        middle = polygon.starts[side] + polygon.lengths[side] / 2
        text = str(side) if side else "side 0"
        figure.add_annotation(x=middle, y=1, yref="y domain", yanchor="top", text=text, showarrow=False)
    figure.update_xaxes(range=[0, polygon.perimeter], zeroline=False)
    figure.update_xaxes(title="arc length from vertex 0, anticlockwise", row=2, col=1)
    figure.update_yaxes(automargin=True, rangemode="tozero")
    figure.update_layout(template="none", margin={"l": 50, "r": 10, "t": 10, "b": 45}, legend=LEGEND)
    return figure
