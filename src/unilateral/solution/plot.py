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
from matplotlib.gridspec import GridSpec
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import FixedLocator

from unilateral.bounds.certain_contact import Verdict
from unilateral.errors import InputError, quote_input
from unilateral.geometry.polygon import Polygon
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
CERTAIN_BAR_STYLES: Any = {
    Verdict.TOUCHES: {"facecolor": "black", "edgecolor": "black"},
    Verdict.FREE: {"facecolor": "white", "edgecolor": "black"},
    Verdict.UNDECIDED: {"facecolor": "white", "edgecolor": "0.4", "hatch": "xxxxx"},
}
CERTAIN_BAR_HEIGHT = 0.1
"""The bar of what is certain, as a fraction of the panel of the gap; it is read without colours."""
CERTAIN_BAR_KEY = "bar, guaranteed: black touches, white does not touch, hatched not decided"
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
"""Widths of a page with one panel and with two, and the height along the boundary: to be read on a phone."""
COLOUR_BAR_INCHES = 0.2
"""Margin at the right for the label of a colour bar, which the layout does not see."""
MIN_HEIGHT_OVER_WIDTH = 0.25
STACKING_HEIGHT_OVER_WIDTH = 0.5
"""Least height over width of a panel with the domain, and of panels that stand beside each other."""
TITLE_LETTERS_PER_INCH = 10.0
MAX_TITLE_LINES = 3
TITLE_ELLIPSIS = " ..."
"""Letters of a title to the inch, lines that it may have, and the end of a longer one."""
POSITION_DECIMALS = 6
"""Decimals of the place of axes, as a fraction of the page."""
SVG_STYLE: Any = {"svg.hashsalt": "unilateral", "svg.fonttype": "path"}


def draw_solution(plot_data: PlotData) -> Figure:
    """u_h with the contact set, beside it the mesh if it is adapted, and both along the boundary."""
    with mpl.rc_context(PLOT_STYLE):
        page, grid = _lay_out_page(plot_data)
        draw_domain(page.add_subplot(grid[0, 0]), plot_data)
        if plot_data.mesh.is_adapted:
            mesh_axes = page.add_subplot(grid[-3, -1])  # the last panel above the boundary's
            draw_mesh(mesh_axes, plot_data)
            mesh_axes.tick_params(labelleft=grid.ncols == 1)
        multiplier_axes = page.add_subplot(grid[-2, :])
        gap_axes = page.add_subplot(grid[-1, :], sharex=multiplier_axes)
        _draw_boundary_panels(multiplier_axes, gap_axes, plot_data)
        letters = int(TITLE_LETTERS_PER_INCH * page.get_figwidth())
        lines = [*wrap_evenly(plot_data.title, letters), *wrap_evenly(plot_data.accuracy_text, letters)]
        page.suptitle("\n".join(lines), parse_math=False)  # for the title is the user's
    return page


def _lay_out_page(plot_data: PlotData) -> tuple[Figure, GridSpec]:
    """An empty page and its grid: panels with the domain, beside each other or stacked, above two rows.

    Those two rows are for values along the boundary.
    """
    width, height = np.ptp(plot_data.mesh.points, axis=0)
    aspect = float(np.clip(height / width, MIN_HEIGHT_OVER_WIDTH, MAX_HEIGHT_OVER_WIDTH))
    panels = 2 if plot_data.mesh.is_adapted else 1
    columns = panels if aspect > STACKING_HEIGHT_OVER_WIDTH else 1
    rows = panels // columns
    page_width = TWO_PANEL_INCHES if columns > 1 else ONE_PANEL_INCHES
    panel_height = (page_width / columns - 1) * aspect + 0.6  # less labels and the colour bar, and a title
    page_height = rows * panel_height + 2 * BOUNDARY_PANEL_INCHES
    layout = ConstrainedLayoutEngine(rect=(0, 0, 1 - COLOUR_BAR_INCHES / page_width, 1))
    page = Figure(figsize=(page_width, page_height), layout=layout, dpi=DOTS_PER_INCH)
    height_ratios = [panel_height] * rows + [BOUNDARY_PANEL_INCHES] * 2
    return page, page.add_gridspec(rows + 2, columns, height_ratios=height_ratios)


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
    has_values = bool(plot_data.contact.intervals) or plot_data.given_flux.any()
    _set_value_ticks(multiplier_axes, "" if has_values else plot_data.contact_text)
    _set_value_ticks(gap_axes, plot_data.no_gap_text)
    for axes in (multiplier_axes, gap_axes):
        for start in polygon.starts:
            axes.axvline(start, color="0.8", linewidth=0.8, zorder=0)
        axes.axhline(0, color="0.8", linewidth=0.8, zorder=0)
    multiplier_axes.set(ylabel="multiplier\n$\\lambda_H$", xlim=(0, polygon.perimeter))
    multiplier_axes.tick_params(labelbottom=False)
    # the power of ten at the right, not in the way of the sides' numbers
    multiplier_axes.yaxis.get_offset_text().set_horizontalalignment("right")
    gap_axes.set(xlabel="arc length from vertex 0, anticlockwise", ylabel="gap, mean\nof $u_h - g$")
    _mark_sides_without_contact(multiplier_axes, gap_axes, plot_data)
    _draw_certain_bar(gap_axes, plot_data)
    number_sides(multiplier_axes, polygon)


