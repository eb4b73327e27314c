"""What a solution scores, as one page of HTML that needs no network."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from importlib import resources
from string import Template

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from unilateral import __version__
from unilateral.arrays import Array
from unilateral.exchange.boundary_function import has_obstacle, obstacle_at_nodes
from unilateral.exchange.score import (
    Rate,
    ScoredSolution,
    describe_finest_extremes,
    format_errors,
    list_fault_sentences,
    select_error,
    state_verdict,
)
from unilateral.formulas.expression import ZERO
from unilateral.problems.problem import Problem
from unilateral.solution.plot import number_sides, render_svg

HTML_NORM_TITLES = {"h1": "u in {}", "hm12": "λ in H<sup>−1/2</sup>", "l2": "λ in L²"}
PLOT_NORM_TITLES = {"h1": "$u$ in {}", "hm12": "$\\lambda$ in $H^{-1/2}$", "l2": "$\\lambda$ in $L^2$"}
U_NORM_SYMBOLS = {True: ("H¹", "$H^1$"), False: ("|·|₁", "$|\\cdot|_1$")}
"""The norm of u in a title of HTML and in one that is drawn, by whether there is a reaction term."""
JUDGED_COLOUR = "tab:red"
REFERENCE_COLOUR = "tab:blue"
EXACT_COLOUR = "0.3"
EXACT_POINTS_PER_SIDE = 400
"""The exact values are drawn at this many points of each side."""


def render_score_page(
    case: Problem, scored_solutions: Sequence[ScoredSolution], rates: dict[str, Rate]
) -> str:
    """Page with errors beside this project's own, rates, faults, and the boundary on the finest level."""
    ladder = sorted(scored_solutions, key=lambda scored: -scored.solution.level.mesh.h)
    title_norm, drawn_norm = U_NORM_SYMBOLS[case.c != ZERO]
    titles = HTML_NORM_TITLES | {"h1": HTML_NORM_TITLES["h1"].format(title_norm)}
    drawn = PLOT_NORM_TITLES | {"h1": PLOT_NORM_TITLES["h1"].format(drawn_norm)}
    template = resources.files("unilateral.exchange") / "page.template.html"
    faults = [escape(sentence) for sentence in list_fault_sentences(scored_solutions)]
    return Template(template.read_text(encoding="utf-8")).substitute(
        name=escape(case.name),
        title=escape(case.title),
        polygon=escape(case.polygon.name),
        version=__version__,
        verdict=escape(state_verdict(scored_solutions, rates)),
        faults="".join(["<ul>", *(f"<li>{fault}</li>" for fault in faults), "</ul>"] if faults else []),
        errors=_render_error_table(ladder, titles),
        rates=_render_rate_table(rates, titles),
        errors_plot=render_svg(_draw_error_panels(ladder, rates, drawn)),
        boundary_plot=render_svg(_draw_boundary_comparison(case, ladder[-1])),
        at_boundary=escape(describe_finest_extremes(scored_solutions)),
        h=f"{ladder[-1].solution.level.mesh.h:.4g}",
    )


def _render_score_table(head: Iterable[str], rows: Iterable[tuple[str, Iterable[str]]]) -> str:
    """A table in HTML, with a class for each row."""
    lines = [f"<tr>{''.join(f'<th>{title}</th>' for title in head)}</tr>"]
    lines += [f'<tr class="{kind}">{"".join(f"<td>{text}</td>" for text in row)}</tr>' for kind, row in rows]
    return "\n".join(["<table>", *lines, "</table>"])


def _render_error_table(ladder: Sequence[ScoredSolution], titles: dict[str, str]) -> str:
    rows = []
    for scored in ladder:
        level = scored.solution.level
        for kind, errors, name in (
            ("theirs", scored.errors, level.name),
            ("own", scored.reference_errors, "this project"),
        ):
            multiplier_kind = scored.solution.multiplier_kind if kind == "theirs" else "constant on cells"
            rows.append(
                (kind, [escape(name), f"{level.mesh.h:.4g}", *format_errors(errors), escape(multiplier_kind)])
            )
    return _render_score_table(["level", "h", *titles.values(), "multiplier"], rows)


def _render_rate_table(rates: dict[str, Rate], titles: dict[str, str]) -> str:
    rows = [
        (
            "rate",
            [
                titles[norm],
                f"{rate.observed:.2f}",
                f"{rate.own:.2f}",
                "-" if np.isnan(rate.proved) else f"{rate.proved:g}",
                rate.verdict,
            ],
        )
        for norm, rate in rates.items()
        if rate.pairs
    ]
    return _render_score_table(["rate", "observed", "this project", "proved", ""], rows) if rows else ""


