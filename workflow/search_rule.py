"""Searches polygons for pairs of a mesh and a partition with a small beta that keep a condition; run by hand.

    python workflow/search_rule.py rule FILE --minutes 60
    python workflow/search_rule.py rule FILE --write

`rule`: edges are at most half of the cells that they meet; the least beta is looked for. `delta`: each cell
has a node inside, neighbouring cells differ by a factor of at most 10; the least beta/(4 delta (1 - delta))
is looked for, see the claim T.node. Angles are at least 20 degrees in both. A chain makes random changes of a
pair and keeps those that do not raise the value. Every other chain begins with a random pair, the others with
one of the best of their polygon. FILE gets a line for each chain; started again with it, the search goes on
behind the last one. `--write` puts the best pairs into the surveys betarule and betadelta of
workflow/config/worst_infsup.yaml.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from search_worst import smallest_angle, write

from unilateral.errors import InputError
from unilateral.fem.condense import condense
from unilateral.fem.spaces import mixed_spaces
from unilateral.geometry.mesh import triangulate_from_boundary
from unilateral.geometry.partition import from_points, overlay
from unilateral.geometry.polygon import Polygon, find_polygon
from unilateral.norms.dual import build_dual_norm
from unilateral.norms.infsup import infsup_constants
from unilateral.norms.resolution import RULE, innermost_nodes, is_fine_enough

NOTCH = [[0.0, 0.0], [0.4, 0.0], [0.5, 0.5], [0.6, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
POLYGONS = {
    "square": find_polygon("square"),
    "lshape": find_polygon("lshape"),
    "hexagon": find_polygon("hexagon"),
    "notch": Polygon(np.array(NOTCH), "notch"),
}
SEED = 1
GRID = 4096
"""Points lie at multiples of 1/GRID of their side, and ends of cells at even ones: halves are exact."""
MAX_CELLS = 24
MAX_NODES = 100
CHANGES_PER_CHAIN = 400
"""Changes that are measured in a chain."""
MAX_DRAWS = 200
"""Changes that are drawn until one keeps the condition."""
CHANGE_PROBABILITIES = [0.35, 0.25, 0.1, 0.1, 0.07, 0.05, 0.08]
"""The probabilities of the changes, in the order of `change_randomly`."""
MAX_VALUE_WITH_ANGLES = 3.0
"""What `measure` has for pairs without a small angle is below that."""
N_BEST_PAIRS = 5
"""A chain goes on from one of so many of the best pairs."""
MIN_DELTA = 0.1
MAX_ALPHA_1 = 10.0
N_WRITTEN_PAIRS = 10
"""So many pairs are written, one of each random pair that chains began with."""

CONDITIONS = {
    "rule": "Edges are at most half of the cells that they meet, and angles at least 20 degrees.",
    "delta": "Cells have nodes inside, neighbours are within 10:1, and angles at least 20 degrees.",
}

Side = tuple[int, ...]


class Pair(NamedTuple):
    """Positions on each side, in units of 1/GRID of it, 0 among them: of ends of cells, and of mesh nodes."""

    ends: tuple[Side, ...]
    nodes: tuple[Side, ...]

    def arc_lengths(self, polygon: Polygon) -> tuple[list[float], list[float]]:
        """Arc lengths of the ends, the perimeter last, and of the nodes; exact at vertices, else rounded."""
        starts = polygon.starts[:-1].tolist()
        lengths = polygon.lengths.tolist()

        def places(sides: Sequence[Sequence[int]]) -> list[float]:
            """Arc lengths of positions on the sides."""
            return [
                round(start + length * k / GRID, 12) if k else start
                for start, length, side in zip(starts, lengths, sides, strict=True)
                for k in side
            ]

        ends, nodes = self
        return [*places(ends), polygon.perimeter], places(nodes)


class PairResolution(NamedTuple):
    """The least H_i over the longest edge at cell i, delta and alpha_1 of `norms.resolution`."""

    cell_over_edge: float
    delta: float
    alpha_1: float


def resolve_pair(polygon: Polygon, pair: Pair) -> PairResolution:
    """How finely the pair's mesh resolves its cells."""
    ends, nodes = pair.arc_lengths(polygon)
    partition = from_points(polygon, ends)
    s = np.append(nodes, polygon.perimeter)
    _, cell, edge = overlay(partition.points, s)
    longest = np.zeros(partition.n_cells)
    np.maximum.at(longest, cell, np.diff(s)[edge])
    delta = float(innermost_nodes(s, partition)[1].min())
    return PairResolution(float((partition.lengths / longest).min()), delta, partition.alpha_1)


