"""A solver as the author of another code writes it, and the bugs that such authors make, one at a time.

P1 on the exported mesh, u >= g in the means over the exported cells or at the nodes, and a primal-dual active
set by sparse elimination. Only the exported files are read; nothing of `unilateral` is imported.
"""

import json
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import meshio
import numpy as np
import pandas as pd
import scipy.sparse as sp
import scipy.sparse.linalg as spl
import xarray as xr

METHODS = ("cells", "nodes")
MATRICES = {
    "mass term missing": (1, 0),
    "mass term doubled": (1, 2),
    "matrix doubled": (2, 2),
    "areas doubled": (0.5, 2),
}
"""What the stiffness and c times the mass matrix are multiplied by.

Gradients have an area in their denominators.
"""
LOADS = {"load missing": 0, "half load": 0.5, "load negative": -1}


class Level(NamedTuple):
    """What an author reads of a level's folder; `boundary` (nb,) are the nodes in the order of arc length."""

    points: np.ndarray
    triangles: np.ndarray
    nodes: pd.DataFrame
    cells: pd.DataFrame
    rule: xr.Dataset
    problem: dict
    boundary: np.ndarray

    @property
    def s(self):
        """(nb + 1,) arc lengths of the boundary nodes, and the perimeter."""
        return np.append(self.nodes.s[self.boundary], self.cells.end.iloc[-1])

    @property
    def side_of_nodes(self):
        """(nb,) at a vertex the side that begins there."""
        starts = self.cells.start[self.cells.side.diff().fillna(1) != 0]
        return np.searchsorted(starts, self.s[:-1], side="right") - 1

    @property
    def areas(self):
        corners = self.points[self.triangles]
        (ax, ay) = (corners[:, 1] - corners[:, 0]).T
        (bx, b_y) = (corners[:, 2] - corners[:, 0]).T
        return 0.5 * np.abs(ax * b_y - ay * bx)

    @property
    def reach(self):
        """(nb,) the integrals of the hats over the boundary."""
        length = np.diff(self.s)
        return 0.5 * (length + np.roll(length, 1))

    def f(self, x, y):
        """By the exported formula."""
        names = {"x": x, "y": y}
        exec(self.problem["definitions"], names)
        return eval(self.problem["f"], names)

    def load(self, triangles):
        """(n,) the sum of what belongs to the triangles' corners (t, 3)."""
        return np.bincount(self.triangles.ravel(), triangles.ravel(), len(self.points))


def read(folder, name):
    level_folder = Path(folder) / name
    mesh = meshio.read(level_folder / "mesh.vtu")
    nodes = pd.read_csv(level_folder / "nodes.csv")
    return Level(
        nodes[["x", "y"]].to_numpy(),
        mesh.cells_dict["triangle"],
        nodes,
        pd.read_csv(level_folder / "partition.csv"),
        xr.load_dataset(level_folder / "quadrature.nc"),
        json.loads((Path(folder) / "problem.json").read_text()),
        np.flatnonzero(nodes.s.notna())[np.argsort(nodes.s.dropna().to_numpy())],
    )


def matrices(level):
    """Stiffness, from the edges opposite to the corners, and mass."""
    corners = level.points[level.triangles]
    area = level.areas[:, None, None]
    edges = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    t = level.triangles
    n = len(level.points)
    rows_and_columns = np.repeat(t, 3, axis=1).ravel(), np.tile(t, (1, 3)).ravel()
    blocks = edges @ edges.transpose(0, 2, 1) / (4 * area), area * (np.ones((3, 3)) + np.eye(3)) / 12
    return [sp.coo_array((block.ravel(), rows_and_columns), shape=(n, n)).tocsr() for block in blocks]


def load(level, bug, M):
    """(f, phi_i) (n,), by the exported quadrature, or as a bug has it."""
    if bug == "f at nodes":
        return M @ level.nodes.f.to_numpy()
    if bug == "f at nodes, lumped":
        return M.sum(axis=1) * level.nodes.f.to_numpy()
    if bug == "f at centroids":
        f = level.f(*level.points[level.triangles].mean(axis=1).T)
        return level.load(np.repeat((level.areas * f / 3)[:, None], 3, axis=1))
    weighted = (level.rule.weight * level.rule.f).values[:, None] * level.rule.barycentric.values
    corners = level.triangles[level.rule.triangle.values]
    return LOADS.get(bug, 1) * np.bincount(corners.ravel(), weighted.ravel(), len(level.points))


def mean_constraint(level):
    """Rows v -> integrals of v over the cells, by midpoints between all points; means of g; lengths."""
    s = level.s
    b = level.boundary
    rows = sp.lil_array((len(level.cells), len(level.points)))
    for i, (start, end) in enumerate(zip(level.cells.start, level.cells.end, strict=True)):
        for low, high in pairwise(np.unique([start, *s[(s > start) & (s < end)], end])):
            edge = np.searchsorted(s, 0.5 * (low + high)) - 1
            x = (0.5 * (low + high) - s[edge]) / (s[edge + 1] - s[edge])
            rows[i, b[edge]] += (high - low) * (1 - x)
            rows[i, b[(edge + 1) % len(b)]] += (high - low) * x
    return rows.tocsr(), level.cells.g_mean.to_numpy(), (level.cells.end - level.cells.start).to_numpy()


def node_constraint(level):
    """Rows v -> v at a boundary node; g; 1."""
    b = level.boundary
    position = sp.coo_array((np.ones(len(b)), (np.arange(len(b)), b)), shape=(len(b), len(level.points)))
    return position.tocsr(), level.nodes.g.to_numpy()[b], np.ones(len(b))


