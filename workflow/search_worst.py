"""Searches the unit square for the partitions and boundary nodes with the smallest beta; run by hand.

    python workflow/search_worst.py

writes the finds of the survey betaworst in workflow/config/worst_infsup.yaml, in about ten minutes on one
core. A family fixes the least number of edges in every cell and how much lengths may differ; its candidates
are vectors x in [0, 1]^d. They are searched first among words, whose edges repeat a pattern of extreme
lengths, then at random, then by changes of the best one found so far.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from unilateral.arrays import Array
from unilateral.errors import InputError
from unilateral.fem.condense import condense
from unilateral.fem.spaces import mixed_spaces
from unilateral.geometry.mesh import Mesh, triangulate_from_boundary
from unilateral.geometry.partition import Partition, from_points
from unilateral.geometry.polygon import square
from unilateral.norms.dual import Bracket, build_dual_norm
from unilateral.norms.infsup import infsup_constants
from unilateral.system.files import replacing

FINDS = Path(__file__).parent / "config" / "worst_infsup.yaml"
SEARCH: dict[str, Any] = {
    "seed": 1,
    "cells_per_side": 4,
    "random": 100,
    "changes": 1000,
    "digits": 6,
    "families": [
        {"edges": [1, 2], "edge_ratio": 2},
        {"edges": [2], "edge_ratio": 2},
        {"edges": [2], "edge_ratio": 10},
        {"edges": [2], "edge_ratio": 100, "smallest_angle": 0.1},
        {"edges": [3], "edge_ratio": 10},
        {"edges": [3], "edge_ratio": 100, "smallest_angle": 0.1},
        {"edges": [4], "edge_ratio": 10},
        {"edges": [2], "edge_ratio": 2, "cell_ratio": 2},
        {"edges": [2], "edge_ratio": 2, "cell_ratio": 10},
        {"edges": [1.5], "edge_ratio": 2, "nested": False},
        {"edges": [2], "edge_ratio": 2, "nested": False},
        {"edges": [2], "edge_ratio": 10, "nested": False},
    ],
}
PAIRS = ((0.5, 0.5), (0.0, 1.0), (1.0, 0.0))


class Candidate(NamedTuple):
    """Arc lengths of the ends of the cells (m + 1,) and of the mesh nodes (nb,)."""

    points: Array
    nodes: Array


@dataclass(frozen=True)
class Family:
    """Candidates with `edges` in every cell, repeated over the cells of a side; their ratio is the largest.

    Nested cells are cut into that many edges. Other cells have at least that many, parts as fractions, and
    lie anywhere in a mesh with one edge more on every side. The mesh has no angle below `smallest_angle`.
    """

    edges: Sequence[float]
    edge_ratio: float
    cell_ratio: float = 1.0
    nested: bool = True
    smallest_angle: float = 5.0
    cells: int = 4
    digits: int = 6

    @property
    def per_cell(self) -> Array:
        """The least number of edges in each cell of a side (cells,)."""
        return np.resize(np.array(self.edges, dtype=float), self.cells)

    @property
    def n_edges(self) -> int:
        """The number of edges on a side."""
        return int(np.ceil(self.per_cell.sum())) + (not self.nested)

    @property
    def size(self) -> int:
        """The dimension of the vectors x."""
        return 4 * (self.n_edges + self.cells)

    def candidate(self, x: Array) -> Candidate:
        """The candidate of x (size,): the edges' lengths, then the cells' or their excess over `edges`."""
        edges = x[: 4 * self.n_edges].reshape(4, -1)
        cells = x[4 * self.n_edges :].reshape(4, -1)
        lengths = self.edge_ratio**edges
        if self.nested:
            cell = np.repeat(np.arange(self.cells), self.per_cell.astype(int))
            in_cell = np.add.reduceat(lengths, np.flatnonzero(np.diff(cell, prepend=-1)), axis=1)
            ends = _cumulative_shares(self.cell_ratio**cells)
            nodes = _cumulative_shares(lengths / in_cell[:, cell] * np.diff(ends)[:, cell])
        else:
            # The cells share the edges that are more than the least number, in random proportion
            spare = self.n_edges - self.per_cell.sum()
            nodes = _cumulative_shares(lengths)
            shares = (cells + 1e-3) / (cells + 1e-3).sum(axis=1, keepdims=True)
            places = _cumulative_shares(self.per_cell + spare * shares) * self.n_edges
            ends = np.stack(
                [np.interp(t, np.arange(self.n_edges + 1), s) for t, s in zip(places, nodes, strict=True)]
            )
        start = np.arange(4)[:, None]
        points = np.round(start + ends[:, :-1], self.digits).ravel()
        nodes = np.round(start + nodes[:, :-1], self.digits).ravel()
        return Candidate(np.append(points, 4.0), nodes)

    def words(self) -> Iterator[Array]:
        """The vectors whose edges repeat a word of 0 and 1, with equal and with alternating cells."""
        length = int(2 * np.mean(self.edges))
        pairs = PAIRS if self.cell_ratio > 1 or not self.nested else PAIRS[:1]
        for letters in product((0.0, 1.0), repeat=length):
            for pair in pairs:
                yield np.concatenate([np.resize(letters, 4 * self.n_edges), np.resize(pair, 4 * self.cells)])


def _cumulative_shares(lengths: Array) -> Array:
    """Points (4, n + 1) from 0 to 1, in the proportion of the lengths (4, n) or (n,)."""
    sums = np.cumsum(np.atleast_2d(lengths), axis=1)
    return np.pad(sums / sums[:, -1:], ((0, 0), (1, 0)))


@lru_cache(maxsize=64)
def _reference(points: tuple[float, ...]) -> tuple[Partition, Bracket]:
    partition = from_points(square(), points)
    return partition, build_dual_norm(partition).gram().p0


def smallest_angle(mesh: Mesh) -> float:
    """The smallest angle of all triangles, in degrees."""
    a, b, c = np.moveaxis(mesh.points[mesh.triangles], 1, 0)
    # |a x b| = |a| |b| sin, and the smallest angle lies between the two longest sides
    squares = np.sort([np.sum((p - q) ** 2, axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    return float(
        np.rad2deg(np.arcsin(np.clip(2 * mesh.areas / np.sqrt(squares[1] * squares[2]), 0, 1)).min())
    )


def measure(candidate: Candidate) -> tuple[float, float]:
    """beta (its upper bound) and the mesh's smallest angle."""
    partition, gram = _reference(tuple(candidate.points.tolist()))
    mesh = triangulate_from_boundary(square(), candidate.nodes)
    operator = mixed_spaces(condense(mesh), partition).operator
    return infsup_constants(operator, gram).beta_upper, smallest_angle(mesh)