def keeps_condition(condition: str, polygon: Polygon, pair: Pair) -> bool:
    """Whether the pair keeps the condition, but for angles, and is not too large."""
    if sum(map(len, pair.ends)) > MAX_CELLS or sum(map(len, pair.nodes)) > MAX_NODES:
        return False
    resolved = resolve_pair(polygon, pair)
    if condition == "rule":
        return bool(is_fine_enough(np.array(resolved.cell_over_edge)))
    return resolved.delta >= MIN_DELTA and resolved.alpha_1 <= MAX_ALPHA_1


def measure(condition: str, polygon: Polygon, pair: Pair) -> float:
    """beta, or beta/(4 delta (1 - delta)); more than 3 with too small an angle; infinite without a mesh."""
    ends, nodes = pair.arc_lengths(polygon)
    try:
        mesh = triangulate_from_boundary(polygon, nodes)
        partition = from_points(polygon, ends)
        missing = RULE.smallest_angle - smallest_angle(mesh)
        if missing > 0:
            return MAX_VALUE_WITH_ANGLES + missing
        operator = mixed_spaces(condense(mesh), partition).operator
    except InputError:
        return np.inf
    beta = infsup_constants(operator, build_dual_norm(partition).gram().p0).beta_upper
    delta = resolve_pair(polygon, pair).delta
    return beta if condition == "rule" else beta / (4 * delta * (1 - delta))


