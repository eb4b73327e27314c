"""An exported folder, and what another solver hands in for one of its levels."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from unilateral.arrays import LARGEST_VALUE, Array, Index
from unilateral.errors import InputError, shown
from unilateral.exchange.boundary_function import Trace, constant, continuous, of_reactions
from unilateral.fem.form import Form
from unilateral.formulas.taylor import EPS
from unilateral.geometry import partition as partitions
from unilateral.geometry.files import read_content, read_mesh, read_partition
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon
from unilateral.problems import case as cases

if TYPE_CHECKING:
    from unilateral.problems.problem import Problem

SAME = 1e-6
"""Places whose distance is at most this fraction of h are the same."""
ROUNDED = 0.01
"""Places may be rounded by this fraction of the shortest edge, far less than nodes are apart."""
NODAL = ("u", "multiplier", "reaction")
"""What may be given at the nodes."""


@dataclass(frozen=True, eq=False)
class ExportedLevel:
    """One level of an exported folder, with the numbers of the sides that are clamped."""

    name: str
    mesh: Mesh
    cells: Partition
    clamped: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class Foreign:
    """u (n,) at the nodes of a level, and a multiplier if there is one; `kind` says what it was."""

    file: str
    level: ExportedLevel
    u: Array
    multiplier: Trace | None
    kind: str


def exported(folder: str | os.PathLike[str]) -> tuple[Problem, list[ExportedLevel]]:
    """What `export` wrote. Raises InputError with the file that is missing or damaged."""
    folder = Path(folder)
    try:
        problem = json.loads((folder / "problem.json").read_text(encoding="utf-8"))
        polygon = Polygon(np.array(problem["vertices"]), problem["polygon"])
        found = cases.load(folder / f"{_plain(folder, problem['case'])}.yaml", polygon, problem["side"])
        case = replace(found.problem, free_sides=tuple(problem["free_sides"]))
        if not problem["levels"]:
            raise ValueError("problem.json names no levels")
        return case, [_level(folder, case, _plain(folder, entry["folder"])) for entry in problem["levels"]]
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(
            f"{folder}: this is not a folder that 'unilateral export' wrote ({error})"
        ) from error


def _plain(folder: Path, name: object) -> str:
    """A name from problem.json. Raises InputError for one that leads out of the folder."""
    if not isinstance(name, str) or Path(name).name != name or name in ("", ".."):
        raise InputError(
            f"{folder / 'problem.json'}: {shown(repr(name))} is not the name of a file in this folder"
        )
    return name


def _level(folder: Path, case: Problem, name: str) -> ExportedLevel:
    mesh = read_mesh(folder / name / "mesh.vtu", case.polygon)
    cells = read_partition(folder / name / "partition.csv", case.polygon)
    return ExportedLevel(name, mesh, cells, case.clamped_sides)


def foreign(levels: list[ExportedLevel], file: str, multiplier: str | None = None) -> Foreign:
    """The solution in a file, on the level whose nodes it has; its multiplier may be in another file.

    Raises InputError for missing points, another mesh, values that are not finite, and what cannot be read.
    """
    found = handed(file)
    points = found.points
    if points is None or "u" not in found.nodal:
        raise InputError(f"{file}: x, y and u are needed, at all nodes of a level")
    if multiplier is not None:
        cells = handed(multiplier).cells
        if cells is None:
            raise InputError(
                f"{multiplier}: the columns start, end and multiplier are needed, a row per cell"
            )
        found = found._replace(cells=cells)
    level, node = _matched(levels, points, file)
    values = {name: _at_nodes(level, node, found, name, file) for name in found.nodal}
    trace, kind = _multiplier(level, node, found, values, multiplier or file)
    return Foreign(file, level, values["u"], trace, kind)


def nodal_values_on(mesh: Mesh, name: str, file: str, field: str | None = None) -> Array:
    """Nodal values (n,) of a `field` in a file, by default u or the only one, on the mesh of that name.

    Nodes are matched by their places. Without these, or in the file of the mesh, whose nodes may have been
    moved onto sides, values have the order of the nodes. Raises InputError as `foreign`.
    """
    found = handed(file, field)
    if "u" not in found.nodal:
        name = shown(field or "u")
        raise InputError(f"{file}: there is no {name} at the nodes; --field names the values to take")
    if found.points is None or file == name:
        return found.nodal["u"]
    level = ExportedLevel(name, mesh, Partition(mesh.polygon, mesh.s))
    _, node = _matched([level], found.points, file)
    return _at_nodes(level, node, found, "u", file)


def _matched(levels: list[ExportedLevel], points: Array, file: str) -> tuple[ExportedLevel, Index]:
    """The level, and the node of each point (k,)."""
    wrong = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if wrong.size:
        raise InputError(
            f"{file}: point {wrong[0]} has the place {_place(points, wrong)}; numbers are needed"
        )
    near = [cKDTree(level.mesh.points).query(points) for level in levels]
    unit = last_digit(points)
    off = [distance > _same(level.mesh, unit) for level, (distance, _) in zip(levels, near, strict=True)]
    absent = [
        np.setdiff1d(np.arange(level.mesh.n_nodes), node[~far])
        for level, (_, node), far in zip(levels, near, off, strict=True)
    ]
    best = int(np.argmin([far.sum() + len(lost) for far, lost in zip(off, absent, strict=True)]))
    level = levels[best]
    far = np.flatnonzero(off[best])
    lost = absent[best]
    if far.size:
        rounded = near[best][0].max() <= math.sqrt(2) * unit
        digits = ", or write places with more digits" if rounded else ""
        raise InputError(
            f"{file}: another mesh; {far.size} of its {len(points)} points are no nodes of {level.name}, the "
            f"nearest one, the first at {_place(points, far)}; solve on that mesh{digits}"
        )
    if lost.size:
        raise InputError(
            f"{file}: {lost.size} of the {level.mesh.n_nodes} nodes of {level.name} are missing, the first "
            f"at {_place(level.mesh.points, lost)}; u is needed at all of them"
        )
    return level, near[best][1]


def last_digit(numbers: Array) -> float:
    """The unit of the last digit that the largest of some numbers from a file has, or a larger one.

    They have as few significant digits as leave all of them as they are; with a fixed number of decimals
    that unit is no smaller either. It is 0 for double precision in full.
    """
    numbers = numbers[numbers != 0]
    if not numbers.size:
        return 0.0
    magnitude = np.floor(np.log10(np.abs(numbers)))
    for digits in range(1, 16):
        unit = 10.0 ** (magnitude + 1 - digits)
        # up to the rounding of a decimal fraction, and of its quotient by a power of ten, to double precision
        if np.all(np.abs(np.round(numbers / unit) * unit - numbers) <= 4 * EPS * np.abs(numbers)):
            return float(unit.max())
    single = numbers.astype(np.float32)
    return float(np.spacing(np.abs(single).max())) if np.array_equal(single, numbers) else 0.0


def _same(mesh: Mesh, unit: float) -> float:
    """How far apart the same places on a mesh may be, if coordinates have an error of a `unit`."""
    corners = mesh.points[mesh.triangles]
    shortest = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).min())
    return max(SAME * mesh.h, min(math.sqrt(2) * unit, ROUNDED * shortest))


def _place(points: Array, index: Index) -> tuple[float, ...]:
    """The first of those points."""
    return tuple(points[index[0]].tolist())


def _at_nodes(level: ExportedLevel, node: Index, found: Handed, name: str, file: str) -> Array:
    """(n,) values at the nodes; multipliers are needed on the boundary only."""
    given = found.nodal[name]
    needed = np.ones(len(node), bool) if name == "u" else np.isin(node, level.mesh.boundary)
    wrong = np.flatnonzero(~(np.abs(given) < LARGEST_VALUE) & needed)
    if wrong.size:
        k = wrong[0]
        place = level.mesh.points[node[wrong[0]]]
        raise InputError(
            f"{file}: {name} is {given[k]} at point {k}, {tuple(place.tolist())}; "
            f"a number below {LARGEST_VALUE:g} is needed"
        )
    values = np.zeros(level.mesh.n_nodes)
    values[node] = given
    twice = np.flatnonzero((values[node] != given) & needed)
    if twice.size:
        place = _place(level.mesh.points, node[twice])
        raise InputError(f"{file}: {name} has two values at {place}; one is needed")
    return values


def _multiplier(
    level: ExportedLevel, node: Index, found: Handed, values: dict[str, Array], file: str
) -> tuple[Trace | None, str]:
    mesh = level.mesh
    given = [found.cells is not None, found.edges is not None, "multiplier" in values, "reaction" in values]
    if sum(given) > 1:
        raise InputError(f"{file}: there is more than one multiplier; hand in one")
    if found.cells is not None:
        return _of_cells(level, *found.cells, file), "constant on cells"
    if found.edges is not None:
        ends, at = found.edges
        return constant(
            Partition(mesh.polygon, mesh.s), _on_edges(level, node[ends], at, file)
        ), "constant on edges"
    if "multiplier" in values:
        return continuous(mesh, values["multiplier"][mesh.boundary]), "linear on edges"
    if "reaction" in values:
        kept = np.where(Form(clamped=level.clamped).fixed(mesh), 0.0, values["reaction"])[mesh.boundary]
        return of_reactions(mesh, kept), "reactions, made a function by the mass matrix"
    return None, "none"


def _of_cells(level: ExportedLevel, start: Array, end: Array, values: Array, file: str) -> Trace:
    mesh = level.mesh
    order = np.argsort(start)
    start = start[order]
    end = end[order]
    values = _where_wanted(level, mesh.polygon.sides_of(0.5 * (start + end)), values[order])
    same = _same(mesh, last_digit(np.append(start, end)))
    apart = np.flatnonzero(np.abs(start[1:] - end[:-1]) > same)
    if apart.size:
        raise InputError(
            f"{file}: a cell ends at s = {end[apart[0]]:g}, the next begins at {start[apart[0] + 1]:g}"
        )
    wrong = np.flatnonzero(~(np.abs(values) < LARGEST_VALUE))
    if wrong.size:
        raise InputError(
            f"{file}: multiplier is {values[wrong[0]]} on the cell from s = {start[wrong[0]]:g}; "
            f"a number below {LARGEST_VALUE:g} is needed"
        )
    ends = np.append(start, end[-1:])
    if ends.size:
        # Ends of cells that are nodes, vertices among them, up to the digits written: the nodes themselves.
        node = mesh.s[np.abs(ends[:, None] - mesh.s).argmin(axis=1)]
        ends = np.where(np.abs(ends - node) <= same, node, ends)
    try:
        cells = partitions.from_points(mesh.polygon, ends)
    except InputError as error:
        raise InputError(f"{file}: {error}") from error
    return constant(cells, values)


def _where_wanted(level: ExportedLevel, side: Index, values: Array) -> Array:
    """A multiplier (k,) on the sides (k,), with 0 for NaN on clamped sides: nothing is asked of it there."""
    return np.where(np.isnan(values) & np.isin(side, level.clamped), 0.0, values)


def _on_edges(level: ExportedLevel, ends: Index, values: Array, file: str) -> Array:
    """(nb,) values of boundary edges, from line cells with those end nodes (k, 2) in any order."""
    mesh = level.mesh
    nb = len(mesh.boundary)
    at = np.full(mesh.n_nodes, -1)
    at[mesh.boundary] = np.arange(nb)
    first, last = at[ends].T
    edge = np.where((first + 1) % nb == last, first, last)
    wrong = np.flatnonzero(
        (first < 0) | (last < 0) | ((edge + 1) % nb != np.where(edge == first, last, first))
    )
    if wrong.size:
        raise InputError(f"{file}: line cell {wrong[0]} is no boundary edge of the mesh")
    found = np.full(nb, np.nan)
    found[edge] = values
    found = _where_wanted(level, mesh.side, found)
    wrong = np.flatnonzero(~(np.abs(found) < LARGEST_VALUE))
    if wrong.size:
        place = _place(mesh.points, mesh.boundary[wrong])
        raise InputError(
            f"{file}: the boundary edge from {place} has no multiplier, or none below {LARGEST_VALUE:g}"
        )
    return found


class Handed(NamedTuple):
    """`points` (k, 2) with `nodal` values (k,); `cells`: start, end, value (m,); `edges`: ends (e, 2), value.

    What the file does not have is None or not there.
    """

    points: Array | None
    nodal: dict[str, Array]
    cells: tuple[Array, Array, Array] | None = None
    edges: tuple[Index, Array] | None = None


def handed(file: str, field: str | None = None) -> Handed:
    """What a file holds, .csv, .nc, or one of meshio's; `field` is u. Raises InputError if that fails."""
    if not Path(file).is_file():
        raise InputError(f"there is no file {file}")
    try:
        if Path(file).suffix == ".csv":
            import pandas as pd

            return _of_columns(_renamed(dict(pd.read_csv(file, skipinitialspace=True)), field), file)
        if Path(file).suffix == ".nc":
            import xarray as xr

            with xr.open_dataset(file) as dataset:
                columns = {str(name): of.to_numpy() for name, of in dataset.variables.items()}
                return _of_columns(_renamed(columns, field), file)
        return _of_mesh(file, field)
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{file}: it cannot be read ({str(error) or type(error).__name__})") from error