def search(family: Family, rng: np.random.Generator, n_random: int, changes: int) -> tuple[float, Candidate]:
    """The smallest beta found among the meshes the family allows, and where."""

    def beta(x: Array) -> float:
        """beta of the candidate; infinite without a mesh, or with too small an angle."""
        try:
            value, angle = measure(family.candidate(x))
        except InputError:
            return np.inf
        return value if angle >= family.smallest_angle else np.inf

    starts = [*family.words(), *rng.random((n_random, family.size))]
    values = [beta(x) for x in starts]
    best = min(values)
    x = starts[int(np.argmin(values))]
    for _ in range(changes):
        trial = _change_randomly(x, rng)
        value = beta(trial)
        if value < best:
            best = value
            x = trial
    return best, family.candidate(x)


def _change_randomly(x: Array, rng: np.random.Generator) -> Array:
    """One to four neighbouring components made extreme, or all of some moved a little."""
    changed = x.copy()
    size = len(x)
    if rng.random() < 0.7:
        chosen = (rng.integers(size) + np.arange(rng.integers(1, 5))) % size
        changed[chosen] = rng.choice([0.0, 0.5, 1.0], len(chosen))
        return changed
    selected = rng.random(size) < 0.2
    return np.clip(changed + np.where(selected, 0.2 * rng.standard_normal(size), 0.0), 0, 1)


def describe_family(family: Family) -> str:
    """A sentence on the family, for the configuration."""
    edges = " or ".join(f"{n:g}" for n in family.edges)
    ratio = f"whose lengths differ by a factor of at most {family.edge_ratio:g}"
    if not family.nested:
        return f"Cells of any position and at least {edges} edges, {ratio} on each side."
    cells = "Equal cells" if family.cell_ratio == 1 else f"Cells of lengths up to {family.cell_ratio:g} : 1"
    return f"{cells}, each cut into {edges} edges {ratio} in a cell."


def find(number: int, fields: dict) -> dict:
    """The worst candidate of a family, as it is stored."""
    family = Family(**fields, cells=SEARCH["cells_per_side"], digits=SEARCH["digits"])
    rng = np.random.default_rng([SEARCH["seed"], number])
    beta, worst = search(family, rng, SEARCH["random"], SEARCH["changes"])
    print(f"{number + 1}/{len(SEARCH['families'])} {describe_family(family)} beta = {beta:.3f}", flush=True)
    k = float(np.mean(family.edges))
    return {
        "name": f"k{k:g}_R{family.edge_ratio:g}"
        + (f"_cells{family.cell_ratio:g}" if family.cell_ratio > 1 else "")
        + ("" if family.nested else "_free"),
        "what": describe_family(family),
        "polygon": "square",
        "edges_per_cell": k,
        "edge_ratio": family.edge_ratio,
        "smallest_angle": round(measure(worst)[1], 1),
        "points": worst.points.tolist(),
        "nodes": worst.nodes.tolist(),
        "beta": round(beta, 3),
    }


HEADER = """\
# Pairs with a small beta that searches found, for surveys of kind worst. Meshes are by gmsh.
# betaworst: python workflow/search_worst.py; {parameters}.
# betarule, betadelta: python workflow/search_rule.py. Run by hand, not by the pipeline.
# points, nodes: arc lengths of T_H (the perimeter last) and of the mesh (the perimeter left out).
"""


def write(survey: str, finds: list[dict]) -> None:
    """Put the finds of a survey into the file, in the place of those that it has."""
    parameters = ", ".join(f"{key} {value}" for key, value in SEARCH.items() if key != "families")
    stored = yaml.safe_load(FINDS.read_text(encoding="utf-8"))
    stored["finds"][survey] = finds
    text = yaml.safe_dump(stored, sort_keys=False, width=100, default_flow_style=None)
    with replacing(FINDS) as temporary:
        temporary.write_text(HEADER.format(parameters=parameters) + text, encoding="utf-8")


if __name__ == "__main__":
    write("betaworst", [find(number, fields) for number, fields in enumerate(SEARCH["families"])])
