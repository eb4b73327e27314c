"""The picture of a solution, by matplotlib."""

from __future__ import annotations

import textwrap
from io import StringIO
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import FixedLocator

from unilateral.errors import InputError, shown
from unilateral.solution.plot_domain import CONTACT, FREE, TALLEST, domain, mesh, ticks
from unilateral.solution.shown import APART, Shown, numbered

GAP = "tab:blue"
CLAMPED: Any = {"facecolor": "0.93", "edgecolor": "0.8", "linewidth": 0, "hatch": "///"}
DOTS = 150
"""Dots per inch of what has as many parts as the mesh."""
STYLE: Any = {
    "font.size": 11,
    "axes.titlesize": 11,
    "figure.titlesize": 12,
    "axes.formatter.limits": (-3, 4),
    "axes.formatter.use_mathtext": True,
}
ONE = 6.5
TWO = 7.5
ALONG = 1.7
"""The width of a page with one panel and with two beside each other, and the height along the boundary.

In inches; they are small beside the letters, so that a picture can be read on a phone.
"""
BAR = 0.2
"""The room at the right for the label of a colour bar, in inches, which the layout does not see."""
FLATTEST = 0.25
FLAT = 0.5
"""The least height over width of the space for the domain.

Panels of domains below FLAT stand one above the other.
"""
LETTERS = 10.0
LINES = 3
DOTTED = " ..."
"""Letters of a title to the inch, lines that it may have, and the end of a longer one."""
PLACES = 6
"""Decimals of the place of axes, as a fraction of the page."""
PATHS: Any = {"svg.hashsalt": "unilateral", "svg.fonttype": "path"}


def figure(of: Shown) -> Figure:
    """u_h with the contact set, beside it the mesh if it is adapted, and both along the boundary."""
    width, height = np.ptp(of.mesh.points, axis=0)
    shape = float(np.clip(height / width, FLATTEST, TALLEST))
    panels = 2 if of.mesh.adapted else 1
    across = panels if shape > FLAT else 1
    wide = TWO if across > 1 else ONE
    down = panels // across
    tall = (wide / across - 1) * shape + 0.6  # less labels and the colour bar, and a title
    with mpl.rc_context(STYLE):
        layout = ConstrainedLayoutEngine(rect=(0, 0, 1 - BAR / wide, 1))
        page = Figure(figsize=(wide, down * tall + 2 * ALONG), layout=layout, dpi=DOTS)
        grid = page.add_gridspec(down + 2, across, height_ratios=[tall] * down + [ALONG] * 2)
        domain(page.add_subplot(grid[0, 0]), of)
        if panels > 1:
            beside = page.add_subplot(grid[down - 1, across - 1])
            mesh(beside, of)
            beside.tick_params(labelleft=across == 1)
        above = page.add_subplot(grid[-2, :])
        _along(above, page.add_subplot(grid[-1, :], sharex=above), of)
        lines = [line for text in (of.title, of.accuracy) for line in wrapped(text, int(LETTERS * wide))]
        page.suptitle("\n".join(lines), parse_math=False)  # for the title is the user's
    return page


def on_axes(ax: object, of: Shown) -> Axes:
    """Draws u_h with the contact set on axes, and returns these. Raises InputError for what are none."""
    if not isinstance(ax, Axes) or ax.name != "rectilinear":
        raise InputError(f"ax is {shown(repr(ax))}; it has to be plane axes of matplotlib, such as plt.gca()")
    domain(ax, of, inside=True)
    return ax


def _along(above: Axes, below: Axes, of: Shown) -> None:
    """lambda_H, and below it u_h - g, over the arc length; free sides are grey, and sides have numbers."""
    s = of.contact.partition.points
    polygon = of.mesh.polygon
    above.stairs(of.contact.lambda_H, s, color=CONTACT, fill=True, alpha=0.3)
    above.stairs(of.contact.lambda_H, s, color=CONTACT)
    below.stairs(of.gap, s, baseline=0, color=GAP)
    _scaled(above, "" if of.contact.intervals or of.flux.any() else of.where)
    _scaled(below, of.no_gap)
    for axes in (above, below):
        for start in polygon.starts:
            axes.axvline(start, color="0.8", linewidth=0.8, zorder=0)
        axes.axhline(0, color="0.8", linewidth=0.8, zorder=0)
    above.set(ylabel="multiplier\n$\\lambda_H$", xlim=(0, polygon.perimeter))
    above.tick_params(labelbottom=False)
    above.yaxis.get_offset_text().set_horizontalalignment("right")  # not in the way of the sides' numbers
    below.set(xlabel="arc length from vertex 0, anticlockwise", ylabel="gap, mean\nof $u_h - g$")
    _free(above, below, of)
    named = numbered(of)
    sides = above.secondary_xaxis("top")
    middles = polygon.starts[:-1] + polygon.lengths / 2
    sides.set_xticks(middles[named], [str(i) if i else "side 0" for i in named])
    sides.tick_params(length=0)


def _scaled(axes: Axes, nothing: str) -> None:
    """Few ticks, or where all is 0 what that means."""
    axes.yaxis.set_major_locator(FixedLocator([0]) if nothing else ticks())
    if nothing:
        axes.set_ylim(-1, 1)
        axes.text(0.5, 0.75, nothing, ha="center", va="center", transform=axes.transAxes)


def _free(above: Axes, below: Axes, of: Shown) -> None:
    """Sides without contact in grey, clamped ones hatched, free ones with the flux that is given there."""
    s = of.contact.partition.points
    polygon = of.mesh.polygon
    for side in np.unique(of.contact.partition.side[of.free]):
        start, end = polygon.starts[[side, side + 1]]
        clamped = side in of.clamped
        for axes in (above, below):
            axes.axvspan(start, end, zorder=-1, **CLAMPED if clamped else {"color": "0.93"})
        if end - start >= APART * polygon.perimeter and not clamped:
            place: Any = {"transform": below.get_xaxis_transform(), "ha": "center", "va": "center"}
            below.text((start + end) / 2, 0.25, "free", color=FREE, **place)
    if of.flux.any():
        given = np.where(of.free, of.flux, np.nan)
        above.stairs(given, s, baseline=None, color=FREE, linestyle="dashed", label="given flux q")
        above.legend(fontsize="small", frameon=False)


def wrapped(text: str, most: int) -> list[str]:
    """A text on as few lines of at most so many letters as it takes, all of much the same length."""
    found = textwrap.wrap(text, most, max_lines=LINES, placeholder=DOTTED)
    for width in range(len(text) // max(len(found), 1), most):
        evener = textwrap.wrap(text, max(width, 1))
        if len(evener) == len(found):
            return evener
    return found


def draw(page: Figure, path: Path) -> None:
    """Writes the figure into a file, with the same bytes for the same figure."""
    undated = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    _placed(page)
    with mpl.rc_context(PATHS):
        page.savefig(path, metadata=undated.get(path.suffix))


def _placed(page: Figure) -> None:
    """Rounds where the layout puts axes: its last digits depend on the order in which it sees them."""
    page.draw_without_rendering()
    page.set_layout_engine("none")
    for axes in page.axes:
        axes.set_position(tuple(np.round(axes.get_position(original=True).bounds, PLACES)))


def svg(page: Figure) -> str:
    """The figure as an element of a page of HTML, the same for the same figure."""
    found = StringIO()
    with mpl.rc_context(PATHS):
        page.savefig(found, format="svg", metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))
    return "<svg" + found.getvalue().partition("<svg")[2]
