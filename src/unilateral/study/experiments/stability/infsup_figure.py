"""The inf-sup constant over h/H, and over delta of Theorem 5: how far inside its cell a mesh node lies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator, NullLocator

from unilateral.formulas.decimals import up
from unilateral.study import style, tables

PER_PAIR = [
    "h_over_H",
    "edges_per_cell",
    "cell_over_edge",
    "smallest_angle",
    "delta",
    "alpha_1",
    "beta_lower",
    "beta_upper",
]
PLACES = {"uniform": (1.25, 5.35, 0.1), "local": (7.3, 4.55, 6.95), "worst": (12.3, 4.55, 11.95)}
"""The left ends of the axes, their widths, and the left ends of the keys, by kind, in cm."""
TITLES = {"uniform": "uniform meshes", "local": "graded, shifted, random", "worst": "from a search"}
UNIFORM_COLOURS = tuple(colour for i, colour in enumerate(style.COLOURS) if i != 1)
WORST_MARKERS = ("x", "+", (6, 2, 0), "1", "2", "3")
BACKGROUND: style.Look = {"color": "0.72", "lw": 1.0, "zorder": 1.5}
LOOKS: dict[str, style.Look] = {
    "uniform": {"ms": 4.2, "mew": 0.5, "lw": 1.1, "mec": "white"},
    "local": {"ms": 4.2, "mew": 0.8, "ls": "", "color": "0.15", "mfc": "white"},
    "worst": {
        "ms": 6.5,
        "mew": 1.7,
        "ls": "",
        "color": style.COLOURS[1],
        "zorder": 5,
        "path_effects": [withStroke(linewidth=3.2, foreground="white")],
    },
}
LAST = 1.3
UNSEEN = 1e-3


def table(surveys: Sequence[style.FilePath], families: Mapping[str, Mapping[str, Any]]) -> pd.DataFrame:
    """One row per survey, partition and mesh; `families` have the label and kind of each survey, by name.

    `widest` is the largest beta_upper/beta_lower - 1 of all.
    """
    parts = [
        tables.load(path)[PER_PAIR]
        .to_dataframe(["partition", "mesh"])
        .assign(scene=name, label=family["label"], kind=family["kind"])
        for (name, family), path in zip(families.items(), surveys, strict=True)
    ]
    rows = pd.concat(parts)[["scene", "label", "kind", "H", *PER_PAIR]]
    known = rows["beta_lower"] > 0
    return rows.assign(widest=(rows["beta_upper"] / rows["beta_lower"] - 1)[known].max())


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """beta of uniform meshes over h/H; beta of all over h/H, and over delta.

    Columns: scene, label (a line or a marker each), kind (uniform, local, worst), H, h_over_H,
    delta (the smallest over the cells), beta_lower, beta_upper; and, for the note, widest (largest
    beta_upper/beta_lower - 1), if known.
    """
    data = style.read(csv_path)
    looks = {kind: _looks(kind, data) for kind in TITLES}
    data = data.sort_values("h_over_H", kind="stable")
    rows = max(len(looks["uniform"]), len(looks["local"]) + 1, len(looks["worst"]))
    bottom = 2.45 + 0.44 * rows
    with style.figure_in(svg_path, bottom + 5.85) as figure:
        panels = (style.axes_at(figure, x, bottom, width, 5.2) for x, width, _ in PLACES.values())
        uniform, ratio, inner = panels
        _uniform(uniform, data, looks["uniform"])
        for axes, x in ((ratio, "h_over_H"), (inner, "delta")):
            _all_kinds(axes, data, looks, x)
        _ratio_axis(uniform, data[data["kind"] == "uniform"])
        _delta_axis(inner)
        _log_axis(ratio, data["h_over_H"])
        uniform.set(title="uniform meshes", xlabel="$h/H$", ylabel=r"$\beta$")
        ratio.set(title="all, over the global ratio", xlabel="$h/H$")
        inner.set(title=r"all, over $\delta$ of Theorem 5", xlabel=r"$\delta$")
        for kind, (_, _, left) in PLACES.items():
            handles = [style.key(label, **look) for label, look in looks[kind].items()]
            if kind == "local":
                handles.append(style.key("uniform, as on the left", **BACKGROUND))
            of_kind: style.Look = {"title": TITLES[kind], "title_fontsize": 9.5, "alignment": "left"}
            style.legend(figure, handles, left, bottom - 1.3, handlelength=1.8, labelspacing=0.42, **of_kind)
        style.note(figure, _note(data))


def _looks(kind: str, data: pd.DataFrame) -> dict[str, style.Look]:
    """How the labels of a kind look, in the order of the table."""
    markers = WORST_MARKERS if kind == "worst" else style.MARKERS
    looks = {}
    for i, label in enumerate(data.loc[data["kind"] == kind, "label"].unique()):
        looks[str(label)] = {**LOOKS[kind], "marker": markers[i % len(markers)]}
        if kind == "uniform":
            looks[str(label)]["color"] = UNIFORM_COLOURS[i % len(UNIFORM_COLOURS)]
    return looks


def _uniform(axes: Axes, data: pd.DataFrame, looks: dict[str, style.Look]) -> None:
    """A line per scene and H at the lower bounds, and a band up to the upper ones."""
    for label, look in looks.items():
        for _, line in data[(data["kind"] == "uniform") & (data["label"] == label)].groupby("H"):
            bounds = line["beta_lower"], line["beta_upper"]
            axes.fill_between(line["h_over_H"], *bounds, color=look["color"], alpha=0.35, lw=0)
            axes.plot(line["h_over_H"], line["beta_lower"], **look)


def _all_kinds(axes: Axes, data: pd.DataFrame, looks: dict[str, dict[str, style.Look]], x: str) -> None:
    """The other kinds as markers at the lower bounds, with bars up to the upper ones, over uniform lines."""
    uniform = data[data["kind"] == "uniform"].sort_values(x, kind="stable")
    for _, line in uniform.groupby(["label", "H"], sort=False):
        axes.plot(line[x], line["beta_lower"], **BACKGROUND)
    for kind in ("local", "worst"):
        for label, look in looks[kind].items():
            rows = data[(data["kind"] == kind) & (data["label"] == label)]
            axes.vlines(rows[x], rows["beta_lower"], rows["beta_upper"], color=look["color"], lw=0.8)
            axes.plot(rows[x], rows["beta_lower"], **look)
    axes.tick_params(labelleft=False)


def _ratio_axis(axes: Axes, rows: pd.DataFrame) -> None:
    """h/H from 0 to a little over 1, if all that lies beyond is 0."""
    x = "h_over_H"
    beyond = rows[rows[x] > LAST]
    cut = (beyond["beta_upper"] < UNSEEN).all()
    axes.set_xlim(0, LAST if cut else 1.05 * rows[x].max())
    axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2.5, 5, 10]))
    axes.xaxis.set_major_formatter(lambda value, _: f"${Fraction(value).limit_denominator(8)}$")
    _beta_axis(axes)
    if cut and len(beyond):
        text = f"$0$ up\nto ${style.as_fraction(beyond[x].max())}$"
        axes.text(LAST - 0.03, 0.1, text, ha="right", va="bottom", fontsize=style.SMALL)
        arrow = {"arrowstyle": "-|>", "lw": 0.8, "color": "black", "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", (LAST - 0.02, 0.06), (LAST - 0.22, 0.06), arrowprops=arrow)


def _delta_axis(axes: Axes) -> None:
    """The axis of delta from 0 to 1/2, with the bound of claim T.node."""
    delta = np.linspace(0, 0.5)
    axes.plot(delta, 2 * delta * (1 - delta), color="0.25", lw=0.8, ls=(0, (4, 2)), zorder=1)
    axes.text(0.24, 0.29, r"$2\delta(1-\delta)$", ha="left", va="top", fontsize=style.SMALL)
    axes.set_xlim(-0.012, 0.512)
    _beta_axis(axes)


def _log_axis(axes: Axes, x: pd.Series) -> None:
    axes.set_xscale("log", base=2)
    axes.set_xlim(x.min() / 1.2, x.max() * 1.2)
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(lambda value, _: f"${style.as_fraction(value)}$")
    axes.axvline(1, color="0.25", lw=0.8, ls=(0, (4, 2)), zorder=1)
    _beta_axis(axes)


def _beta_axis(axes: Axes) -> None:
    axes.set_ylim(-0.03, 1.03)
    style.light_grid(axes)


def _note(data: pd.DataFrame) -> str:
    sizes = data.loc[data["kind"] == "uniform", "H"]
    ends = dict.fromkeys(f"${style.as_fraction(size)}$" for size in (sizes.min(), sizes.max()))
    note = f"Uniform meshes: $H$ = {' to '.join(ends)}."
    note += r" Markers: guaranteed lower bounds on $\beta$; bars reach up to the upper bounds"
    if "widest" in data:
        note += f", at most {up(100 * data['widest'].max(), '.2g')} % higher"
    return note + "."
