"""What the figures of beta and of the dual norm are drawn from: tables in long form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
import xarray as xr

from unilateral.errors import InputError
from unilateral.geometry.partition import Partition
from unilateral.norms.dual import Gram
from unilateral.study.tables import error_in

PER_PAIR = ("h_over_H", "edges_per_cell", "cell_over_edge", "smallest_angle", "beta_lower", "beta_upper")


def infsup_frame(surveys: Mapping[str, tuple[str, str, xr.Dataset]]) -> pd.DataFrame:
    """One row per survey, partition and mesh, from (label, kind, table) by name.

    `widest` is the largest beta_upper/beta_lower - 1 of all.
    """
    rows = [
        {"scene": name, "label": label, "kind": kind, "H": float(table["H"][p])}
        | {key: float(table[key][k, p]) for key in PER_PAIR}
        for name, (label, kind, table) in surveys.items()
        for p in range(table.sizes["partition"])
        for k in range(table.sizes["mesh"])
    ]
    frame = pd.DataFrame(rows)
    known = frame["beta_lower"] > 0
    return frame.assign(widest=(frame["beta_upper"] / frame["beta_lower"] - 1)[known].max())


def multiplier_frame(survey: xr.Dataset, h_over_H: Sequence[float]) -> pd.DataFrame:
    """One row per h/H and cell of the survey's first partition: the worst multiplier on it.

    Raises InputError for a ratio that the survey does not have.
    """
    of = survey.isel(partition=0)
    points = of["points"].values
    points = points[np.isfinite(points)]
    frames = []
    for ratio in h_over_H:
        same = np.flatnonzero(np.isclose(of["h_over_H"].values, ratio, rtol=1e-9))
        if not same.size:
            raise InputError(f"survey '{survey.attrs['scene']}' has no mesh with h/H = {ratio:g} to draw")
        k = int(same[0])
        mu = of["worst"].values[k, : len(points) - 1]
        beta = float(0.5 * (of["beta_lower"][k] + of["beta_upper"][k]))
        side = of["side"].values[: len(points) - 1].astype(int)
        cells = {"side": side, "s": points[:-1], "end": points[1:]}
        frames.append(pd.DataFrame({"h_over_H": float(of["h_over_H"][k]), "beta": beta, **cells, "mu": mu}))
    return pd.concat(frames)


def dual_norm_frame(
    errors: xr.Dataset, gram: Gram, partitions: Mapping[int, Partition], h_over_H: float
) -> pd.DataFrame:
    """||.||_{-1/2} with its bounds and the shortcut H^{1/2} ||.||_0: errors at one h/H, mu = 1, mu = +-1.

    `partitions` are those by their number on which the forms are evaluated. Errors that are 0 are left out.
    """
    rows = []
    for case in map(str, errors["case"].values):
        of = errors.sel(case=case)
        bounds = [error_in(of, "hm12", bound).values for bound in ("lower", "upper")]
        for i, j in np.argwhere(np.isclose(of["h_over_H"].values, h_over_H, rtol=1e-9)):
            if bounds[1][i, j] > 1e-12 * float(of["u_norm"][i]):
                lower, upper = (float(bound[i, j]) for bound in bounds)
                rows.append(_row("error", case, of, i, j, lower, upper, float(of["l2_error"][i, j])))
    for j, partition in partitions.items():
        m, p0 = partition.n_cells, gram.on(partition).p0
        for kind, mu in (("one", np.ones(m)), ("alternating", (-1.0) ** np.arange(m))):
            lower, upper = (float(mu @ form @ mu) ** 0.5 for form in p0)
            l2 = float(np.sqrt(partition.lengths @ mu**2))
            rows.append(_row(kind, "", errors, None, j, lower, upper, l2))
    return pd.DataFrame(rows)


def _row(
    kind: str, case: str, of: xr.Dataset, i: int | None, j: int, lower: float, upper: float, l2: float
) -> dict[str, object]:
    H = float(of["H"][j])
    return {
        "kind": kind,
        "case": case,
        "h": np.nan if i is None else float(of["h"][i]),
        "H": H,
        "h_over_H": np.nan if i is None else float(of["h_over_H"][i, j]),
        "lower": lower,
        "upper": upper,
        "mean": float(np.sqrt(0.5 * (lower**2 + upper**2))),
        "gap": upper / lower - 1,
        "shortcut": H**0.5 * l2,
    }
