"""What the figures share: the page, the text, the looks of lines, and the reading of their tables.

Lengths are in cm on a page 17 cm wide, so that the text, 8 points or more, has the size it has in print.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction

import pandas as pd
from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from unilateral.errors import InputError
from unilateral.files import replacing

FilePath = str | os.PathLike[str]
WIDTH = 17.0
CM = 1 / 2.54
SMALL = 8.5
STYLE = {
    "font.family": "STIXGeneral",
    "mathtext.fontset": "stix",
    "font.size": 9.5,
    "axes.titlesize": 10.5,
    "axes.linewidth": 0.6,
    "xtick.labelsize": SMALL,
    "ytick.labelsize": SMALL,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "ytick.minor.width": 0.4,
    "legend.fontsize": SMALL,
    "legend.frameon": False,
    "hatch.linewidth": 0.4,
    "savefig.dpi": 300,
    "svg.fonttype": "path",
    "svg.hashsalt": "unilateral",
}
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000", "#E69F00", "#56B4E9")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "p", "*")
LINES = ("-", (0, (4, 1.6)), (0, (1, 1.4)))
FAMILIAR = ("natural", "smooth", "thirds", "full_contact", "no_contact")
"""Cases that look alike in all figures."""
NORMS = {
    "h1": r"$\Vert u-u_h\Vert_1$",
    "hm12": r"$\Vert\lambda-\lambda_H\Vert_{-1/2}$",
    "l2": r"$\Vert\lambda-\lambda_H\Vert_0$",
}


def read(path: FilePath) -> pd.DataFrame:
    """The table that a figure is drawn from. Raises InputError where there is none."""
    try:
        return pd.read_csv(path)
    except FileNotFoundError:
        raise InputError(f"there is no table {path}") from None
    except (ValueError, OSError):
        raise InputError(f"{path} is no CSV table") from None


@contextmanager
def figure_in(path: FilePath, height: float) -> Iterator[Figure]:
    """A figure in the house style, written when it is complete."""
    with style.context(STYLE, after_reset=True):
        figure = Figure(figsize=(WIDTH * CM, height * CM))
        yield figure
        with replacing(path) as temporary:
            figure.savefig(temporary, format="svg", metadata={"Date": None, "Creator": None})


def axes_at(figure: Figure, left: float, bottom: float, width: float, height: float) -> Axes:
    total = figure.get_figheight() / CM
    return figure.add_axes((left / WIDTH, bottom / total, width / WIDTH, height / total))


def light_grid(axes: Axes, grey: str = "0.9") -> None:
    """Lines at the major ticks, below all that is drawn."""
    axes.grid(which="major", color=grey, lw=0.5)
    axes.set_axisbelow(True)


def as_fraction(value: float) -> str:
    """1/8 for 0.125; sizes are rounded, and a size that is no part of 1 stays a decimal."""
    near = Fraction(1, round(1 / value)) if value < 1 else Fraction(value).limit_denominator(4)
    return str(near) if abs(near / value - 1) < 1e-3 else f"{value:.3g}"


def plain_bar(bar) -> None:  # type: ignore[no-untyped-def]
    bar.solids.set_rasterized(True)
    bar.ax.minorticks_off()
    bar.outline.set_linewidth(0.5)
