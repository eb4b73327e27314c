"""The tables of figures in git, with numbers that follow no law, and what is drawn of them."""

from contextlib import contextmanager
from functools import cache
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.text import Text

ROOT = Path(__file__).parents[2]
NUMBERS = {
    "adaptive": ["error", "bound", "beta", "beta_of_edges"],
    "benchmarks": ["y"],
    "consistency": ["lambda_mean", "over_H2"],
    "dual_norm": ["mean", "gap", "shortcut"],
    "extremes": ["log10_value"],
    "grid": ["error"],
    "infsup": ["beta_lower", "beta_fortin"],
    "multiplier": ["mu"],
    "portrait": ["value"],
    "rates": ["error", "rate", "expected"],
    "reaction": ["log10_value", "index"],
    "sharpness": ["rate"],
    "verdict": ["margin"],
    "work_precision": ["error"],
}
"""By the modules of figures, the columns that are drawn as they are; of any other module, all numbers are."""


FIGURES = [file.stem for file in sorted((ROOT / "figures").glob("*.svg"))]
"""The names of the figures in git."""
NAMES = {"grid": "grid_square", "dual_norm": "dual_square", "portrait": "solution", "rates": "rates_square"}
"""The figures of modules, where a figure has another name than its module; `rates` has one for each scene."""


@cache
def modules():
    """The modules that draw figures, by their names without the end `_figure`."""
    files = [
        (folder, file)
        for folder, package in ((ROOT / "src", "study"), (ROOT, "benchmarks"))
        for file in sorted((folder / package).rglob("*_figure.py"))
    ]
    dotted = [".".join(file.relative_to(folder).with_suffix("").parts) for folder, file in files]
    return {name.rpartition(".")[2].removesuffix("_figure"): import_module(name) for name in dotted}


def module_of(figure):
    """The module that draws a figure in git."""
    names = {file: name for name, file in NAMES.items()}
    return modules()["rates" if figure.startswith("rates_") else names.get(figure, figure)]


def read_committed_table(figure):
    return pd.read_csv(ROOT / f"figures/{NAMES.get(figure, figure)}.csv")


def table(figure):
    """Its table, each of the numbers times a factor of its own: none follows from others."""
    computed = read_committed_table(figure)
    for k, name in enumerate(NUMBERS.get(figure, computed.select_dtypes("float")), start=1):
        computed[name] *= 1 + 0.1 * k
    return computed


@contextmanager
def record_figures():
    """The figures as they are written."""
    figures = []
    savefig = Figure.savefig

    def recording(figure, *arguments, **options):
        savefig(figure, *arguments, **options)
        figures.append(figure)

    Figure.savefig = recording
    try:
        yield figures
    finally:
        Figure.savefig = savefig


def draw_page(figure, table):
    """The page drawn from that table, and its SVG."""
    with TemporaryDirectory() as folder, record_figures() as pages:
        path = Path(folder) / "table.csv"
        target = Path(folder) / "figure.svg"
        table.to_csv(path, index=False)
        modules()[figure].draw(path, target)
        return pages[0], target.read_bytes()


@cache
def page(figure):
    """What is drawn from `table`."""
    return draw_page(figure, table(figure))


def faults(page):
    """What is wrong with a page: text that is smaller than in a paper, what is beyond it, its width."""
    (width, height) = page.get_size_inches()
    box = page.get_tightbbox()
    texts = [text for text in page.findobj(Text) if text.get_visible() and text.get_text()]
    sentences = [f"small: {text.get_text()}" for text in texts if float(text.get_fontsize()) < 8]
    if min(box.x0, box.y0) < 0 or box.x1 > width or box.y1 > height:
        sentences.append(f"beyond the page: {box}")
    if abs(width - 17 / 2.54) > 1e-6:
        sentences.append(f"width: {width}")
    return sentences


def list_texts(page):
    """What is written in a figure."""
    return [text.get_text() for text in page.findobj(Text) if text.get_visible() and text.get_text()]


def lines(axes, markers=None):
    """The lines in the axes' data, point by point; with or without markers, or all."""
    lines = [line for line in axes.lines if line.get_transform() == axes.transData]
    kept_lines = [line for line in lines if markers in (None, line.get_marker() not in ("None", ""))]
    return [[tuple(p) for p in np.asarray(line.get_xydata()).round(9).tolist()] for line in kept_lines]


def points(axes):
    return {point for line in lines(axes) for point in line}


def pairs(rows, *columns):
    return {tuple(row) for row in rows[list(columns)].dropna().round(9).to_numpy().tolist()}


LEVELS = np.array([0.5, 0.25, 0.125])


def study_errors():
    """Error 10 h + H in all norms, in H^{-1/2} the r.m.s. mean of its bounds, along H = 2 h and H = h.

    beta = 0 at H = h, where only u has an error.
    """
    h = LEVELS[:, None]
    H = np.array([1.0, *LEVELS])[None]
    run = ("case", "mesh", "partition")
    value = np.where((2 * h == H) | (h == H), 10 * h + H, np.nan)[None]
    lambda_curve = np.where(h == H, np.nan, value)
    algorithm = np.where(h == H, "active_set", np.where(2 * h == H, "uzawa", "")).astype(object)[None]
    values = {"h1_error": value, "l2_error": lambda_curve, "algorithm": algorithm}
    values |= {"hm12_error_lower": 0.8 * lambda_curve, "hm12_error_upper": np.sqrt(2 - 0.8**2) * lambda_curve}
    sizes = {"h": ("mesh", LEVELS), "H": ("partition", H[0]), "h_over_H": (("mesh", "partition"), h / H)}
    coords = {"case": ["made_up"], **sizes}
    return xr.Dataset({name: (run, value) for name, value in values.items()}, coords, {"scene": "scene"})
