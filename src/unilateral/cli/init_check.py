"""The commands `unilateral init` and `unilateral check`: problems of one's own, before anything is solved."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.formulas.decimals import format_down, format_up
from unilateral.formulas.exact_numbers import as_float
from unilateral.formulas.expression import ONE, ZERO, Expression
from unilateral.formulas.formula import compile_numpy
from unilateral.problems import problem_file
from unilateral.problems.fields import describe_data, join_sides
from unilateral.problems.problem import Problem, as_formula
from unilateral.problems.side_tables import SideTable
from unilateral.solution.summary import LINEAR_PROBLEM_NOTE
from unilateral.system.files import check_target, replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURE_ENDINGS = {".svg": ["matplotlib"], ".png": ["matplotlib"], ".pdf": ["matplotlib"]}
"""The endings of pictures, and what draws these."""
CHECK_FREE_COLOUR = "tab:gray"
CHECK_CONTACT_COLOUR = "tab:blue"
CHECK_CLAMPED_COLOUR = "tab:brown"
CHECK_CONSTANT_COLOUR = "0.92"
RELATIVE_VALUE_ROUNDING = 1e-12
POLYGON_PANEL_INCHES = 5.0
OBSTACLE_PANEL_INCHES = 2.0
"""Inches: the width of the panel with the polygon, and the height of that along its boundary."""
POINTS_PER_SIDE = 201
"""g is drawn at this many points of a side, and f at this many along x and along y."""


def write_template(name: str) -> None:
    """Writes a commented problem. Raises InputError for a file that is there, or does not end in .yaml."""
    if not name.endswith((".yaml", ".yml")):
        raise InputError(f"{name}: the name of a problem file has to end in .yaml or .yml")
    if Path(name).exists():
        raise InputError(f"{name} exists already; name another file")
    template = resources.files("unilateral.problems") / "template.yaml"
    text = template.read_text(encoding="utf-8").replace("FILE", name)
    with replacing(name) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def describe_problem_file(name: str, picture: str | None) -> str:
    """How a problem file is read, as text, and as a picture, too, where one is named.

    Raises InputError for a file that declares no problem, and for a picture that cannot be written.
    """
    if picture is not None:
        check_target(picture, PICTURE_ENDINGS)
    problem = problem_file.load_if_problem(name)
    if problem is None:
        raise InputError(f"{name} declares a case, not a problem; to see it type: unilateral cases {name}")
    if picture is not None:
        from unilateral.solution.plot import write_figure  # and with it the method

        with replacing(picture) as temporary:
            write_figure(draw_problem(problem), temporary)
    return "\n".join(describe_problem(problem))


def describe_problem(problem: Problem) -> Iterator[str]:
    """Lines that tell what is solved, and what holds on each side of the polygon."""
    polygon = problem.polygon
    if problem.c != ZERO:
        yield f"{problem.name}: -k lap u + c u = f with k = {problem.k} and c = {problem.c}"
    else:
        yield f"{problem.name}: -k lap u = f with k = {problem.k}"
    yield f"  polygon     {polygon.n_sides} sides, area {polygon.area:.6g}, perimeter {polygon.perimeter:.6g}"
    lower, upper = problem.range_of_f
    largest = max(abs(lower), abs(upper))
    lower_text = format_bound(lower, largest, format_down)
    upper_text = format_bound(upper, largest, format_up)
    values = f"between {lower_text} and {upper_text}, rounding included"
    yield f"  f           {_describe_data(problem.f, values)}"
    for side in range(polygon.n_sides):
        start = _format_vertex(polygon.vertices[side % polygon.n_sides])
        end = _format_vertex(polygon.vertices[(side + 1) % polygon.n_sides])
        where = f"{start} to {end}, length {polygon.lengths[side]:.6g}"
        label = polygon.label_side(side)
        yield f"  {f'side {label}':11} {where}: {_describe_condition(problem, side)}"
    if not problem.contact_sides:
        yield f"  contact     {LINEAR_PROBLEM_NOTE}"
    if problem.u_lower_bound > -np.inf:
        yield f"  guaranteed  u >= {_describe_lower_bound(problem, largest)}, rounding included"
    idle = problem.idle_sides()
    if idle:
        sides = "side" if len(idle) == 1 else "sides"
        yield f"  no contact  on {sides} {join_sides(idle, polygon)}, where g is below this bound"


def _describe_lower_bound(problem: Problem, largest_f: float) -> str:
    """The lower bound on u, which is finite, and its reason."""
    # rounding of 0 is relative to u on clamped sides, or to f / c
    size = abs(problem.u_lower_bound) if problem.clamped_sides else largest_f
    c = as_float(problem.c) if problem.c != ZERO else 1.0
    bound_text = format_bound(problem.u_lower_bound, size / c, format_down)
    if problem.c == ZERO:
        return f"{bound_text}, as f >= 0"
    on_clamped = " and u on clamped sides" * bool(problem.clamped_sides)
    return f"{bound_text}, a lower bound on inf f / c{on_clamped}"


def _describe_condition(problem: Problem, side: int) -> str:
    """Words on the condition on a side and on the range of its data."""
    data = _side_data(problem, side)
    _, values = _sample_along_side(problem, data, side)
    size = np.abs(values).max()
    # values that are rounding are 0
    rounded = np.where(np.abs(values) > RELATIVE_VALUE_ROUNDING * size, values, 0.0)
    lowest = rounded.min()
    highest = rounded.max()
    text = _describe_data(data, f"from {lowest:.4g} to {highest:.4g}")
    if side in problem.free_sides:
        return f"free, {'' if problem.k == ONE else 'k '}du/dn = {text}"
    return f"clamped, u = {text}" if side in problem.clamped_sides else f"u >= {text}"


def _side_data(problem: Problem, side: int) -> object:
    """g, on a clamped side u, or on a free side q."""
    if side not in problem.free_sides:
        return problem.g[side]
    return problem.q[side] if problem.q else ZERO


def _sample_along_side(problem: Problem, data: object, side: int) -> tuple[Array, Array]:
    """Distances along a side, its ends included, and the values of the data there, (k,) each.

    They are those of a table, or of a formula at POINTS_PER_SIDE points.
    """
    length = problem.polygon.lengths[side]
    if isinstance(data, SideTable):
        return data.t * length, data.values
    s = np.linspace(0, length, POINTS_PER_SIDE)
    x, y = problem.polygon.at(np.full(POINTS_PER_SIDE, side), s).T
    return s, compile_numpy([as_formula(data)], "xy")(x, y)[0]


def format_bound(bound: float, largest: float, round_outward: Callable[[float, str], str]) -> str:
    """A bound on numbers of the size `largest`, as text that can be read and is still a bound.

    `round_outward` rounds it down or up to 12 digits. The rounding of 0 is shown as 0 or as a power of ten.
    """
    if 0 < abs(bound) <= RELATIVE_VALUE_ROUNDING * largest:
        # 0 is still a bound if it lies outward: above a negative upper one, below a positive lower one
        towards_0 = (bound < 0) == (round_outward is format_up)
        bound = (
            0.0
            if towards_0
            else math.copysign(10.0 ** math.ceil(math.log10(RELATIVE_VALUE_ROUNDING * largest)), bound)
        )
    return round_outward(bound, ".12g")


def _describe_data(data: object, range_text: str) -> str:
    """A formula or a table, with what is said of its values where it is more than a number."""
    is_number = isinstance(data, Expression) and not data.variables
    return describe_data(data) + f", {range_text}" * (not is_number)


def _format_vertex(vertex: Array) -> str:
    return f"({vertex[0]:.6g}, {vertex[1]:.6g})"


def draw_problem(problem: Problem) -> Figure:
    """f in the polygon with its numbered sides, and g along the boundary."""
    from matplotlib.figure import Figure

    width, height = np.ptp(problem.polygon.vertices, axis=0)
    panel_height = POLYGON_PANEL_INCHES * float(np.clip(height / width, 0.25, 1))
    page_size = POLYGON_PANEL_INCHES + 1.7, panel_height + OBSTACLE_PANEL_INCHES + 1
    page = Figure(figsize=page_size, layout="compressed")
    top, bottom = page.subplots(2, 1, height_ratios=(panel_height, OBSTACLE_PANEL_INCHES))
    _draw_polygon(top, problem)
    _draw_side_data(bottom, problem)
    return page


def _draw_polygon(axes: Axes, problem: Problem) -> None:
    from unilateral.solution.plot_domain import CLAMPED_SIDE_STYLE

    polygon = problem.polygon
    v = polygon.vertices
    source_text = _draw_source(axes, problem)
    for side in range(polygon.n_sides):
        ends = v[[side, (side + 1) % polygon.n_sides]]
        clamped = side in problem.clamped_sides
        axes.plot(*ends.T, **CLAMPED_SIDE_STYLE if clamped else _side_style(problem, side) | {"linewidth": 2})
        offset = (18 if clamped else 9) * polygon.normals[side]
        axes.annotate(
            polygon.label_side(side),
            ends.mean(axis=0),
            offset,
            textcoords="offset points",
            ha="center",
            va="center",
        )
    title = f"{source_text}, and the sides' numbers; dashed: free" + "; hatched: clamped" * bool(
        problem.clamped_sides
    )
    axes.use_sticky_edges = False
    axes.margins(0.12)
    axes.set(aspect="equal", xlabel="x", ylabel="y", title=title)


def _draw_source(axes: Axes, problem: Problem) -> str:
    """Draws f in colours, with their bar; its name or, if it is a constant, which needs no bar, its value."""
    v = problem.polygon.vertices
    grid = np.meshgrid(*np.linspace(v.min(axis=0), v.max(axis=0), POINTS_PER_SIDE).T)
    inside = problem.polygon.contains(np.stack(grid, axis=-1))
    with np.errstate(all="ignore"):  # f need not be defined outside
        f = np.where(inside, compile_numpy([as_formula(problem.f)], "xy")(*grid)[0], np.nan)
    f_min = float(np.nanmin(f))
    if f_min == float(np.nanmax(f)):
        axes.fill(*v.T, color=CHECK_CONSTANT_COLOUR)
        return f"f = {f_min:.4g}".replace("-", "−")
    field = axes.pcolormesh(*grid, f, rasterized=True, shading="nearest", alpha=0.6)
    axes.figure.colorbar(field, cax=axes.inset_axes((1.03, 0, 0.04, 1)), label="f")
    return "f"


def _side_style(problem: Problem, side: int) -> dict[str, Any]:
    free = side in problem.free_sides
    clamped = side in problem.clamped_sides
    look: dict[str, Any] = {
        "color": CHECK_FREE_COLOUR if free else CHECK_CONTACT_COLOUR,
        "linestyle": "--" if free else "-",
    }
    return look | ({"color": CHECK_CLAMPED_COLOUR, "linewidth": 5} if clamped else {})


def _draw_side_data(axes: Axes, problem: Problem) -> None:
    """Draws g, u on clamped sides, and on free sides the flux."""
    polygon = problem.polygon
    clamped = "; thick: u" * bool(problem.clamped_sides)
    for side in range(polygon.n_sides):
        s, values = _sample_along_side(problem, _side_data(problem, side), side)
        axes.plot(polygon.starts[side] + s, values, **_side_style(problem, side))
    for start in polygon.starts:
        axes.axvline(start, color="0.8", linewidth=0.8, zorder=0)
    axes.set(xlabel="arc length along the boundary, a line at each vertex",
             ylabel=f"g{clamped}; dashed: k ∂u/∂n",
             xlim=(0, polygon.perimeter))  # fmt: skip
