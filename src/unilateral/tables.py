"""The netCDF schema of the study's tables, and how they are written: described, deterministic, never half.

Dimensions are `case`, `mesh` (levels, coarse to fine) and `partition` (coarse to fine), the full tensor
grid; what was not computed is NaN, or the empty string.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from unilateral import __version__
from unilateral.errors import InputError

SOURCE = (
    "J. Haslinger, J. Lovíšek: Mixed variational formulation of unilateral problems. "
    "Comment. Math. Univ. Carolin. 21 (1980), No. 2, 231-246"
)
LIBRARIES = ("numpy", "scipy", "scikit-fem", "gmsh", "xarray", "netCDF4")
FLOAT_DIGITS = 4
NEGLIGIBLE = 1e-12

# name: (long name, units, the paper's equation or definition)
VARIABLES = {
    "h": ("longest boundary edge of the mesh", "1", "section 2"),
    "diameter": ("longest edge of any triangle", "1", "section 2"),
    "unknowns": ("dimension of V_h", "1", "section 2"),
    "boundary_unknowns": ("dimension of A_3", "1", "section 5"),
    "H": ("longest cell of T_H", "1", "section 2"),
    "H_over_Hi_max": ("regularity of T_H, max H/H_i", "1", "section 2"),
    "multipliers": ("dimension of Lambda_H", "1", "section 2"),
    "h_over_H": ("h/H", "1", "Lemma 3.1"),
    "h1_error": ("||u - u_h||_1", "1", "(4.11)"),
    "hm12_error_lower": ("guaranteed lower bound of ||lambda - lambda_H||_{-1/2}", "1", "(4.12)"),
    "hm12_error_upper": ("guaranteed upper bound of ||lambda - lambda_H||_{-1/2}", "1", "(4.12)"),
    "hm12_discrete": ("||lambda - lambda_H||_{-1/2,h}, the supremum over V_h only", "1", "(3.4)"),
    "hm12_best": ("lower bound of the distance of lambda from P0(T_H) in H^{-1/2}", "1", "(4.15)"),
    "l2_error": ("||lambda - lambda_H||_0", "1", "(4.13)"),
    "algorithm": ("algorithm that found lambda_H", "1", "(5.1)-(5.3)"),
    "iterations": ("steps of the algorithm", "1", "(5.1)-(5.3)"),
    "operator_applications": ("applications of the dual operator", "1", "(5.1)"),
    "tolerance": ("tolerance of the algebraic bound", "1", "section 5"),
    "algebraic_bound": ("guaranteed bound of ||lambda_H - exact lambda_H||_{-1/2,h}", "1", "section 5"),
    "converged": ("1 if the algebraic bound met its tolerance, else 0", "1", "section 5"),
    "balance": ("|int u_h - int f - int lambda_H|", "1", "(P_h*) with v = 1"),
    "quadrature_share": ("share of ||u - u_h||_1^2 that exact quadrature would not have", "1", "(4.11)"),
    "u_norm": ("||u||_1", "1", "section 1"),
    "interpolation_error": ("||u - r_h u||_1", "1", "(4.14)"),
    "ritz_error": ("||u - z_h||_1, z_h the Ritz projection of u", "1", "(4.14)"),
    "projection_error": ("||lambda - Pi_H lambda||_0", "1", "(4.15)"),
    "consistency": ("<Pi_H lambda, u - g>", "1", "(4.16)"),
    "lambda_min": ("smallest eigenvalue of S", "1", "(3.4)"),
    "lambda_max": ("largest eigenvalue of S", "1", "(5.2)"),
    "beta_lower": ("guaranteed lower bound of beta", "1", "(3.4), first inequality"),
    "beta_upper": ("guaranteed upper bound of beta", "1", "(3.4), first inequality"),
    "beta_0": (
        "(lambda_min(S)/H)^{1/2}, the constant of the other inequality",
        "1",
        "(3.4), second inequality",
    ),
    "norm_ratio_lower": ("lower bound of ||e||_{-1/2,h} / ||e||_{-1/2}, e = lambda - lambda_H", "1", "(3.4)"),
    "norm_ratio_upper": ("upper bound of ||e||_{-1/2,h} / ||e||_{-1/2}, e = lambda - lambda_H", "1", "(3.4)"),
    "lemma_4_3": (
        "upper bound of ||lambda - lambda_H||_{-1/2} over (1 + 1/beta) inf ||lambda - mu_H||_{-1/2} "
        "+ (1/beta) ||u - u_h||_1",
        "1",
        "(4.6)",
    ),
    "edges_per_cell": ("least number of boundary edges in a cell, parts as fractions", "1", "Lemma 3.1"),
    "cell_over_edge": ("least H_i over the longest edge that meets the cell", "1", "Lemma 3.1"),
    "nodes_per_cell": ("least number of mesh nodes inside a cell", "1", "Lemma 3.1"),
    "worst": ("the multiplier at which (3.4) is sharp, its largest value 1", "1", "(3.4)"),
    "side": ("side of the polygon on which a cell lies", "1", "section 2"),
    "smallest_angle": ("smallest angle of the triangles at the boundary", "degree", "section 2"),
    "lambda_means": ("cell means of lambda", "1", "(4.15)"),
    "points": ("ends of the cells of T_H, in arc length", "1", "section 2"),
    "norm_lower": ("form on P0(T_H) and lambda - Pi_H lambda, from below", "1", "(3.5)"),
    "norm_upper": ("form on P0(T_H) and lambda - Pi_H lambda, from above", "1", "(3.5)"),
    "oscillation": ("what a reference flux does not carry, to be added above", "1", "(3.5)"),
    "sigma_1": ("first Steklov eigenvalue of -Delta + 1, by Ritz on V_h", "1", "(5.2)"),
    "lambda_H": ("the discrete multiplier on the cells of T_H", "1", "(P_h*)"),
    "rho_share": ("step rho as a share of 2/lambda_max(S)", "1", "(5.2)"),
    "steps": ("steps of Uzawa's algorithm from 0", "1", "(5.1)-(5.3)"),
    "distance": ("||lambda^n - lambda_H||_0 / ||lambda_H||_0 after those steps", "1", "(5.1)-(5.3)"),
    "saddle_in_v": ("least L(v, lambda_H) - L(u_h, lambda_H) over |L|, v random", "1", "Remark 1.1"),
    "saddle_in_mu": ("least L(u_h, lambda_H) - L(u_h, mu) over |L|, mu random", "1", "Remark 1.1"),
    "inequality": ("least A(U_h, V - U_h) - F(V - U_h) over |L|, V random", "1", "(4.4)"),
    "saddle_in_v_elsewhere": ("as saddle_in_v, for lambda_H + 1", "1", "Remark 1.1"),
    "saddle_in_mu_elsewhere": ("as saddle_in_mu, for lambda_H + 1", "1", "Remark 1.1"),
    "inequality_elsewhere": ("as inequality, for lambda_H + 1", "1", "(4.4)"),
    "multiplier_factor_elsewhere": ("as multiplier_factor, with J/2", "1", "section 5"),
    "off_cells": ("||(1 - Pi_H)(u_h - g)||_0 / ||u_h - g||_0", "1", "(5.2)"),
    "multiplier_factor": (
        "stationary multiplier of (3.3), as printed, over lambda_H",
        "1",
        "(1.8), (3.3)",
    ),
    "step": ("step of Uzawa's algorithm", "1", "(5.1)-(5.3)"),
    "u_distance": ("||u(lambda^n) - u_h||_1 over ||u_h - A^{-1} f||_1", "1", "(5.1)-(5.3)"),
    "residual_index": ("guaranteed bound by the residual, over that error", "1", "section 5"),
    "energy_index": ("guaranteed bound by the energy, over that error", "1", "section 5"),
    "violation": ("largest |mean(u_h - g)| of a second multiplier at H = h", "1", "Theorem 3.1"),
    "same_u": ("||difference of both u_h||_1 / ||u_h||_1", "1", "Theorem 3.1"),
    "multiplier_distance": ("distance of both multipliers in L2", "1", "Theorem 3.1"),
    "with_A": ("operations of a step with A factorised", "1", "section 5"),
    "with_A_3": ("operations of a step with A_3 factorised", "1", "section 5"),
    "with_S": ("operations of a step with S", "1", "section 5"),
    "difference": ("of the iterates by A and by A_3, relative", "1", "section 5"),
    "seconds": ("wall-clock time of the solve", "s", ""),
    "condense_seconds": ("wall-clock time of factorisation and condensation", "s", ""),
    "peak_mb": ("peak resident memory of the process", "MB", ""),
    "h_coarse": ("h of the coarser level of a pair", "1", "Theorem 4.1"),
    "h_fine": ("h of the finer level of a pair", "1", "Theorem 4.1"),
    "rate": ("observed rate of a pair of levels", "1", "Theorem 4.1"),
    "asymptotic": ("1 if both levels of the pair are asymptotic as the case declares", "1", "Theorem 4.1"),
    "fitted": ("least-squares rate over the asymptotic levels", "1", "Theorem 4.1"),
    "proved": ("rate that Theorem 4.1 proves", "1", "(4.11)-(4.13)"),
    "expected": ("rate expected from the theorem or the case's regularity", "1", ""),
    "finest_error": ("error on the finest level", "1", "Theorem 4.1"),
    "bound": ("stated bound of the error on the finest level", "1", "Theorem 4.1"),
    "alpha": ("lambda ~ s_+^alpha at a transition", "1", "Theorem 4.1, (j)"),
    "gamma": ("u - g ~ s_-^gamma at a transition", "1", "Theorem 4.1, (jj)"),
    "error": ("r.m.s. mean of the error over the transition's positions in its cell", "1", "Theorem 4.1"),
    "uncertainty": ("distance between the rates of the two finest pairs", "1", "Theorem 4.1"),
    "predicted": ("rate of the best approximation", "1", "(4.14), (4.15)"),
    "left_by_proof": ("smaller of predicted and half the consistency term's rate", "1", "(4.10), (4.7)"),
    "consistency_rate": ("observed rate of <Pi_H lambda, u - g>", "1", "(4.16)"),
    "consistency_predicted": ("rate of <Pi_H lambda, u - g>, alpha + gamma + 1", "1", "(4.16)"),
    "share": ("largest guaranteed algebraic error, as part of the error in the norm", "1", "section 5"),
    "j": ("1 if u is in H^2, else 0", "1", "Theorem 4.1, (j)"),
    "jj": ("1 if u and g are Lipschitz on the sides, else 0", "1", "Theorem 4.1, (jj)"),
    "C1": ("factor of h in ||u - u_h||_1^2 = (C1 h)^2 + (C2 H^s)^2", "1", "(4.11)"),
    "C2": ("factor of H^s in ||u - u_h||_1^2 = (C1 h)^2 + (C2 H^s)^2", "1", "(4.11)"),
    "s": ("exponent of H in ||u - u_h||_1^2 = (C1 h)^2 + (C2 H^s)^2", "1", "(4.11)"),
    "s_uncertainty": ("standard deviation of s, from the fit's Jacobian", "1", "(4.11)"),
    "residual": ("largest |log(error / model)| of the fit", "1", "(4.11)"),
    "pairs": ("number of pairs (h, H) that the fit uses", "1", "(4.11)"),
    "start": ("largest h, and half the largest H, that the fit uses", "1", "(4.11)"),
    "verdict": ("holds, exact, fails, or not judged", "1", ""),
    "why": ("why a verdict is not 'holds' or 'exact'", "1", ""),
}


def error_in(table: xr.Dataset, norm: str, bound: str | None = None) -> xr.DataArray:
    """The error in a norm; in hm12 its "lower" or "upper" bound or, without one, their r.m.s. mean.

    The mean is 10 to 100 times closer to the error than the bounds are, but not guaranteed.
    """
    if norm != "hm12":
        return table[f"{norm}_error"]
    if bound:
        return table[f"hm12_error_{bound}"]
    square = 0.5 * (table["hm12_error_lower"] ** 2 + table["hm12_error_upper"] ** 2)
    return square**0.5


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A temporary path beside `path`, with its ending, that takes its place if the block succeeds."""
    path = Path(path)
    if not path.parent.is_dir():
        raise InputError(f"{path} cannot be written: there is no folder {path.parent}")
    handle, name = tempfile.mkstemp(prefix=".", suffix=path.suffix, dir=path.parent)
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(0o644)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def save(table: xr.Dataset, path: str | os.PathLike[str], scene: str) -> None:
    """Write a table as netCDF with its variables described, its provenance, and no time stamp."""
    table = table.copy()
    for name, variable in table.variables.items():
        if name in VARIABLES:
            long_name, units, equation = VARIABLES[str(name)]
            variable.attrs = {"long_name": long_name, "units": units, "equation": equation}
    libraries = ", ".join(f"{name} {version(name)}" for name in LIBRARIES)
    table.attrs = {"scene": scene, "unilateral": __version__, "libraries": libraries, "source": SOURCE}
    with replacing(path) as temporary:
        table.to_netcdf(temporary, engine="netcdf4")


