"""Made-up tables to draw figures from, mostly of no law, so that no number follows from others."""

from collections.abc import Callable
from importlib import import_module
from itertools import product
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from unilateral.study.figures.extremes import KINDS as OUTCOMES
from unilateral.study.figures.verdict import KINDS as VERDICTS

NORMS = ("h1", "hm12", "l2")
LEVELS = np.array([0.5, 0.25, 0.125])
PROVED = {"h1": 1.0, "hm12": 1.0, "l2": 0.5}


def rates_table():
    """Two cases on three levels at two ratios; no_contact's multiplier is exact. The rates fit no error."""
    rows = [
        {
            "scene": "square",
            "case": case,
            "norm": norm,
            "h_over_H": ratio,
            "h": h,
            "H": h / ratio,
            "error": 0.0 if case == "no_contact" and norm != "h1" else h**1.2,
            "asymptotic": int(h < 0.1),
            "rate": np.nan if case == "no_contact" and norm != "h1" else 7.77,
            "proved": PROVED[norm],
            "expected": 3.33,
        }
        for case, norm, ratio, h in product(
            ("natural", "no_contact"), NORMS, (0.5, 0.25), (1 / 8, 1 / 16, 1 / 32)
        )
    ]
    return pd.DataFrame(rows)


def grid_table():
    """beta = 0 from h = H on, where only u_h has an error; h = 1/8 with H = 1/32 is not computed."""
    rows = []
    for case, norm, h, H in product(
        ("natural", "smooth"), NORMS, (1 / 8, 1 / 16), (1 / 4, 1 / 8, 1 / 16, 1 / 32)
    ):
        zero = h / H in (1, 2)
        known = h / H <= 2 and (norm == "h1" or not zero)
        error = 0.0123 * h + H**2 if known else np.nan
        rows.append([case, norm, h, H, h / H, error, int(zero)])
    return pd.DataFrame(rows, columns=["case", "norm", "h", "H", "h_over_H", "error", "beta_zero"])


def mesh_table():
    """The unit square in two triangles."""
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]], dtype=float)
    return pd.DataFrame(
        {
            "h": 1.0,
            "H": 2.0,
            "triangle": np.repeat([0, 1], 3),
            "x": corners[:, 0],
            "y": corners[:, 1],
            "u_h": corners @ [1.0, 2.0],
        }
    )


def boundary_table():
    """Contact on the second half of side 0 and on side 1, one cell per half side."""
    columns = ["kind", "side", "s", "end", "computed", "exact", "contact", "x", "y"]
    vertices = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], dtype=float)
    rows = []
    for side, t in product(range(4), (0.0, 0.5, 1.0)):
        s, (x, y) = side + t, vertices[side] + t * (vertices[side + 1] - vertices[side])
        touching = 0.5 <= s <= 2
        rows.append(["trace", side, s, None, 0.01 * s, 0.0 if touching else 0.1, int(touching), x, y])
        rows.append(["flux", side, s, None, None, float(touching), None, None, None])
        if t < 1:
            rows.append(["multiplier", side, s, s + 0.5, 0.9 * touching, None, None, None, None])
    return pd.DataFrame(rows, columns=columns)


def infsup_table():
    """Two uniform lines, at two H each, of beta = 1 - h/H; markers of no such law; bounds 2 % apart."""
    rows = []
    for label, H, ratio in product(("square", "L-shape"), (1 / 8, 1 / 16), (2.0, 1.0, 0.5, 0.25)):
        beta = max(1 - ratio, 0) * (1 if label == "square" else 0.9)
        rows.append(["a scene", label, "uniform", H, ratio, 1 / ratio, beta, 1.02 * beta])
    for label, ratio, edges in (("graded", 5.0, 2.0), ("graded", 3.0, 4.0), ("shifted", 0.5, 1.6)):
        rows.append(["graded", label, "local", 1 / 8, ratio, edges, 0.7, 0.714])
    rows.append(["worst", "nested", "worst", 1 / 8, 0.7, 2.5, 0.123, 0.12546])
    columns = ["scene", "label", "kind", "H", "h_over_H", "edges_per_cell", "beta_lower", "beta_upper"]
    return pd.DataFrame(rows, columns=columns)


