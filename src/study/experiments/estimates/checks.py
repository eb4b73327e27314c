"""Checks of section 4: Lemmas 4.2 to 4.4, and the steps of Theorem 4.1."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import xarray as xr
from scipy.linalg import cholesky, eigvalsh, solve_triangular
from scipy.optimize import nnls

from study.evidence import Evidence, Tables, dual_norm_forms, pick_worst
from study.stability_constants import lemma_quotients
from study.tables import ZERO_ERROR_SHARE
from unilateral.arrays import Array
from unilateral.geometry.partition import Partition
from unilateral.norms.dual import Gram


def projection(
    tables: Tables, scenes: Sequence[str], expected: Mapping[str, float], coarsest: float, tolerance: float
) -> Evidence:
    """The least excess, over the expected rate of a case, of the rates of ||lambda - Pi_H lambda||_{-1/2}.

    The rates are over factors of 4.
    """
    excess = {}
    for scene in scenes:
        norms = [gram for cells, gram in dual_norm_forms(tables, scene) if coarsest >= cells.H]
        names = list(tables[f"{scene}/dual_norm"]["case"].values)
        for case in sorted(set(expected) & set(names)):
            # lambda - Pi_H lambda is the error of the multiplier with the means of lambda: a difference of 0
            bounds = [gram.error_bounds(names.index(case), np.zeros((1, gram.n_cells))) for gram in norms]
            errors = np.sqrt(np.mean(np.square(bounds), axis=1)).ravel()
            rates = np.log(errors[:-2] / errors[2:]) / np.log(4)
            excess[f"{scene}, {case}"] = float(rates.min()) - expected[case]
    quantity = f"the rate over a factor of 4, from $H = {coarsest:g}$ on, less the expected one"
    return pick_worst(excess, quantity, -tolerance, True)


def abstract_bound(tables: Tables, scenes: Sequence[str], cases: Sequence[str]) -> Evidence:
    """||u-u_h||^2 over the right side of (4.5), by Cauchy and Schwarz, for v = z_h and mu = Pi_H lambda."""
    quotients = {}
    for scene in scenes:
        table = tables[f"{scene}/errors"]
        names = list(tables[f"{scene}/dual_norm"]["case"].values)
        for k, (cells, gram) in enumerate(dual_norm_forms(tables, scene)):
            data = table.isel(partition=k)
            assert np.isclose(float(data["H"]), cells.H)
            for case in sorted(set(cases) & set(names)):
                run = data.sel(case=case)
                E = run["h1_error"].values
                L = run["hm12_error_upper"].values
                # (4.5): E^2 <= (E + L) ||u - z_h||_1 + m E + <Pi_H lambda, u - g>, m = ||lambda - mu||_{-1/2}
                m = gram.error_bounds(names.index(case), np.zeros((1, gram.n_cells))).upper[0]
                right_side = (E + L) * run["ritz_error"].values + m * E + float(run["consistency"])
                ratio = (E**2 / right_side)[np.isfinite(L)]
                if ratio.size:
                    quotients[f"{scene}, {case}, H = {cells.H:g}"] = float(ratio.max())
    return pick_worst(quotients, "the left side over the right one", 1.0, False)


def lemma_4_3(tables: Tables, scenes: Sequence[str]) -> Evidence:
    """The left side of (4.6) over the right one, with the proof's constants; see `lemma_quotients`."""
    lemmas = {scene: lemma_quotients(tables[f"{scene}/errors"]) for scene in scenes}
    quotients = {scene: float(table["lemma_4_3"].max()) for scene, table in lemmas.items()}
    return pick_worst(quotients, "the left side over the right one", 1.0, False)


def l2_estimate(tables: Tables, scenes: Sequence[str]) -> Evidence:
    """The left side of (4.7) over the right one, for mu = Pi_H lambda.

    The constants are those of its proof, 1 and C of (4.9). Everything on the right is taken from below. The
    lines have the c of (4.7) as printed.
    """
    quotients = {}
    as_printed = []
    for name, data, cells, gram in _iterate_partitions(tables, scenes):
        dual = (data["hm12_error_lower"] + data["projection_lower"]) / np.sqrt(cells.H)
        # (4.7): ||lambda - lambda_H||_0 <= ||lambda - mu||_0
        #        + C H^{-1/2} (||lambda - lambda_H||_{-1/2} + ||lambda - mu||_{-1/2})
        left_side = data["l2_error"].where(data["l2_error"] > ZERO_ERROR_SHARE * data["u_norm"])
        right_side = data["projection_error"] + inverse_constant(cells, gram.p0.upper) * dual
        if left_side.notnull().any():
            quotients[name] = float((left_side / right_side).max())
            c = float((left_side / (data["projection_error"] + dual)).max())
            as_printed.append(f"  {name}: c = {c:.4g}")
    return pick_worst(quotients, "the left side over the right one", 1.0, False)._replace(lines=as_printed)


def inverse_constant(cells: Partition, form: Array) -> float:
    """The least C of (4.9), ||mu||_0 <= C H^{-1/2} ||mu||_{-1/2} on P0(T_H), by a form (m, m) of the norm."""
    # H ||mu||_0^2 = |root mu|^2, and so C^-2 is the least eigenvalue of the form in the unknowns root mu
    root = np.sqrt(cells.H * cells.lengths)
    scaled = form / root[:, None] / root
    return float(eigvalsh(scaled, subset_by_index=[0, 0])[0] ** -0.5)