def load(path: str | os.PathLike[str]) -> xr.Dataset:
    """A table, read whole. Raises InputError for a file that is missing or no netCDF."""
    try:
        return xr.load_dataset(path, engine="netcdf4")
    except FileNotFoundError:
        raise InputError(f"there is no table {path}; run 'make', or 'snakemake -j2 {path}'") from None
    except OSError:
        raise InputError(f"{path} is no netCDF table") from None


def along_mesh(levels: Sequence[xr.Dataset]) -> xr.Dataset:
    """One table from those of single levels, coarse to fine."""
    return xr.concat(
        levels,
        "mesh",
        data_vars="minimal",
        coords="minimal",
        compat="override",
        join="exact",
        combine_attrs="drop",
    )


def save_csv(frame: pd.DataFrame, path: str | os.PathLike[str]) -> None:
    """Write a table to draw from, rounded so that another machine's last bits do not show."""
    rounded = {name: _rounded(column) for name, column in frame.items()}
    with replacing(path) as temporary:
        pd.DataFrame(rounded).to_csv(temporary, index=False, lineterminator="\n")


def _rounded(column: pd.Series) -> pd.Series:
    if not pd.api.types.is_float_dtype(column):
        return column
    negligible = NEGLIGIBLE * column.abs().max()
    cleaned = column.where(column.isna() | (column.abs() > negligible), 0.0)
    return cleaned.map(lambda x: "" if np.isnan(x) else f"{x:.{FLOAT_DIGITS}g}")