def multiplier_table():
    """Two cells a side; the values do not alternate."""
    cells = [(ratio, beta, i) for ratio, beta in ((1.0, 0.0), (0.8, 0.5494)) for i in range(8)]
    rows = [[ratio, beta, i // 2, i / 2, (i + 1) / 2, np.cos(i) * ratio] for ratio, beta, i in cells]
    return pd.DataFrame(rows, columns=["h_over_H", "beta", "side", "s", "end", "mu"])


def dual_norm_table():
    """Mean, gap and shortcut that do not follow from the bounds: nothing is computed in the figure."""
    names = (("error", "natural"), ("error", "thirds"), ("error", "smooth"), ("one", ""), ("alternating", ""))
    rows = [
        [kind, case, H / 2, H, 0.5, i * H, 2 * i * H, 1.7 * i * H, 0.01 * i, 3 * i * H**0.5]
        for (i, (kind, case)), H in product(enumerate(names, start=1), (1 / 4, 1 / 8, 1 / 16))
    ]
    columns = ["kind", "case", "h", "H", "h_over_H", "lower", "upper", "mean", "gap", "shortcut"]
    return pd.DataFrame(rows, columns=columns)


TERMS = {"lambda_mean": [0, 0.3, 0.7, 0.2], "gap_mean": [0.4, 0.1, 0, 0.5], "term": [0, 3e-5, 0, 2e-8]}
"""Of four cells."""


def consistency_table():
    """Terms of no law, so that none follows from others; theta alternates."""
    cells = pd.DataFrame({"s": np.arange(4) / 4, "end": np.arange(1, 5) / 4} | TERMS)
    rows = []
    for i, case in enumerate(("steep", "flat")):
        for k, H in enumerate((0.25, 0.125, 0.0625)):
            same = {"case": case, "H": H, "theta": (k % 2 + 1) / 3, "rate": 3 - i}
            terms = {"total": 0.01 * H**2 * (i + 1.1), "elsewhere": 0.0, "predicted": 0.013 * H ** (2.5 - i)}
            rows += [{"kind": kind, **same, "term": x, "over_H2": 7 * x} for kind, x in terms.items()]
    return pd.concat([cells.assign(kind="cell", case="steep", H=0.25), pd.DataFrame(rows)])


def sharpness_table():
    """Two gammas, of which (jj) holds for one; rates of no law, so that none follows from others."""
    rows = []
    for i, norm in enumerate((*NORMS, "consistency")):
        for alpha, gamma in product((-0.25, 0.5, 1.75), (0.5, 1.5)):
            rate = 0.7 + 0.1 * i + 0.2 * alpha + 0.01 * gamma
            rows.append(["measured", norm, alpha, gamma, rate, rate - 0.05 * gamma, int(gamma > 1)])
        for kind, gamma, shift in (("predicted", np.nan, 0.03), ("left", 0.5, -0.04), ("left", 1.5, 0.0)):
            rows += [[kind, norm, a, gamma, 0.8 + 0.11 * a + shift, np.nan, np.nan] for a in (-0.25, 1.75)]
        rows += [["proved", norm, a, np.nan, 0.81, np.nan, np.nan] for a in (0.0, 1.75)]
        rows.append(["attained", norm, 0.0, np.nan, 0.81, np.nan, np.nan])
    return pd.DataFrame(rows, columns=["kind", "norm", "alpha", "gamma", "rate", "before", "jj"])


def extremes_table():
    """An axis downwards with two limits, one upwards without; all kinds, and two points near each other."""
    down = [
        ["size", kind, -1.5 * k, -2.0, -4.0] for k, kind in enumerate(["right", "right", *list(OUTCOMES)[1:]])
    ]
    up = [["rho", "right", x, np.nan, np.nan] for x in (-0.3, -0.0004, 0.0004, 0.3)]
    return pd.DataFrame(
        down + up, columns=["label", "kind", "log10_value", "log10_limit", "log10_tool_limit"]
    )


def verdict_table():
    """A claim of each kind."""
    return pd.DataFrame(
        {"label": f"4.{k}", "kind": kind, "margin": 0.1 * (k + 1)} for k, kind in enumerate(VERDICTS)
    )


def work_precision_table():
    """A row of each kind per norm, ratio and work, and of each algorithm and H."""
    rows = []
    for kind, norm in product(("front", "line", "stop", "step"), ("h1", "hm12", "l2")):
        for ratio, work in product((1.0, 2.0), (1e3, 1e5)):
            place = {"kind": kind, "norm": norm, "label": "S", "H_over_h": ratio, "stop": 10**-ratio}
            values = {"work": work * ratio, "error": 1 / work, "excess": 1 + ratio, "unknowns": work}
            rows.append({**place, **values, "h": ratio})
    for name, H in product(("uzawa", "newton"), (0.25, 0.125)):
        rows.append({"kind": "steps", "label": name, "H": H, "steps": 1 / H, "slope": 1.0})
    return pd.DataFrame(rows)


def study_errors():
    """Error 10 h + H in all norms, in H^{-1/2} the r.m.s. mean of its bounds, along H = 2 h and H = h.

    beta = 0 at H = h, where only u has an error.
    """
    h, H = LEVELS[:, None], np.array([1.0, *LEVELS])[None]
    run = ("case", "mesh", "partition")
    value = np.where((2 * h == H) | (h == H), 10 * h + H, np.nan)[None]
    of_lambda = np.where(h == H, np.nan, value)
    algorithm = np.where(h == H, "active_set", np.where(2 * h == H, "uzawa", "")).astype(object)[None]
    return xr.Dataset(
        {
            "h1_error": (run, value),
            "hm12_error_lower": (run, 0.8 * of_lambda),
            "hm12_error_upper": (run, np.sqrt(2 - 0.8**2) * of_lambda),
            "l2_error": (run, of_lambda),
            "algorithm": (run, algorithm),
        },
        coords={
            "case": ["made_up"],
            "h": ("mesh", LEVELS),
            "H": ("partition", H[0]),
            "h_over_H": (("mesh", "partition"), h / H),
        },
        attrs={"scene": "scene"},
    )


def study_rates():
    """Rates along H = 2 h, of which the finest pair is asymptotic."""
    index, pairs = ("case", "norm", "h_over_H"), ("case", "norm", "h_over_H", "pair")
    shape = (1, 3, 1)
    return xr.Dataset(
        {
            name: (index, np.full(shape, value))
            for name, value in (("fitted", 0.9), ("proved", 1.0), ("expected", 1.5))
        }
        | {
            "h_coarse": (pairs, np.broadcast_to(LEVELS[:2], (*shape, 2))),
            "h_fine": (pairs, np.broadcast_to(LEVELS[1:], (*shape, 2))),
            "asymptotic": (pairs, np.broadcast_to([0.0, 1.0], (*shape, 2))),
        },
        coords={"case": ["made_up"], "norm": ["h1", "hm12", "l2"], "h_over_H": [0.5]},
    )


def points(axes):
    """Of the lines and markers, without those in the axes' own coordinates."""
    lines = [line for line in axes.lines if line.get_transform() == axes.transData]
    return {tuple(point) for line in lines for point in np.asarray(line.get_xydata()).round(9).tolist()}


def pairs(table, x, y):
    return {tuple(pair) for pair in table[[x, y]].round(9).to_numpy().tolist()}


class Example(NamedTuple):
    """Made-up tables by their files' names, and a column of numbers of the first whose change is seen."""

    tables: dict[str, Callable[[], pd.DataFrame]]
    seen: str


EXAMPLES = {
    "consistency": Example({"consistency.csv": consistency_table}, "term"),
    "dual_norm": Example({"dual_norm.csv": dual_norm_table}, "mean"),
    "extremes": Example({"extremes.csv": extremes_table}, "log10_value"),
    "grid": Example({"grid.csv": grid_table}, "error"),
    "infsup": Example({"infsup.csv": infsup_table}, "beta_lower"),
    "multiplier": Example({"multiplier.csv": multiplier_table}, "mu"),
    "portrait": Example({"mesh.csv": mesh_table, "boundary.csv": boundary_table}, "u_h"),
    "rates": Example({"rates.csv": rates_table}, "error"),
    "sharpness": Example({"sharpness.csv": sharpness_table}, "before"),
    "verdict": Example({"verdict.csv": verdict_table}, "margin"),
    "work_precision": Example({"work_precision.csv": work_precision_table}, "error"),
}


def write(figure, folder, **changed):
    """The figure's tables, or others in the place of those of these names."""
    for name, table in EXAMPLES[figure].tables.items():
        stem = name.removesuffix(".csv")
        (changed[stem] if stem in changed else table()).to_csv(folder / name, index=False)


def draw(figure, folder, target="figure.svg"):
    """The figure from the tables in the folder."""
    module = import_module(f"unilateral.study.figures.{figure}")
    module.draw(*(folder / name for name in EXAMPLES[figure].tables), folder / target)
    return (folder / target).read_bytes()


def drawn_from(figure, folder, **changed):
    write(figure, folder, **changed)
    return draw(figure, folder)
