"""Side by side with other solvers: seconds and memory over unknowns; error over seconds and over memory."""

from __future__ import annotations

import pandas as pd
from matplotlib.ticker import NullLocator

from benchmarks import ratios as judge
from study import style, tables

GREY = "0.55"
SOLVERS: dict[str, tuple[str, style.Look]] = {
    "multigrid": ("this project: multigrid", {"color": style.COLOURS[0], "marker": "o"}),
    "further": ("the same, each further problem", {"color": style.COLOURS[6], "marker": "o"}),
    "recursive newton": ("recursive elimination, active set", {"color": style.COLOURS[2], "marker": "s"}),
    "sparse newton": ("sparse elimination, active set", {"color": style.COLOURS[5], "marker": "D"}),
    "fenicsx": ("FEniCSx, PCMG", {"color": style.COLOURS[1], "marker": "^"}),
    "skfem": ("scikit-fem, PyAMG", {"color": style.COLOURS[3], "marker": "v"}),
    "proximal": ("proximal Galerkin", {"color": style.COLOURS[3], "marker": "<", "ls": style.LINE_STYLES[1]}),
    "ngsolve": ("NGSolve, Cholesky", {"color": style.COLOURS[4], "marker": "P"}),
    "getfem": ("GetFEM ($H=4h$)", {"color": GREY, "marker": "X"}),
}
ALGORITHMS: dict[str, tuple[str, style.Look]] = {
    "uzawa": ("Uzawa", {"ls": style.LINE_STYLES[2]}),
    "nesterov": ("accelerated Uzawa", {"ls": style.LINE_STYLES[1]}),
    "newton": ("active set", {"ls": style.LINE_STYLES[0]}),
}
BY: dict[str, tuple[str, style.Look]] = {
    "sparse": ("sparse elimination", {"color": style.COLOURS[5], "marker": "D"}),
    "recursive": ("recursive elimination", {"color": style.COLOURS[2], "marker": "s"}),
    "multigrid": ("multigrid", {"color": style.COLOURS[0], "marker": "o"}),
}
"""How systems are solved. Uzawa's steps by multigrid are predicted, not run."""
PANELS = {
    "seconds": ("seconds, one core", "unknowns"),
    "memory": ("peak memory in MB", "unknowns"),
    "work": (r"$\Vert u-u_h\Vert_1$", "seconds, over one linear multigrid solve"),
    "space": (r"$\Vert u-u_h\Vert_1$", "peak memory, over that of a linear multigrid solve"),
}
PLACES = ((1.45, 10.3), (9.85, 10.3), (1.45, 2.5), (9.85, 2.5))
ACROSS = 6.9
TALL = 4.6
HEIGHT = 15.6
SHORT = 100
"""An axis whose largest value is less than so many times its least has few powers of 10."""
THIN: style.Look = {"lw": 1.0, "ms": 4.0, "mec": "white", "mew": 0.3}


def table(results: style.FilePath) -> pd.DataFrame:
    """x and y of each line of a panel; `label` is a solver, or an algorithm and how its systems are solved.

    Above: processor seconds from nothing, or for each further problem, and memory, of `natural`. Below: the
    error of u in H1 over both, as ratios to a linear solve from nothing on the finest mesh with errors.
    """
    runs = tables.load_table(results).to_dataframe()
    lines = [line for way in SOLVERS for line in _solver_lines(runs, way)]
    linear = judge.along(runs, judge.LINEAR)
    unit = linear.loc[judge.along(runs, judge.MULTIGRID)["h1_error"].last_valid_index()]
    for system in BY:
        for algorithm in ALGORITHMS:
            levels = _errors(runs, system, algorithm)
            lines.append(
                _line("work", f"{system} {algorithm}", levels["cpu_seconds"] / unit["cpu_seconds"], levels)
            )
        lines.append(_line("space", f"{system} newton", levels["peak_mb"] / unit["peak_mb"], levels))
    return pd.concat(lines, ignore_index=True)


def _solver_lines(runs: pd.DataFrame, way: str) -> list[pd.DataFrame]:
    levels = judge.along(runs, way)
    columns = {"seconds": "cpu_seconds", "memory": "peak_mb"}
    return [
        pd.DataFrame({"panel": panel, "label": way, "x": (levels.index + 1.0) ** 2, "y": levels[column]})
        for panel, column in columns.items()
        if (panel, way) != ("memory", judge.FURTHER)
    ]


def _errors(runs: pd.DataFrame, system: str, algorithm: str) -> pd.DataFrame:
    if system == "multigrid":
        levels = (
            judge.along(runs, judge.MULTIGRID)
            if algorithm == "newton"
            else judge.predict_multigrid_cost(runs, algorithm)
        )
    else:
        levels = judge.along(runs, f"{system} {algorithm}")
    return levels.dropna(subset="h1_error")


def _line(panel: str, label: str, x: pd.Series, levels: pd.DataFrame) -> pd.DataFrame:
    return pd.DataFrame({"panel": panel, "label": label, "x": x, "y": levels["h1_error"]})


def draw(csv_path: style.FilePath, svg_path: style.FilePath) -> None:
    """Columns: panel (seconds, memory, work, space), label, x, y. Raises InputError without the table."""
    data = style.read_figure_table(csv_path)
    with style.open_figure(svg_path, HEIGHT) as figure:
        for (panel, (title, below)), place in zip(PANELS.items(), PLACES, strict=True):
            axes = style.add_axes(figure, *place, ACROSS, TALL)
            for label, line in data[data["panel"] == panel].groupby("label", sort=False):
                style.draw_log_line(axes, line["x"], line["y"], **{**THIN, **_look(panel, str(label))})
            axes.set(title=title, xlabel=below)
            for axis in (axes.xaxis, axes.yaxis):
                low, high = axis.get_view_interval()
                axis.set_minor_locator(NullLocator())
                if high < SHORT * low:
                    style.set_plain_ticks(axis)
        solvers = [style.legend_entry(name, lw=1.0, ms=4.0, **look) for name, look in SOLVERS.values()]
        ways = [style.legend_entry(name, lw=1.0, color=GREY, **look) for name, look in ALGORITHMS.values()]
        ways += [style.legend_entry(name, lw=1.0, ms=4.0, **look) for name, look in BY.values()]
        for handles, top, columns in ((solvers, 9.1, 3), (ways, 1.2, 3)):
            style.add_legend(figure, handles, 1.45, top, ncols=columns, labelspacing=0.4, columnspacing=1.3)


def _look(panel: str, label: str) -> style.Look:
    if panel in ("seconds", "memory"):
        return SOLVERS[label][1]
    system, algorithm = label.split()
    return BY[system][1] | ALGORITHMS[algorithm][1]
