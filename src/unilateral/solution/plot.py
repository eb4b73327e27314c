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

from unilateral.errors import InputError, quote_input
from unilateral.solution.plot_data import MIN_NUMBER_DISTANCE, PlotData, select_numbered_sides
from unilateral.solution.plot_domain import (
    CONTACT_COLOUR,
    FREE_COLOUR,
    MAX_HEIGHT_OVER_WIDTH,
    choose_ticks,
    draw_domain,
    draw_mesh,
)

GAP_COLOUR = "tab:blue"
CLAMPED_BAND_STYLE: Any = {"facecolor": "0.93", "edgecolor": "0.8", "linewidth": 0, "hatch": "///"}
DOTS_PER_INCH = 150
"""Dots per inch of what has as many parts as the mesh."""
PLOT_STYLE: Any = {
    "font.size": 11,
    "axes.titlesize": 11,
    "figure.titlesize": 12,
    "axes.formatter.limits": (-3, 4),
    "axes.formatter.use_mathtext": True,
}
ONE_PANEL_INCHES = 6.5
TWO_PANEL_INCHES = 7.5
BOUNDARY_PANEL_INCHES = 1.7
"""The width of a page with one panel and with two beside each other, and the height along the boundary.

In inches; they are small beside the letters, so that a picture can be read on a phone.
"""
COLOUR_BAR_INCHES = 0.2
"""The room at the right for the label of a colour bar, in inches, which the layout does not see."""
MIN_HEIGHT_OVER_WIDTH = 0.25
STACKING_HEIGHT_OVER_WIDTH = 0.5
"""The least height over width of the space for the domain.

Panels of domains below FLAT stand one above the other.
"""
TITLE_LETTERS_PER_INCH = 10.0
MAX_TITLE_LINES = 3
TITLE_ELLIPSIS = " ..."
"""Letters of a title to the inch, lines that it may have, and the end of a longer one."""
POSITION_DECIMALS = 6
"""Decimals of the place of axes, as a fraction of the page."""
SVG_STYLE: Any = {"svg.hashsalt": "unilateral", "svg.fonttype": "path"}


def draw_solution(plot_data: PlotData) -> Figure:
    """u_h with the contact set, beside it the mesh if it is adapted, and both along the boundary."""
    width, height = np.ptp(plot_data.mesh.points, axis=0)
    shape = float(np.clip(height / width, MIN_HEIGHT_OVER_WIDTH, MAX_HEIGHT_OVER_WIDTH))
    panels = 2 if plot_data.mesh.is_adapted else 1
    across = panels if shape > STACKING_HEIGHT_OVER_WIDTH else 1
    wide = TWO_PANEL_INCHES if across > 1 else ONE_PANEL_INCHES
    down = panels // across
    tall = (wide / across - 1) * shape + 0.6  # less labels and the colour bar, and a title
    with mpl.rc_context(PLOT_STYLE):
        layout = ConstrainedLayoutEngine(rect=(0, 0, 1 - COLOUR_BAR_INCHES / wide, 1))
        page = Figure(
            figsize=(wide, down * tall + 2 * BOUNDARY_PANEL_INCHES), layout=layout, dpi=DOTS_PER_INCH
        )
        grid = page.add_gridspec(down + 2, across, height_ratios=[tall] * down + [BOUNDARY_PANEL_INCHES] * 2)
        draw_domain(page.add_subplot(grid[0, 0]), plot_data)
        if panels > 1:
            beside = page.add_subplot(grid[down - 1, across - 1])
            draw_mesh(beside, plot_data)
            beside.tick_params(labelleft=across == 1)
        above = page.add_subplot(grid[-2, :])
        _draw_boundary_panels(above, page.add_subplot(grid[-1, :], sharex=above), plot_data)
        lines = [
            line
            for text in (plot_data.title, plot_data.accuracy_text)
            for line in wrap_evenly(text, int(TITLE_LETTERS_PER_INCH * wide))
        ]
        page.suptitle("\n".join(lines), parse_math=False)  # for the title is the user's
    return page


def draw_on_axes(ax: object, plot_data: PlotData) -> Axes:
    """Draws u_h with the contact set on axes, and returns these. Raises InputError for what are none."""
    if not isinstance(ax, Axes) or ax.name != "rectilinear":
        raise InputError(
            f"ax is {quote_input(repr(ax))}; it has to be plane axes of matplotlib, such as plt.gca()"
        )
    draw_domain(ax, plot_data, is_bar_inside=True)
    return ax