def contact(A, f, rows, g, lengths, clamped, settle=True):
    """u and the multipliers of the held rows u >= g lengths; with equality in all of them if not `settle`."""
    active = clamped.copy()
    mu = np.zeros(len(g))
    for _ in range(100):
        B = rows[np.flatnonzero(active)]
        system = sp.block_array([[A, -B.T], [B, None]], format="csc") if active.any() else A.tocsc()
        x = spl.spsolve(system, np.append(f, (g * lengths)[active]))
        u = x[: len(f)]
        mu = np.zeros(len(g))
        mu[active] = x[len(f) :]
        now = clamped & (mu > rows @ u / lengths - np.where(clamped, g, 0))
        if not settle or np.array_equal(now, active):
            return u, mu
        active = now
    raise RuntimeError("the active set did not settle in 100 steps")


def uzawa(A, f, rows, g, lengths, clamped, behind):
    """A tenth of the steps of Uzawa's iteration that it takes until the multipliers change by 1e-6 only.

    u belongs to the multipliers, or to those of the step before if it is `behind`.
    """
    solve = spl.splu(A.tocsc()).solve
    B = rows[np.flatnonzero(clamped)]
    D = B @ solve(B.T.toarray()) / lengths[clamped][:, None]
    start = B @ solve(f) / lengths[clamped] - g[clamped]
    rho = 1.8 / np.linalg.norm(D, 2)
    iterates = [np.zeros(clamped.sum())]
    while len(iterates) < 3 or np.ptp(iterates[-1] - iterates[-2]) > 1e-6 * np.ptp(iterates[-1]):
        iterates.append(np.maximum(0, iterates[-1] - rho * (D @ iterates[-1] + start)))
    k = max(1, len(iterates) // 10)
    mu = np.zeros(len(g))
    mu[clamped] = iterates[k]
    return solve(f + B.T @ iterates[k - behind]), mu


def eliminate_clamped_nodes(A, f, rows, g, lengths, u_D):
    """The problem for what u is without u_D (n,), on the nodes where that is NaN; and these nodes."""
    free = np.flatnonzero(np.isnan(u_D))
    clamped_values = np.nan_to_num(u_D)
    reduced_data = f - A @ clamped_values, g - rows @ clamped_values / lengths
    return A[free][:, free], reduced_data[0][free], rows[:, free], reduced_data[1], free


def roll_to_side(values, side, sides):
    """Values that are counted from the vertex at which so many sides end; or back, if negative."""
    return np.roll(values, -int(np.sign(sides) * (side < abs(sides)).sum()))


def solve_level(level, bug="", method="cells"):
    """Tables of x, y, u and perhaps a multiplier at the nodes, and of cells or None; with a bug."""
    K, M = matrices(level)
    K_factor, M_factor = MATRICES.get(bug, (1, 1))
    c = 1 if bug == "mass term added" else M_factor * level.problem["c"]
    A = K_factor * K + c * M
    f = load(level, bug, M)
    u_D = level.nodes.u_D.to_numpy()
    u_D = {"clamped side left free": u_D * np.nan, "clamped values not set": 0 * u_D}.get(bug, u_D)
    rows, g, lengths = mean_constraint(level) if method == "cells" else node_constraint(level)
    side = level.cells.side.to_numpy() if method == "cells" else level.side_of_nodes
    clamped_finite = np.isfinite(g)
    if bug == "one side ignored":
        clamped_finite &= side != 0
    g = g * {"g negative": -1, "g zero": 0}.get(bug, 1)
    if bug in ("wrong corner of g", "wrong corner of all"):
        g = roll_to_side(g, side, -1)
        clamped_finite = np.isfinite(g)
    A, f, rows, g, free = eliminate_clamped_nodes(A, f, rows, g, lengths, u_D)
    clamped_finite &= rows.sum(axis=1) > 0
    if bug.startswith("stopped early"):
        u, mu = uzawa(A, f, rows, g, lengths, clamped_finite, bug.endswith("behind"))
    elif bug == "conditions turned around":
        minus_u, minus_mu = contact(A, -f, rows, -g, lengths, clamped_finite)
        u = -minus_u
        mu = -minus_mu
    else:
        u, mu = contact(A, f, rows, g, lengths, clamped_finite, bug != "Dirichlet everywhere")
    full = np.nan_to_num(u_D)
    full[free] = u
    if bug in ("wrong corner", "wrong corner of all"):
        mu = roll_to_side(mu, side, 1)
    return handed_in(level, bug, method, full, -mu if bug == "lambda negative" else mu)


def handed_in(level, bug, method, u, mu):
    """What the author writes into files."""
    random = np.random.default_rng(1)
    (x, y) = level.points.T
    if bug == "u doubled":
        u = 2 * u
    if bug == "nodes shuffled":
        u = random.permutation(u)
    if bug == "clamped node spoilt":
        u[np.flatnonzero(level.nodes.u_D.notna())[3:4]] += 0.01 * np.abs(u).max()
    if bug == "x and y exchanged":
        x, y = y, x
    if bug == "noise":
        u = u + 1e-10 * random.standard_normal(len(u))
        mu = mu + 1e-10 * random.standard_normal(len(mu))
    table = pd.DataFrame({"x": x, "y": y, "u": u})
    cells = level.cells[["start", "end"]]
    lengths = (cells.end - cells.start).to_numpy()
    if method == "cells":
        return table, cells.assign(multiplier=mu * (lengths if bug == "lambda integrated" else 1))
    if bug == "reactions lumped to cells":
        shares = mean_constraint(level)[0][:, level.boundary] @ (mu / level.reach)
        return table, cells.assign(multiplier=shares / lengths)
    values = np.full(len(u), np.nan)
    values[level.boundary] = mu / (level.reach if bug == "lambda lumped" else 1)
    name = "multiplier" if bug in ("lambda lumped", "lambda integrated") else "reaction"
    return table.assign(**{name: values}), None
