"""What the figures share: the page, the looks of lines, axes, keys, notes, and the reading of tables.

Lengths are in cm on a page 17 cm wide, so that the text, 8 points or more, has the size it has in print.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from fractions import Fraction
from typing import Any

import numpy as np
import pandas as pd
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter, NullLocator

from unilateral.errors import InputError
from unilateral.system.files import replacing

FilePath = str | os.PathLike[str]
Look = dict[str, Any]
"""Options of matplotlib's functions."""
PAGE_WIDTH_CM = 17.0
INCHES_PER_CM = 1 / 2.54
SMALL_FONT_POINTS = 8.5
SIZE_TOLERANCE = 1e-3
"""Sizes in the tables are rounded; relatively, they are closer than this to the sizes that are meant."""
MATPLOTLIB_STYLE = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 9.5,
    "axes.titlesize": 10.5,
    "axes.linewidth": 0.6,
    "xtick.labelsize": SMALL_FONT_POINTS,
    "ytick.labelsize": SMALL_FONT_POINTS,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "ytick.minor.width": 0.4,
    "legend.fontsize": SMALL_FONT_POINTS,
    "legend.frameon": False,
    "hatch.linewidth": 0.4,
    "savefig.dpi": 300,
    "svg.fonttype": "path",
    "svg.hashsalt": "unilateral",
}
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000", "#E69F00", "#56B4E9")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "p", "*")
LINE_STYLES = ("-", (0, (4, 1.6)), (0, (1, 1.4)))
FAMILIAR_CASES = ("natural", "smooth", "thirds", "full_contact", "no_contact")
"""These cases have the same colour and marker in all figures."""
NORM_TITLES = {
    "h1": r"$\Vert u-u_h\Vert_1$",
    "hm12": r"$\Vert\lambda-\lambda_H\Vert_{-1/2}$",
    "l2": r"$\Vert\lambda-\lambda_H\Vert_0$",
}


def read_figure_table(path: FilePath) -> pd.DataFrame:
    """The table that a figure is drawn from. Raises InputError where there is none."""
    try:
        return pd.read_csv(path)
    except FileNotFoundError:
        raise InputError(f"there is no table {path}") from None
    except (ValueError, OSError):
        raise InputError(f"{path} is no CSV table") from None


@contextmanager
def open_figure(path: FilePath, height_cm: float) -> Iterator[Figure]:
    """A figure in the style of the study, written when it is complete."""
    with style.context(MATPLOTLIB_STYLE, after_reset=True):
        figure = Figure(figsize=(PAGE_WIDTH_CM * INCHES_PER_CM, height_cm * INCHES_PER_CM))
        yield figure
        with replacing(path) as temporary:
            figure.savefig(temporary, format="svg", metadata={"Date": None, "Creator": None})


def add_axes(figure: Figure, left_cm: float, bottom_cm: float, width_cm: float, height_cm: float) -> Axes:
    """Axes on a figure at a place and of a size in cm."""
    total = _figure_height_cm(figure)
    return figure.add_axes(
        (left_cm / PAGE_WIDTH_CM, bottom_cm / total, width_cm / PAGE_WIDTH_CM, height_cm / total)
    )


def add_legend(
    figure: Figure, handles: Sequence[Any], left_cm: float, top_cm: float, **options: Any
) -> Legend:
    """A key with its upper left corner at (left, top); it has no margin unless `options` give it one."""
    corner = (left_cm / PAGE_WIDTH_CM, top_cm / _figure_height_cm(figure))
    space = {"borderpad": 0, "borderaxespad": 0}
    return figure.legend(handles=handles, loc="upper left", bbox_to_anchor=corner, **(space | options))


def add_note(figure: Figure, text: str, left_cm: float = 0.1, bottom_cm: float = 0.2, **options: Any) -> None:
    """Small text with its lower left corner at (left, bottom)."""
    figure.text(
        left_cm / PAGE_WIDTH_CM,
        bottom_cm / _figure_height_cm(figure),
        text,
        fontsize=SMALL_FONT_POINTS,
        **options,
    )


def _figure_height_cm(figure: Figure) -> float:
    return figure.get_figheight() / INCHES_PER_CM