def _draw_error_panels(
    ladder: Sequence[ScoredSolution], rates: dict[str, Rate], titles: dict[str, str]
) -> Figure:
    """A panel per norm in which an error is known: both errors over h, and the proved slope above them."""
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    h = np.array([scored.solution.level.mesh.h for scored in ladder])
    # (2, levels) the errors in each norm: of the judged solutions, and of this project's
    errors_by_norm = {
        norm: np.array(
            [
                [select_error(errors, norm) for errors in (scored.errors, scored.reference_errors)]
                for scored in ladder
            ]
        ).T
        for norm in HTML_NORM_TITLES
    }
    norms = [norm for norm in HTML_NORM_TITLES if np.isfinite(errors_by_norm[norm]).any()]
    for axes, norm in zip(figure.subplots(1, len(norms), squeeze=False)[0], norms, strict=True):
        axes.set(title=titles[norm], xlabel="h", xscale="log", yscale="log")
        _draw_errors(axes, h, errors_by_norm[norm], rates[norm].proved)
    return figure


def _draw_errors(axes: Axes, h: Array, errors: Array, proved: float) -> None:
    """Draw the judged errors and this project's, `errors` (2, levels), and the proved slope, if not NaN."""
    axes.set_xticks(h, [f"{size:.3g}" for size in h])
    axes.set_xticks([], minor=True)
    lines = (("o-", JUDGED_COLOUR, "judged"), ("s--", REFERENCE_COLOUR, "this project"))
    for values, (style, color, label) in zip(errors, lines, strict=True):
        if np.isfinite(values).any():
            axes.plot(h, values, style, color=color, label=label)
    # C h^rate, a little above both errors on the coarsest level
    line_start = 1.5 * np.nanmax(errors[:, 0], initial=0)
    if np.isfinite(proved) and line_start > 0:
        axes.plot(h, line_start * (h / h[0]) ** proved, ":", color=EXACT_COLOUR, label=f"proved: {proved:g}")
    axes.legend(fontsize="small")


def _draw_boundary_comparison(case: Problem, scored_solution: ScoredSolution) -> Figure:
    """The multiplier, if there is one, and u - g, over arc length beside the exact ones."""
    mu = scored_solution.solution.multiplier
    mesh = scored_solution.solution.level.mesh
    figure = Figure(figsize=(9, 5), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True)
    side = np.repeat(np.arange(case.polygon.n_sides), EXACT_POINTS_PER_SIDE)
    t = (
        np.tile((np.arange(EXACT_POINTS_PER_SIDE) + 0.5) / EXACT_POINTS_PER_SIDE, case.polygon.n_sides)
        * case.polygon.lengths[side]
    )
    s = t + case.polygon.starts[side]
    _, flux, gap = case.known_solution().trace_flux_and_gap(side, t)
    judged_gap = scored_solution.solution.u[mesh.boundary] - obstacle_at_nodes(case, mesh)
    bottom.plot(mesh.s, np.append(judged_gap, judged_gap[0]), color=JUDGED_COLOUR, label="judged")
    bottom.plot(s, np.where(has_obstacle(case, side), gap, np.nan), "--", color=EXACT_COLOUR, label="exact")
    if mu is not None:
        ends = np.column_stack([mu.partition.points[:-1], mu.partition.points[1:]]).ravel()
        top.plot(ends, mu.end_values.ravel(), color=JUDGED_COLOUR, label="judged")
        # limits of the judged multiplier, as the exact one may be infinite at a vertex
        margin = 0.1 * max(float(np.ptp(mu.end_values)), 1e-12)
        top.set_ylim(float(mu.end_values.min()) - margin, float(mu.end_values.max()) + margin)
    top.plot(s, flux, "--", color=EXACT_COLOUR, label="exact")
    _finish_boundary_axes(top, case, "λ = ∂u/∂n")
    number_sides(top, case.polygon)
    _finish_boundary_axes(bottom, case, "u − g")
    bottom.set(
        xlabel="arc length along the boundary, a line at each vertex", xlim=(0, case.polygon.perimeter)
    )
    return figure


def _finish_boundary_axes(axes: Axes, case: Problem, title: str) -> None:
    for start in case.polygon.starts:
        axes.axvline(start, color="0.85", linewidth=0.8, zorder=0)
    axes.set(title=title)
    axes.legend(fontsize="small")
