"""The commands `unilateral init` and `unilateral check`: problems of one's own, before anything is solved."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from unilateral.arrays import Array
from unilateral.errors import InputError, shown
from unilateral.formulas.decimals import down, up
from unilateral.formulas.exact_numbers import rounded
from unilateral.formulas.expression import ONE, ZERO, Expression
from unilateral.formulas.formula import compile_numpy
from unilateral.problems import problem_file
from unilateral.problems.problem import Problem, as_formula
from unilateral.solution.summary import LINEAR
from unilateral.system.files import check_target, replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURES = {".svg": ["matplotlib"], ".png": ["matplotlib"], ".pdf": ["matplotlib"]}
"""The endings of pictures, and what draws these."""
FREE = "tab:gray"
CONTACT = "tab:blue"
CLAMPED = "tab:brown"
ROUND_OFF = 1e-12
WIDE = 5.0
ALONG = 2.0
"""Inches: the width of the panel with the polygon, and the height of that along its boundary."""
POINTS = 201
"""g is drawn at this many points of a side, and f at this many along x and along y."""


def init(name: str) -> None:
    """Writes a commented problem. Raises InputError for a file that is there, or does not end in .yaml."""
    if not name.endswith((".yaml", ".yml")):
        raise InputError(f"{name}: the name of a problem file has to end in .yaml or .yml")
    if Path(name).exists():
        raise InputError(f"{name} exists already; name another file")
    template = resources.files("unilateral.problems") / "template.yaml"
    text = template.read_text(encoding="utf-8").replace("FILE", name)
    with replacing(name) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def check(name: str, picture: str | None) -> str:
    """How a problem file is read, as text, and as a picture, too, where one is named.

    Raises InputError for a file that declares no problem, and for a picture that cannot be written.
    """
    if picture is not None:
        check_target(picture, PICTURES)
    problem = problem_file.problem_in(name)
    if problem is None:
        raise InputError(f"{name} declares a case, not a problem; to see it type: unilateral cases {name}")
    if picture is not None:
        from unilateral.solution.plot import draw  # and with it the method

        with replacing(picture) as temporary:
            draw(draw_problem(problem), temporary)
    return "\n".join(describe(problem))


def describe(problem: Problem) -> Iterator[str]:
    """The lines that `check` prints."""
    polygon = problem.polygon
    if problem.c != ZERO:
        yield f"{problem.name}: -k lap u + c u = f with k = {problem.k} and c = {problem.c}"
    else:
        yield f"{problem.name}: -k lap u = f with k = {problem.k}"
    yield f"  polygon     {polygon.n_sides} sides, area {polygon.area:.6g}, perimeter {polygon.perimeter:.6g}"
    lower, upper = problem.range_of_f
    largest = max(abs(lower), abs(upper))
    values = f"between {outward(lower, largest, down)} and {outward(upper, largest, up)}, rounding included"
    yield f"  f           {_formula(as_formula(problem.f), values)}"
    for side in range(polygon.n_sides):
        start = _point(polygon.vertices[side % polygon.n_sides])
        end = _point(polygon.vertices[(side + 1) % polygon.n_sides])
        where = f"{start} to {end}, length {polygon.lengths[side]:.6g}"
        yield f"  {f'side {side}':11} {where}: {_condition(problem, side)}"
    if not problem.contact_sides:
        yield f"  contact     {LINEAR}"
    if problem.least > -np.inf:
        size = abs(problem.least) if problem.clamped_sides else largest
        least = outward(problem.least, size / (rounded(problem.c) if problem.c != ZERO else 1.0), down)
        reason = "as f >= 0"
        if problem.c != ZERO:
            reason = "a lower bound on inf f / c" + " and u on clamped sides" * bool(problem.clamped_sides)
        yield f"  guaranteed  u >= {least}, {reason}, rounding included"
    idle = problem.idle_sides()
    if idle:
        sides = "side" if len(idle) == 1 else "sides"
        yield f"  no contact  on {sides} {', '.join(map(str, idle))}, where g is below this bound"


def _condition(problem: Problem, side: int) -> str:
    """What holds on a side, with the values at POINTS points; the rounding of 0 is not shown."""
    formula = _side_formula(problem, side)
    values = _values_along(problem, formula, side)
    size = np.abs(values).max()
    shown = np.where(np.abs(values) > ROUND_OFF * size, values, 0.0)
    least = shown.min()
    largest = shown.max()
    text = _formula(formula, f"from {least:.4g} to {largest:.4g}")
    if side in problem.free_sides:
        return f"free, {'' if problem.k == ONE else 'k '}du/dn = {text}"
    return f"clamped, u = {text}" if side in problem.clamped_sides else f"u >= {text}"


def _side_formula(problem: Problem, side: int) -> Expression:
    """g, on a clamped side u, or on a free side q."""
    if side not in problem.free_sides:
        return as_formula(problem.g[side])
    return as_formula(problem.q[side]) if problem.q else ZERO


def _values_along(problem: Problem, formula: Expression, side: int) -> Array:
    """(POINTS,) values along a side, its ends and its middle included."""
    t = np.linspace(0, problem.polygon.lengths[side], POINTS)
    return compile_numpy([formula], "xy")(*problem.polygon.at(np.full(POINTS, side), t).T)[0]


def outward(x: float, size: float, rounded: Callable[[float, str], str]) -> str:
    """A bound x on something of that `size`, as text that can be read and is still a bound.

    It is `rounded` down or up to 12 digits. The rounding of 0 is shown as 0 or as a power of ten.
    """
    if 0 < abs(x) <= ROUND_OFF * size:
        towards_0 = (x < 0) == (rounded is up)
        x = 0.0 if towards_0 else math.copysign(10.0 ** math.ceil(math.log10(ROUND_OFF * size)), x)
    return rounded(x, ".12g")


def _formula(formula: Expression, values: str) -> str:
    """The formula, with what is said of its values where it is more than a number."""
    return f"{shown(formula)}, {values}" if formula.variables else shown(formula)


def _point(vertex: Array) -> str:
    return f"({vertex[0]:.6g}, {vertex[1]:.6g})"


def draw_problem(problem: Problem) -> Figure:
    """f in the polygon with its numbered sides, and g along the boundary."""
    from matplotlib.figure import Figure

    width, height = np.ptp(problem.polygon.vertices, axis=0)
    tall = WIDE * float(np.clip(height / width, 0.25, 1))
    page = Figure(figsize=(WIDE + 1.7, tall + ALONG + 1), layout="compressed")
    top, bottom = page.subplots(2, 1, height_ratios=(tall, ALONG))
    _draw_polygon(top, problem)
    _draw_obstacle(bottom, problem)
    return page


def _draw_polygon(axes: Axes, problem: Problem) -> None:
    from unilateral.solution.plot_domain import CLAMPED as HATCHED

    polygon = problem.polygon
    v = problem.polygon.vertices
    grid = np.meshgrid(*np.linspace(v.min(axis=0), v.max(axis=0), POINTS).T)
    inside = polygon.contains(np.stack(grid, axis=-1))
    with np.errstate(all="ignore"):  # f need not be defined outside
        f = np.where(inside, compile_numpy([as_formula(problem.f)], "xy")(*grid)[0], np.nan)
    least = float(np.nanmin(f))
    largest = float(np.nanmax(f))
    # A constant has the colour in the middle and one tick; matplotlib would show a range of 8 % about it
    room = 0.0 if least < largest else abs(least) or 1.0
    look: Any = {"vmin": least - room, "vmax": largest + room, "shading": "nearest", "alpha": 0.6}
    field = axes.pcolormesh(*grid, f, rasterized=True, **look)
    bar = axes.figure.colorbar(field, cax=axes.inset_axes((1.03, 0, 0.04, 1)), label="f")
    if room:
        bar.set_ticks([least], labels=[f"{least:.4g}".replace("-", "−")])
    for side in range(polygon.n_sides):
        ends = v[[side, (side + 1) % polygon.n_sides]]
        clamped = side in problem.clamped_sides
        axes.plot(*ends.T, **HATCHED if clamped else _look(problem, side) | {"linewidth": 2})
        away = (18 if clamped else 9) * polygon.normals[side]
        axes.annotate(
            str(side), ends.mean(axis=0), away, textcoords="offset points", ha="center", va="center"
        )
    title = "f, and the sides' numbers; dashed: free" + "; hatched: clamped" * bool(problem.clamped_sides)
    axes.use_sticky_edges = False
    axes.margins(0.12)
    axes.set(aspect="equal", xlabel="x", ylabel="y", title=title)


def _look(problem: Problem, side: int) -> dict[str, Any]:
    free = side in problem.free_sides
    clamped = side in problem.clamped_sides
    look: dict[str, Any] = {"color": FREE if free else CONTACT, "linestyle": "--" if free else "-"}
    return look | ({"color": CLAMPED, "linewidth": 5} if clamped else {})


def _draw_obstacle(axes: Axes, problem: Problem) -> None:
    """Draws g, u on clamped sides, and on free sides the flux."""
    polygon = problem.polygon
    clamped = "; thick: u" * bool(problem.clamped_sides)
    for side in range(polygon.n_sides):
        s = polygon.starts[side] + np.linspace(0, polygon.lengths[side], POINTS)
        axes.plot(s, _values_along(problem, _side_formula(problem, side), side), **_look(problem, side))
    for start in polygon.starts:
        axes.axvline(start, color="0.8", linewidth=0.8, zorder=0)
    axes.set(xlabel="arc length along the boundary, a line at each vertex",
             ylabel=f"g{clamped}; dashed: k ∂u/∂n",
             xlim=(0, polygon.perimeter))  # fmt: skip