def legend_entry(label: str, **look: Any) -> Line2D:
    """The entry of a line or a marker in a key."""
    return Line2D([], [], label=label, **look)


def numbered_look(i: int) -> Look:
    """The colour and the marker with the number i."""
    return {"color": COLOURS[i % len(COLOURS)], "marker": MARKERS[i % len(MARKERS)]}


def marker_look(i: int, filled: bool, size: float) -> Look:
    """The colour and the marker with the number i, of that size, filled or open."""
    look = numbered_look(i)
    return {**look, "ms": size, "mfc": look["color"] if filled else "white", "mew": 1.0}


def number_looks(names: Iterable[str]) -> dict[str, int]:
    """The number of each name's look; the familiar cases keep their own."""
    all_names = list(names)
    numbers = {name: i for i, name in enumerate(dict.fromkeys((*FAMILIAR_CASES, *all_names)))}
    return {name: i for name, i in numbers.items() if name in all_names}


def set_size_axes(axes: Axes, sizes: pd.Series, every: int = 1) -> None:
    """Make both axes logarithmic, the horizontal one with ticks at powers of 2, every `every`-th labelled."""
    axes.set_xscale("log", base=2)
    axes.set_yscale("log")
    powers = range(int(np.floor(np.log2(sizes.min()))), 1)
    labels = ["" if (k + 1) % every else f"${format_fraction(2.0**k)}$" for k in powers]
    axes.set_xticks([2.0**k for k in powers], labels)
    axes.set_xlim(sizes.min() / 1.3, sizes.max() * 1.3)
    axes.xaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_locator(LogLocator(numticks=20))
    axes.yaxis.set_minor_formatter(NullFormatter())
    draw_light_grid(axes)


def draw_log_line(axes: Axes, x: pd.Series, y: pd.Series, **look: Any) -> None:
    """Draw a line on axes that are both logarithmic."""
    axes.set_xscale("log")
    axes.set_yscale("log")
    draw_light_grid(axes)
    axes.plot(x, y, **look)


def set_plain_ticks(axis: Axis) -> None:
    """Ticks at 1, 2 and 5 with plain numbers, for a logarithmic axis on which are few powers of 10."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_locator(NullLocator())


def widen_to_decades(low: float, high: float) -> tuple[float, float]:
    """The limits of a logarithmic axis, moved out to powers of 10 if they hold fewer than two of them."""
    first = np.ceil(np.log10(low))
    last = np.floor(np.log10(high))
    return (low, high) if last > first else (10.0 ** (first - 1), 10.0 ** (last + 1))


def draw_sides(axes: Axes, ends: pd.DataFrame, names: Sequence[str], height: float, **line: Any) -> None:
    """Draw lines where sides start and names, if any, between them; `ends` has both ends of each side."""
    place: Look = {"transform": axes.get_xaxis_transform(), "fontsize": SMALL_FONT_POINTS, "ha": "center"}
    for start in ends["start"]:
        axes.axvline(start, **line)
    for name, start, end in zip(names, ends["start"], ends["end"], strict=bool(names)):
        axes.text((start + end) / 2, height, name, **place)


def draw_light_grid(axes: Axes, grey: str = "0.9") -> None:
    """Lines at the major ticks, below all that is drawn."""
    axes.grid(which="major", color=grey, lw=0.5)
    axes.set_axisbelow(True)


def format_fraction(value: float, denominator: int = 4) -> str:
    """A size as a fraction, 1/8 for 0.125. Sizes are rounded; one near no fraction stays a decimal."""
    near = Fraction(value).limit_denominator(denominator)
    if value < 1 and abs(near / value - 1) >= SIZE_TOLERANCE:
        near = Fraction(1, round(1 / value))
    return str(near) if abs(near / value - 1) < SIZE_TOLERANCE else f"{value:.3g}"


def simplify_colour_bar(bar) -> None:  # type: ignore[no-untyped-def]
    """Leave a colour bar without minor ticks, with a thin outline and its colours as a bitmap."""
    bar.solids.set_rasterized(True)
    bar.ax.minorticks_off()
    bar.outline.set_linewidth(0.5)