def _renamed(fields: Mapping[str, Any], field: str | None) -> Mapping[str, Any]:
    """The fields with `field` as u; a field of another meaning stays what it is."""
    if field is None or (field in NODAL and field in fields):
        return fields
    others = {name: values for name, values in fields.items() if name != field}
    return {**others, "u": fields[field]} if field in fields else {}


def _of_columns(columns: Mapping[str, Any], file: str) -> Handed:
    found = {
        str(name): np.asarray(columns[name], dtype=float)
        for name in ("x", "y", "start", "end", *NODAL)
        if name in columns
    }
    cells = None
    if {"start", "end", "multiplier"} <= set(found):
        cells = found["start"], found["end"], found.pop("multiplier")
    nodal = {name: found[name] for name in NODAL if name in found}
    if "x" not in found or "y" not in found:
        if "u" in found and len(columns) > 1:  # places under other names would be passed over
            raise InputError(
                f"{file}: there are no columns x and y; name the places so, or give u as the only column, in "
                "the order of the nodes"
            )
        return Handed(None, nodal, cells)
    return Handed(np.column_stack([found["x"], found["y"]]), nodal, cells)


def _of_mesh(file: str, field: str | None) -> Handed:
    content = read_content(file)
    names = [*content.point_data]
    if field is None and len(names) == 1 and content.point_data[names[0]].dtype.kind == "f":
        field = names[0]  # integers are numbers of nodes or groups rather than u
    fields = _renamed(content.point_data, field)
    n = len(content.points)
    nodal = {name: np.reshape(fields[name], n).astype(float) for name in NODAL if name in fields}
    triangles = [block.data[:, :3].ravel() for block in content.cells if block.type.startswith("triangle")]
    if not triangles:
        raise InputError(f"{file}: it has no triangles; u is needed at the nodes of a mesh of triangles")
    used = np.unique(np.concatenate(triangles))
    number = np.full(len(content.points), -1)
    number[used] = np.arange(len(used))
    edges = None
    if "multiplier" in content.cell_data and "line" in content.cells_dict:
        values = np.ravel(content.cell_data_dict["multiplier"]["line"]).astype(float)
        edges = number[content.cells_dict["line"]], values
    return Handed(
        content.points[used, :2].astype(float), {name: of[used] for name, of in nodal.items()}, None, edges
    )