def _iterate_partitions(
    tables: Tables, scenes: Sequence[str]
) -> Iterator[tuple[str, xr.Dataset, Partition, Gram]]:
    """Each partition: name, errors with lower bounds on ||lambda - Pi_H lambda||_{-1/2}, cells, forms."""
    for scene in scenes:
        names = tables[f"{scene}/dual_norm"]["case"].values
        for k, (cells, gram) in enumerate(dual_norm_forms(tables, scene)):
            data = tables[f"{scene}/errors"].isel(partition=k).sel(case=names)
            lower = np.sqrt(np.diag(gram.lower)[gram.n_cells :])
            yield f"{scene}, H = {cells.H:g}", data.assign(projection_lower=("case", lower)), cells, gram


def quasi_optimality(tables: Tables, scenes: Sequence[str], max_cells: int) -> Evidence:
    """The left side of (4.10) over the right one, with c = 1 + 3/beta^2.

    The infima are over v_h and over one mu_H in Lambda_H. The error splits into a = ||u - z_h||_1 and D with
    D^2 <= m D + (m + D) a/beta + c for every mu_H, so that D^2 <= 3 m^2 + 3 a^2/beta^2 + 2 c, where m and c
    are the two terms of the infimum. beta is taken from above, the infimum from below, on partitions of up to
    so many cells. The lines are the constants that were needed.
    """
    quotients = {}
    needed = []
    for name, data, cells, gram in _iterate_partitions(tables, scenes):
        if gram.n_cells <= max_cells and (data["beta_upper"] > 0).any():
            beta = data["beta_upper"].where(data["beta_upper"] > 0)
            infimum = xr.DataArray(
                infima_over_multipliers(tables[f"{name.split(',')[0]}/dual_norm"], cells, gram), dims="case"
            )
            c = (data["h1_error"] ** 2 / (data["ritz_error"] ** 2 + infimum)).where(beta > 0)
            quotients[name] = float((c / (1 + 3 / beta**2)).max())
            needed.append(f"  {name}: c = {float(c.max()):.4g}")
    return pick_worst(quotients, "the left side over the right one", 1.0, False)._replace(lines=needed)


def infima_over_multipliers(table: xr.Dataset, cells: Partition, gram: Gram) -> Array:
    """Lower bounds (c,) on inf ||lambda - mu||_{-1/2}^2 + <mu, u - g> over mu in Lambda_H, for every case.

    Each is a least-squares problem with mu >= 0, solved by the algorithm of Lawson and Hanson (1974); `table`
    has the gaps on a finer partition.
    """
    m = gram.n_cells
    G = gram.p0.lower
    points = table["points"].values
    gaps = table["gap_means"].values * np.diff(points)
    cell_of_point = cells.cells_of(points)
    root = cholesky(G)
    infima = []
    for c, (means, gap) in enumerate(zip(gram.means, gaps, strict=True)):
        mixed = gram.lower[:m, m + c]
        weight = np.bincount(cell_of_point, gap, m)
        # With G = R^T R and x = Pi_H lambda - mu: |R mu - R^{-T} (G means + mixed - weight / 2)|^2 + constant
        mu = nnls(root, solve_triangular(root, G @ means + mixed - weight / 2, trans="T"))[0]
        x = means - mu
        infima.append(x @ (G @ x) + 2 * x @ mixed + gram.lower[m + c, m + c] + weight @ mu)
    return np.array(infima)


def closed_form(tables: Tables, scene: str) -> Evidence:
    """The norm ||1||_{-1/2} of the unit square, (8 + 4 coth(1/2))^{1/2}, against both bounds on it."""
    gram = Gram.from_table(tables[f"{scene}/dual_norm"])
    mu = np.ones(gram.n_cells)
    exact = np.sqrt(8 + 4 / np.tanh(0.5))  # of v = (cosh(x - 1/2) + cosh(y - 1/2)) / sinh(1/2), in (3.7)
    lower = np.sqrt(mu @ gram.p0.lower @ mu)
    upper = np.sqrt(mu @ gram.p0.upper @ mu)
    lines = [f"  {lower:.10g} <= {exact:.10g} <= {upper:.10g}"]
    outside = max(lower / exact - 1, 1 - upper / exact, upper / lower - 1)
    return Evidence("how far the bounds are from it and apart", float(outside), 5e-3, False, lines)


def inverse_estimate(tables: Tables, scenes: Sequence[str], H_over_h: float) -> Evidence:
    """C of ||mu||_0 <= C H^{-1/2} ||mu||_{-1/2} on P0(T_H) times beta_0: at most 1, for V_h is a part of H^1.

    C is computed with the norm's lower bound, and so is not too small. The lines are the constants.
    """
    products = {}
    constants = []
    for scene in scenes:
        errors = tables[f"{scene}/errors"]
        for k, (cells, gram) in enumerate(dual_norm_forms(tables, scene)):
            has_ratio = np.isclose(errors["h_over_H"].values[:, k], 1 / H_over_h)
            if has_ratio.any():
                C = inverse_constant(cells, gram.p0.lower)
                name = f"{scene}, H = {cells.H:g}"
                products[name] = C * float(errors["beta_0"].values[has_ratio, k].max())
                constants.append(f"  {name}: C = {C:.4g}")
    quantity = rf"the largest $C\beta_0$ at $H = {H_over_h:g}h$"
    return pick_worst(products, quantity, 1.0, False)._replace(lines=constants)