def random_pair(polygon: Polygon, rng: np.random.Generator) -> Pair:
    """Up to four cells on a side, each cut into two or four equal edges."""
    ends = list[Side]()
    nodes = list[Side]()
    for _ in range(polygon.n_sides):
        cuts = 32 * rng.integers(1, GRID // 32, rng.integers(0, 4))
        side = sorted({0, *cuts.tolist()})
        edge_counts = rng.choice([2, 4], len(side)).tolist()
        cells = zip(side, [*side[1:], GRID], edge_counts, strict=True)
        ends.append(tuple(side))
        nodes.append(tuple(a + (b - a) * k // n for a, b, n in cells for k in range(n)))
    return Pair(tuple(ends), tuple(nodes))


def change_randomly(pair: Pair, rng: np.random.Generator) -> Pair:
    """The pair after one random change on one side, or the pair."""
    i = int(rng.integers(len(pair.ends)))
    ends = [*pair.ends[i], GRID]
    nodes = [*pair.nodes[i], GRID]
    cell = int(rng.integers(len(ends) - 1))
    node = int(rng.integers(len(nodes) - 1))
    low, high = ends[cell : cell + 2]
    match rng.choice(["end", "node", "new node", "no node", "cut", "join", "halve"], p=CHANGE_PROBABILITIES):
        case "end" if cell:  # moves an end of a cell, and the nodes in both cells at it
            before = ends[cell - 1]
            after = high
            new = low + 2 * round(0.5 * rng.choice([0.3, 0.05]) * (after - before) * rng.standard_normal())
            if not before < new < after:
                return pair
            fixed = sorted({0, before, after, GRID})
            places = np.interp(nodes, sorted({*fixed, low}), sorted({*fixed, new}))
            nodes = [round(place) for place in places]
            ends[cell] = new
        case "node" if node:
            before = nodes[node - 1]
            after = nodes[node + 1]
            nodes[node] += round(rng.choice([0.3, 0.05]) * (after - before) * rng.standard_normal())
            if not before < nodes[node] < after:
                return pair
        case "new node":
            nodes = sorted({*nodes, int(rng.integers(1, GRID))})
        case "no node" if node:
            del nodes[node]
        case "cut":  # a cell into two, each with a node in its middle
            new = low + 2 * round(0.5 * rng.uniform(0.1, 0.9) * (high - low))
            if not low < new < high:
                return pair
            ends.insert(cell + 1, new)
            outside = {place for place in nodes if not low < place < high}
            nodes = sorted({*outside, (low + new) // 2, new, (new + high) // 2})
        case "join" if cell:
            del ends[cell]
        case "halve":  # the nodes of a cell become its ends and its middle
            outside = {place for place in nodes if not low < place < high}
            nodes = sorted({*outside, low, (low + high) // 2, high})
    if len(set(nodes)) < len(nodes):
        return pair
    new_ends = list(pair.ends)
    new_nodes = list(pair.nodes)
    new_ends[i] = tuple(ends[:-1])
    new_nodes[i] = tuple(nodes[:-1])
    return Pair(tuple(new_ends), tuple(new_nodes))


def propose_changes(pair: Pair, rng: np.random.Generator) -> Iterator[Pair]:
    """The pair after one to three random changes, again and again."""
    for _ in range(MAX_DRAWS):
        new = pair
        for _ in range(rng.choice([1, 1, 2, 3])):
            new = change_randomly(new, rng)
        if new != pair:
            yield new


def run_chain(condition: str, polygon: Polygon, pair: Pair, rng: np.random.Generator) -> tuple[float, Pair]:
    """The smallest value that changes of the pair lead to, and where."""
    best = measure(condition, polygon, pair)
    for _ in range(CHANGES_PER_CHAIN):
        new = next(
            (change for change in propose_changes(pair, rng) if keeps_condition(condition, polygon, change)),
            None,
        )
        if new is None:
            break
        value = measure(condition, polygon, new)
        if value <= best:
            best = value
            pair = new
    return best, pair


def read(progress: Path) -> list[dict[str, Any]]:
    """The chains so far."""
    return [json.loads(line) for line in progress.read_text().splitlines()] if progress.exists() else []


def read_pair(line: dict[str, Any]) -> Pair:
    """The pair of a line of progress."""
    return Pair(*(tuple(map(tuple, line[name])) for name in Pair._fields))


def run(condition: str, progress: Path, minutes: float) -> None:
    """Append chains to the file of progress until the time is over."""
    lines = read(progress)
    end = time.monotonic() + 60 * minutes
    while time.monotonic() < end:
        number = len(lines)
        rng = np.random.default_rng([SEED, number])
        name = list(POLYGONS)[number // 2 % len(POLYGONS)]
        best_lines = sorted((x for x in lines if x["polygon"] == name), key=lambda x: x["value"])[
            :N_BEST_PAIRS
        ]
        # Every other chain goes on from one of the best pairs of its polygon
        if number % 2 and best_lines:
            best = best_lines[int(rng.integers(len(best_lines)))]
            root = best["root"]
            start = read_pair(best)
        else:
            root = number
            start = random_pair(POLYGONS[name], rng)
            while not keeps_condition(condition, POLYGONS[name], start):
                start = random_pair(POLYGONS[name], rng)
        value, pair = run_chain(condition, POLYGONS[name], start, rng)
        line = {"polygon": name, "root": root, "value": value, **pair._asdict()}
        lines.append(line)
        with progress.open("a", encoding="utf-8") as file:
            file.write(json.dumps(line) + "\n")
        print(f"{number} {name} from {root}: {value:.4f}", flush=True)


def find(condition: str, line: dict[str, Any]) -> dict[str, Any]:
    """A pair as it is stored."""
    name = line["polygon"]
    polygon = POLYGONS[name]
    points, nodes = read_pair(line).arc_lengths(polygon)
    mesh = triangulate_from_boundary(polygon, nodes)
    partition = from_points(polygon, points)
    beta = infsup_constants(
        mixed_spaces(condense(mesh), partition).operator, build_dual_norm(partition).gram().p0
    ).beta_upper
    return {
        "name": f"{name}_{line['root']}",
        "what": CONDITIONS[condition],
        "polygon": [list(vertex) for vertex in NOTCH] if name == "notch" else name,
        "smallest_angle": round(smallest_angle(mesh), 1),
        "points": points,
        "nodes": nodes,
        "beta": round(beta, 3),
    }


def best_of_each_root(lines: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The best line of each chain that began with a random pair, and of those that went on from it.

    Those that met no pair without a small angle are left out.
    """
    best = dict[int, dict[str, Any]]()
    for line in sorted(lines, key=lambda x: x["value"]):
        if line["value"] <= MAX_VALUE_WITH_ANGLES:
            best.setdefault(line["root"], line)
    return list(best.values())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("condition", choices=list(CONDITIONS))
    parser.add_argument("progress", metavar="FILE", type=Path)
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--write", action="store_true", help="write the best pairs and do not search")
    options = parser.parse_args()
    if options.write:
        best = best_of_each_root(read(options.progress))[:N_WRITTEN_PAIRS]
        write(f"beta{options.condition}", [find(options.condition, line) for line in best])
    else:
        run(options.condition, options.progress, options.minutes)