def _draw_boundary_panels(multiplier_axes: Axes, gap_axes: Axes, plot_data: PlotData) -> None:
    """lambda_H, and below it u_h - g, over the arc length; free sides are grey, and sides have numbers."""
    s = plot_data.contact.partition.points
    polygon = plot_data.mesh.polygon
    multiplier_axes.stairs(plot_data.contact.lambda_H, s, color=CONTACT_COLOUR, fill=True, alpha=0.3)
    multiplier_axes.stairs(plot_data.contact.lambda_H, s, color=CONTACT_COLOUR)
    gap_axes.stairs(plot_data.gap, s, baseline=0, color=GAP_COLOUR)
    _set_value_ticks(
        multiplier_axes,
        "" if plot_data.contact.intervals or plot_data.given_flux.any() else plot_data.contact_text,
    )
    _set_value_ticks(gap_axes, plot_data.no_gap_text)
    for axes in (multiplier_axes, gap_axes):
        for start in polygon.starts:
            axes.axvline(start, color="0.8", linewidth=0.8, zorder=0)
        axes.axhline(0, color="0.8", linewidth=0.8, zorder=0)
    multiplier_axes.set(ylabel="multiplier\n$\\lambda_H$", xlim=(0, polygon.perimeter))
    multiplier_axes.tick_params(labelbottom=False)
    multiplier_axes.yaxis.get_offset_text().set_horizontalalignment(
        "right"
    )  # not in the way of the sides' numbers
    gap_axes.set(xlabel="arc length from vertex 0, anticlockwise", ylabel="gap, mean\nof $u_h - g$")
    _mark_sides_without_contact(multiplier_axes, gap_axes, plot_data)
    named = select_numbered_sides(plot_data)
    sides = multiplier_axes.secondary_xaxis("top")
    middles = polygon.starts[:-1] + polygon.lengths / 2
    sides.set_xticks(middles[named], [str(i) if i else "side 0" for i in named])
    sides.tick_params(length=0)


def _set_value_ticks(axes: Axes, zero_meaning: str) -> None:
    """Few ticks, or where all is 0 what that means."""
    axes.yaxis.set_major_locator(FixedLocator([0]) if zero_meaning else choose_ticks())
    if zero_meaning:
        axes.set_ylim(-1, 1)
        axes.text(0.5, 0.75, zero_meaning, ha="center", va="center", transform=axes.transAxes)


def _mark_sides_without_contact(multiplier_axes: Axes, gap_axes: Axes, plot_data: PlotData) -> None:
    """Sides without contact in grey, clamped ones hatched, free ones with the flux that is given there."""
    s = plot_data.contact.partition.points
    polygon = plot_data.mesh.polygon
    for side in np.unique(plot_data.contact.partition.side[plot_data.no_contact]):
        start, end = polygon.starts[[side, side + 1]]
        clamped = side in plot_data.clamped_sides
        for axes in (multiplier_axes, gap_axes):
            axes.axvspan(start, end, zorder=-1, **CLAMPED_BAND_STYLE if clamped else {"color": "0.93"})
        if end - start >= MIN_NUMBER_DISTANCE * polygon.perimeter and not clamped:
            place: Any = {"transform": gap_axes.get_xaxis_transform(), "ha": "center", "va": "center"}
            gap_axes.text((start + end) / 2, 0.25, "free", color=FREE_COLOUR, **place)
    if plot_data.given_flux.any():
        given_flux = np.where(plot_data.no_contact, plot_data.given_flux, np.nan)
        multiplier_axes.stairs(
            given_flux, s, baseline=None, color=FREE_COLOUR, linestyle="dashed", label="given flux q"
        )
        multiplier_axes.legend(fontsize="small", frameon=False)


def wrap_evenly(text: str, max_letters: int) -> list[str]:
    """A text on as few lines of at most so many letters as it takes, all of much the same length."""
    lines = textwrap.wrap(text, max_letters, max_lines=MAX_TITLE_LINES, placeholder=TITLE_ELLIPSIS)
    for width in range(len(text) // max(len(lines), 1), max_letters):
        evener = textwrap.wrap(text, max(width, 1))
        if len(evener) == len(lines):
            return evener
    return lines


def write_figure(figure: Figure, path: Path) -> None:
    """Writes the figure into a file, with the same bytes for the same figure."""
    undated = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    _round_axes_positions(figure)
    with mpl.rc_context(SVG_STYLE):
        figure.savefig(path, metadata=undated.get(path.suffix))


def _round_axes_positions(figure: Figure) -> None:
    """Rounds where the layout puts axes: its last digits depend on the order in which it sees them."""
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axes in figure.axes:
        axes.set_position(tuple(np.round(axes.get_position(original=True).bounds, POSITION_DECIMALS)))


def render_svg(figure: Figure) -> str:
    """The figure as an element of a page of HTML, the same for the same figure."""
    svg = StringIO()
    with mpl.rc_context(SVG_STYLE):
        figure.savefig(svg, format="svg", metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))
    return "<svg" + svg.getvalue().partition("<svg")[2]
