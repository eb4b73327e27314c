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
from unilateral.exchange.boundary_function import has_obstacle, obstacle
from unilateral.exchange.score import Rate, Scored, at_boundary, error_in, sentences, texts, verdict
from unilateral.formulas.expression import ZERO
from unilateral.problems.problem import Problem
from unilateral.solution.plot import svg

TITLES = {"h1": "u in {}", "hm12": "λ in H<sup>−1/2</sup>", "l2": "λ in L²"}
DRAWN = {"h1": "$u$ in {}", "hm12": "$\\lambda$ in $H^{-1/2}$", "l2": "$\\lambda$ in $L^2$"}
NORMS = {True: ("H¹", "$H^1$"), False: ("|·|₁", "$|\\cdot|_1$")}
"""The norm of u in a title of HTML and in one that is drawn, by whether there is a reaction term."""
THEIRS = "tab:red"
OWN = "tab:blue"
EXACT = "0.3"
POINTS = 400
"""The exact values are drawn at this many points of each side."""


def page(case: Problem, scored: Sequence[Scored], rates: dict[str, Rate]) -> str:
    """The page: errors beside this project's own, rates, faults, and the boundary on the finest level."""
    ladder = sorted(scored, key=lambda one: -one.given.level.mesh.h)
    title_norm, drawn_norm = NORMS[case.c != ZERO]
    titles = TITLES | {"h1": TITLES["h1"].format(title_norm)}
    drawn = DRAWN | {"h1": DRAWN["h1"].format(drawn_norm)}
    template = resources.files("unilateral.exchange") / "page.template.html"
    faults = [escape(sentence) for sentence in sentences(scored)]
    return Template(template.read_text(encoding="utf-8")).substitute(
        name=escape(case.name),
        title=escape(case.title),
        polygon=escape(case.polygon.name),
        version=__version__,
        verdict=escape(verdict(scored, rates)),
        faults="".join(["<ul>", *(f"<li>{fault}</li>" for fault in faults), "</ul>"] if faults else []),
        errors=_errors(ladder, titles),
        rates=_rates(rates, titles),
        errors_plot=svg(_errors_drawn(ladder, rates, drawn)),
        boundary_plot=svg(_boundary_drawn(case, ladder[-1])),
        at_boundary=escape(at_boundary(scored)),
        h=f"{ladder[-1].given.level.mesh.h:.4g}",
    )


def _table(head: Iterable[str], rows: Iterable[tuple[str, Iterable[str]]]) -> str:
    """A table in HTML, with a class for each row."""
    lines = [f"<tr>{''.join(f'<th>{each}</th>' for each in head)}</tr>"]
    lines += [f'<tr class="{kind}">{"".join(f"<td>{each}</td>" for each in row)}</tr>' for kind, row in rows]
    return "\n".join(["<table>", *lines, "</table>"])


def _errors(ladder: Sequence[Scored], titles: dict[str, str]) -> str:
    rows = []
    for one in ladder:
        level = one.given.level
        for kind, errors, name in (("theirs", one.errors, level.name), ("own", one.own, "this project")):
            what = one.given.kind if kind == "theirs" else "constant on cells"
            rows.append((kind, [escape(name), f"{level.mesh.h:.4g}", *texts(errors), escape(what)]))
    return _table(["level", "h", *titles.values(), "multiplier"], rows)


def _rates(rates: dict[str, Rate], titles: dict[str, str]) -> str:
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
    return _table(["rate", "observed", "this project", "proved", ""], rows) if rows else ""


def _errors_drawn(ladder: Sequence[Scored], rates: dict[str, Rate], titles: dict[str, str]) -> Figure:
    """A panel per norm in which an error is known: both errors over h, and the proved slope above them."""
    figure = Figure(figsize=(9, 3.4), layout="constrained")
    h = np.array([one.given.level.mesh.h for one in ladder])
    # (2, levels) the errors in each norm, this project's own second
    both = {
        norm: np.array([[error_in(errors, norm) for errors in (one.errors, one.own)] for one in ladder]).T
        for norm in TITLES
    }
    known = [norm for norm in TITLES if np.isfinite(both[norm]).any()]
    for axes, norm in zip(figure.subplots(1, len(known), squeeze=False)[0], known, strict=True):
        axes.set(title=titles[norm], xlabel="h", xscale="log", yscale="log")
        axes.set_xticks(h, [f"{each:.3g}" for each in h])
        axes.set_xticks([], minor=True)
        lines = (("o-", THEIRS, "judged"), ("s--", OWN, "this project"))
        for found, (style, color, label) in zip(both[norm], lines, strict=True):
            if np.isfinite(found).any():
                axes.plot(h, found, style, color=color, label=label)
        above = 1.5 * np.nanmax(both[norm][:, 0], initial=0)
        proved = rates[norm].proved
        if np.isfinite(proved) and above > 0:
            axes.plot(h, above * (h / h[0]) ** proved, ":", color=EXACT, label=f"proved: {proved:g}")
        axes.legend(fontsize="small")
    return figure


def _boundary_drawn(case: Problem, one: Scored) -> Figure:
    """The multiplier, if there is one, and u - g, over arc length beside the exact ones."""
    mu = one.given.multiplier
    mesh = one.given.level.mesh
    figure = Figure(figsize=(9, 5), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True)
    side = np.repeat(np.arange(case.polygon.n_sides), POINTS)
    t = np.tile((np.arange(POINTS) + 0.5) / POINTS, case.polygon.n_sides) * case.polygon.lengths[side]
    s = t + case.polygon.starts[side]
    _, flux, gap = case.known_solution().boundary(side, t)
    of_u = one.given.u[mesh.boundary] - obstacle(case, mesh)
    bottom.plot(mesh.s, np.append(of_u, of_u[0]), color=THEIRS, label="judged")
    bottom.plot(s, np.where(has_obstacle(case, side), gap, np.nan), "--", color=EXACT, label="exact")
    if mu is not None:
        ends = np.column_stack([mu.cells.points[:-1], mu.cells.points[1:]]).ravel()
        top.plot(ends, mu.ends.ravel(), color=THEIRS, label="judged")
        room = 0.1 * max(float(np.ptp(mu.ends)), 1e-12)
        top.set_ylim(float(mu.ends.min()) - room, float(mu.ends.max()) + room)
    top.plot(s, flux, "--", color=EXACT, label="exact")
    _finished(top, case, "λ = ∂u/∂n")
    _finished(bottom, case, "u − g")
    bottom.set(
        xlabel="arc length along the boundary, a line at each vertex", xlim=(0, case.polygon.perimeter)
    )
    return figure


def _finished(axes: Axes, case: Problem, title: str) -> None:
    for start in case.polygon.starts:
        axes.axvline(start, color="0.85", linewidth=0.8, zorder=0)
    axes.set(title=title)
    axes.legend(fontsize="small")
