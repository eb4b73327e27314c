"""What other packages' solutions of exported cases score, as documents show it."""

from __future__ import annotations

import pandas as pd

NAMES = {
    "skfem": "scikit-fem, active set, u ≥ g at the nodes",
    "fenicsx": "FEniCSx, PETSc's SNESVI, u ≥ g at the nodes",
    "ngsolve": "NGSolve, active set, u ≥ g at the nodes",
    "getfem": "GetFEM, augmented Lagrangian, u ≥ g in the mean over cells",
}
RATES = {"h1": "rate of u, ours", "hm12": "rate of λ, ours"}


def solvers(scores: pd.DataFrame) -> pd.DataFrame:
    """A row per case and solver: errors on the finest level over this project's, rates, and the verdict."""
    return pd.DataFrame([_row(row) for _, row in scores.sort_values("case", kind="stable").iterrows()])


def _row(row: pd.Series) -> dict[str, str]:
    shown = {"case": f"`{row['case']}`", "package and method": NAMES[row["solver"]]}
    shown["error of u in H¹"] = f"× {row['h1_over_own']:.3f}"
    shown["error of λ in H^(−1/2)"] = f"× {row['hm12_over_own']:.2f}"
    for norm, title in RATES.items():
        shown[title] = f"{row[f'{norm}_rate']:.2f}, {row[f'{norm}_own_rate']:.2f}"
    return shown | {"verdict": row["verdict"]}