def number_sides(axes: Axes, polygon: Polygon) -> None:
    """Numbers the sides above axes over the arc length, at their middles."""
    numbered_sides = select_numbered_sides(polygon)
    side_axis = axes.secondary_xaxis("top")
    middles = polygon.starts[:-1] + polygon.lengths / 2
    side_axis.set_xticks(middles[numbered_sides], [str(i) if i else "side 0" for i in numbered_sides])
    side_axis.tick_params(length=0)


def _draw_certain_bar(axes: Axes, plot_data: PlotData) -> None:
    """A bar at the lower edge of a panel along the boundary: where contact is certain, and where a gap."""
    certain = plot_data.contact.certain
    for arc in certain:
        start = plot_data.mesh.polygon.starts[arc.side]
        style = CERTAIN_BAR_STYLES[arc.verdict]
        bar: Any = {"ymax": CERTAIN_BAR_HEIGHT, "linewidth": 0.4, "zorder": 3, **style}
        axes.axvspan(start + arc.start, start + arc.end, **bar)
    if certain:
        axes.set_xlabel(f"{axes.get_xlabel()}\n{CERTAIN_BAR_KEY}")
        # room for the bar below the curve
        bottom, top = axes.get_ylim()
        axes.set_ylim(bottom - 1.5 * CERTAIN_BAR_HEIGHT * (top - bottom), top)


def _set_value_ticks(axes: Axes, zero_meaning: str) -> None:
    """Sets few ticks, or where all values are 0 writes what that means."""
    axes.yaxis.set_major_locator(FixedLocator([0]) if zero_meaning else choose_ticks())
    if zero_meaning:
        axes.set_ylim(-1, 1)
        axes.text(0.5, 0.75, zero_meaning, ha="center", va="center", transform=axes.transAxes)


def _mark_sides_without_contact(multiplier_axes: Axes, gap_axes: Axes, plot_data: PlotData) -> None:
    """Marks sides without contact in grey, clamped ones hatched, free ones with the flux that is given."""
    s = plot_data.contact.partition.points
    polygon = plot_data.mesh.polygon
    for side in np.unique(plot_data.contact.partition.side[plot_data.no_contact]):
        start, end = polygon.starts[[side, side + 1]]
        clamped = side in plot_data.clamped_sides
        for axes in (multiplier_axes, gap_axes):
            axes.axvspan(start, end, zorder=-1, **CLAMPED_BAND_STYLE if clamped else {"color": "0.93"})
        if end - start >= MIN_NUMBER_DISTANCE * polygon.perimeter and not clamped:
            alignment: Any = {"transform": gap_axes.get_xaxis_transform(), "ha": "center", "va": "center"}
            gap_axes.text((start + end) / 2, 0.25, "free", color=FREE_COLOUR, **alignment)
    if plot_data.given_flux.any():
        given_flux = np.where(plot_data.no_contact, plot_data.given_flux, np.nan)
        dashes: Any = {"color": FREE_COLOUR, "linestyle": "dashed", "label": "given flux q"}
        multiplier_axes.stairs(given_flux, s, baseline=None, **dashes)
        multiplier_axes.legend(fontsize="small", frameon=False)


def wrap_evenly(text: str, max_letters: int) -> list[str]:
    """Lines of at most so many letters: as few as the text takes, and of much the same length."""
    # the narrowest width that takes no more lines makes them even
    lines = textwrap.wrap(text, max_letters, max_lines=MAX_TITLE_LINES, placeholder=TITLE_ELLIPSIS)
    for width in range(len(text) // max(len(lines), 1), max_letters):
        evener = textwrap.wrap(text, max(width, 1))
        if len(evener) == len(lines):
            return evener
    return lines


def write_figure(figure: Figure, path: Path) -> None:
    """Writes the figure into a file, with the same bytes for the same figure."""
    no_date = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    # the last digits of where the layout puts axes depend on the order in which it sees them
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axes in figure.axes:
        axes.set_position(tuple(np.round(axes.get_position(original=True).bounds, POSITION_DECIMALS)))
    with mpl.rc_context(SVG_STYLE):
        figure.savefig(path, metadata=no_date.get(path.suffix))


def render_svg(figure: Figure) -> str:
    """The figure as an element of a page of HTML, the same for the same figure."""
    svg = StringIO()
    with mpl.rc_context(SVG_STYLE):
        figure.savefig(svg, format="svg", metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))
    return "<svg" + svg.getvalue().partition("<svg")[2]
