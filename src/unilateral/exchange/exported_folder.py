"""An exported folder, and what another solver hands in for one of its levels."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import numpy as np
from scipy.spatial import cKDTree

from unilateral.arrays import MAX_INPUT_VALUE, Array, Index
from unilateral.errors import InputError, quote_input
from unilateral.exchange.boundary_function import (
    BoundaryFunction,
    piecewise_constant,
    piecewise_linear,
    represent_reactions,
)
from unilateral.fem.form import Form
from unilateral.formulas.taylor import EPS
from unilateral.geometry import partition as partitions
from unilateral.geometry.files import read_mesh, read_partition, read_with_meshio
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon
from unilateral.problems import case as cases

if TYPE_CHECKING:
    from unilateral.problems.problem import Problem

SAME_PLACE_RATIO = 1e-6
"""Places whose distance is at most this fraction of h are the same."""
MAX_PLACE_ROUNDING = 0.01
"""Places may be rounded by this fraction of the shortest edge, far less than nodes are apart."""
NODAL_FIELDS = ("u", "multiplier", "reaction")
"""What may be given at the nodes."""


@dataclass(frozen=True, eq=False)
class ExportedLevel:
    """One level of an exported folder, with the numbers of the sides that are clamped."""

    name: str
    mesh: Mesh
    partition: Partition
    clamped_sides: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class ForeignSolution:
    """u (n,) at the nodes of a level, and a multiplier or None, which was handed in as `multiplier_kind`."""

    file: str
    level: ExportedLevel
    u: Array
    multiplier: BoundaryFunction | None
    multiplier_kind: str


def read_exported_folder(folder: str | os.PathLike[str]) -> tuple[Problem, list[ExportedLevel]]:
    """Case and levels of a folder that `unilateral export` wrote.

    Raises InputError with the file that is missing or damaged.
    """
    folder = Path(folder)
    try:
        problem = json.loads((folder / "problem.json").read_text(encoding="utf-8"))
        polygon = Polygon(np.array(problem["vertices"]), problem["polygon"])
        exact = cases.load_solution(
            folder / f"{_check_plain_name(folder, problem['case'])}.yaml", polygon, problem["side"]
        )
        case = replace(exact.problem, free_sides=tuple(problem["free_sides"]))
        if not problem["levels"]:
            raise ValueError("problem.json names no levels")
        levels = []
        for entry in problem["levels"]:
            name = _check_plain_name(folder, entry["folder"])
            mesh = read_mesh(folder / name / "mesh.vtu", case.polygon)
            partition = read_partition(folder / name / "partition.csv", case.polygon)
            levels.append(ExportedLevel(name, mesh, partition, case.clamped_sides))
        return case, levels
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise InputError(
            f"{folder}: this is not a folder that 'unilateral export' wrote ({error})"
        ) from error


def _check_plain_name(folder: Path, name: object) -> str:
    """A name from problem.json. Raises InputError for one that leads out of the folder."""
    if not isinstance(name, str) or Path(name).name != name or name in ("", ".."):
        raise InputError(
            f"{folder / 'problem.json'}: {quote_input(repr(name))} is not the name of a file in this folder"
        )
    return name


def read_foreign_solution(
    levels: list[ExportedLevel], file: str, multiplier_file: str | None = None
) -> ForeignSolution:
    """The solution in a file, on the level whose nodes it has; its multiplier may be in another file.

    Raises InputError for missing points, another mesh, values that are not finite, and what cannot be read.
    """
    contents = read_solution_file(file)
    points = contents.points
    if points is None or "u" not in contents.nodal_values:
        raise InputError(f"{file}: x, y and u are needed, at all nodes of a level")
    if multiplier_file is not None:
        cells = read_solution_file(multiplier_file).cells
        if cells is None:
            raise InputError(
                f"{multiplier_file}: the columns start, end and multiplier are needed, a row per cell"
            )
        contents = contents._replace(cells=cells)
    level, node = _match_level(levels, points, file)
    values = {name: _order_by_nodes(level, node, contents, name, file) for name in contents.nodal_values}
    trace, kind = _build_multiplier(level, node, contents, values, multiplier_file or file)
    return ForeignSolution(file, level, values["u"], trace, kind)


def read_field_at_nodes(mesh: Mesh, mesh_file: str, file: str, field: str | None = None) -> Array:
    """Nodal values (n,) of a `field` in a file, by default u or the only one, on the mesh of that name.

    Nodes are matched by their places. Without these, or in the file of the mesh, whose nodes may have been
    moved onto sides, values have the order of the nodes. Raises InputError as `read_foreign_solution`.
    """
    contents = read_solution_file(file, field)
    if "u" not in contents.nodal_values:
        mesh_file = quote_input(field or "u")
        raise InputError(f"{file}: there is no {mesh_file} at the nodes; --field names the values to take")
    if contents.points is None or file == mesh_file:
        return contents.nodal_values["u"]
    level = ExportedLevel(mesh_file, mesh, Partition(mesh.polygon, mesh.s))
    _, node = _match_level([level], contents.points, file)
    return _order_by_nodes(level, node, contents, "u", file)


def _match_level(levels: list[ExportedLevel], points: Array, file: str) -> tuple[ExportedLevel, Index]:
    """The level whose nodes the points (k, 2) are, and the node (k,) of each point.

    Raises InputError, for the nearest level, where points are no nodes, and where nodes have no point.
    """
    wrong = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if wrong.size:
        raise InputError(
            f"{file}: point {wrong[0]} has the place {_first_place(points, wrong)}; numbers are needed"
        )
    # on each level: distance and number of the node that is nearest to a point, and nodes without a point
    near = [cKDTree(level.mesh.points).query(points) for level in levels]
    unit = last_digit_unit(points)
    too_far = [
        distance > _max_place_distance(level.mesh, unit)
        for level, (distance, _) in zip(levels, near, strict=True)
    ]
    absent = [
        np.setdiff1d(np.arange(level.mesh.n_nodes), node[~far])
        for level, (_, node), far in zip(levels, near, too_far, strict=True)
    ]
    # the level with the fewest points that are no nodes, and nodes that are missing
    counts = [far.sum() + len(nodes) for far, nodes in zip(too_far, absent, strict=True)]
    best = int(np.argmin(counts))
    level = levels[best]
    distance, node = near[best]
    if too_far[best].any():
        # two coordinates, each with an error of one unit at most
        is_rounding = distance.max() <= math.sqrt(2) * unit
        _refuse_other_mesh(level, points, np.flatnonzero(too_far[best]), is_rounding, file)
    if absent[best].size:
        raise InputError(
            f"{file}: {absent[best].size} of the {level.mesh.n_nodes} nodes of {level.name} are missing, "
            f"the first at {_first_place(level.mesh.points, absent[best])}; u is needed at all of them"
        )
    return level, node


def _refuse_other_mesh(
    nearest_level: ExportedLevel, points: Array, far: Index, is_rounding: bool, file: str
) -> NoReturn:
    """Raise InputError for the points numbered `far`, which are no nodes; `is_rounding` says why not."""
    advice = ", or write places with more digits" if is_rounding else ""
    raise InputError(
        f"{file}: another mesh; {far.size} of its {len(points)} points are no nodes of "
        f"{nearest_level.name}, the most similar level, the first at {_first_place(points, far)}; "
        f"solve on the mesh of a level{advice}"
    )


def last_digit_unit(numbers: Array) -> float:
    """The unit of the last digit that the largest of some numbers from a file has, or a larger one.

    It is 0 for double precision in full.
    """
    numbers = numbers[numbers != 0]
    if not numbers.size:
        return 0.0
    # the fewest significant digits by which all numbers stay; fixed decimals have no larger unit
    magnitude = np.floor(np.log10(np.abs(numbers)))
    for digits in range(1, 16):
        unit = 10.0 ** (magnitude + 1 - digits)
        # up to the rounding of a decimal fraction, and of its quotient by a power of ten, to double precision
        if np.all(np.abs(np.round(numbers / unit) * unit - numbers) <= 4 * EPS * np.abs(numbers)):
            return float(unit.max())
    # as many digits as double precision has, unless the numbers are in single precision
    single = numbers.astype(np.float32)
    return float(np.spacing(np.abs(single).max())) if np.array_equal(single, numbers) else 0.0


def _max_place_distance(mesh: Mesh, unit: float) -> float:
    """Distance up to which places on a mesh are the same, if coordinates have an error of a `unit`."""
    corners = mesh.points[mesh.triangles]
    shortest = float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).min())
    return max(SAME_PLACE_RATIO * mesh.h, min(math.sqrt(2) * unit, MAX_PLACE_ROUNDING * shortest))


def _first_place(points: Array, index: Index) -> tuple[float, ...]:
    """The first of those points."""
    return tuple(points[index[0]].tolist())


def _order_by_nodes(level: ExportedLevel, node: Index, contents: FileContents, name: str, file: str) -> Array:
    """Values (n,) of a field in the order of the nodes, checked where they are needed."""
    field_values = contents.nodal_values[name]
    needed = np.ones(len(node), bool) if name == "u" else np.isin(node, level.mesh.boundary)
    wrong = np.flatnonzero(~(np.abs(field_values) < MAX_INPUT_VALUE) & needed)
    if wrong.size:
        k = wrong[0]
        place = level.mesh.points[node[wrong[0]]]
        raise InputError(
            f"{file}: {name} is {field_values[k]} at point {k}, {tuple(place.tolist())}; "
            f"a number below {MAX_INPUT_VALUE:g} is needed"
        )
    values = np.zeros(level.mesh.n_nodes)
    values[node] = field_values
    # of several points at a node one has written the value; the others have to agree
    twice = np.flatnonzero((values[node] != field_values) & needed)
    if twice.size:
        place = _first_place(level.mesh.points, node[twice])
        raise InputError(f"{file}: {name} has two values at {place}; one is needed")
    return values


def _build_multiplier(
    level: ExportedLevel, node: Index, contents: FileContents, values: dict[str, Array], file: str
) -> tuple[BoundaryFunction | None, str]:
    """The multiplier that was handed in, as a function on the boundary or None, and words on its kind."""
    mesh = level.mesh
    sources = [
        contents.cells is not None,
        contents.edges is not None,
        "multiplier" in values,
        "reaction" in values,
    ]
    if sum(sources) > 1:
        raise InputError(f"{file}: there is more than one multiplier; hand in one")
    if contents.cells is not None:
        return _build_cell_multiplier(level, *contents.cells, file), "constant on cells"
    if contents.edges is not None:
        ends, edge_values = contents.edges
        return piecewise_constant(
            Partition(mesh.polygon, mesh.s), _order_by_boundary_edges(level, node[ends], edge_values, file)
        ), "constant on edges"
    if "multiplier" in values:
        return piecewise_linear(mesh, values["multiplier"][mesh.boundary]), "linear on edges"
    if "reaction" in values:
        # at clamped nodes a reaction is no part of the multiplier
        clamped = Form(clamped=level.clamped_sides).clamped_nodes(mesh)
        reactions = np.where(clamped, 0.0, values["reaction"])[mesh.boundary]
        return represent_reactions(mesh, reactions), "reactions, made a function by the mass matrix"
    return None, "none"


def _build_cell_multiplier(
    level: ExportedLevel, start: Array, end: Array, values: Array, file: str
) -> BoundaryFunction:
    """The multiplier with `values` (m,) on the cells from `start` (m,) to `end` (m,) in arc length.

    Raises InputError for values that are not finite, and for cells that leave a gap or overlap.
    """
    mesh = level.mesh
    order = np.argsort(start)
    start = start[order]
    end = end[order]
    values = _fill_clamped_values(level, mesh.polygon.sides_of(0.5 * (start + end)), values[order])
    tolerance = _max_place_distance(mesh, last_digit_unit(np.append(start, end)))
    breaks = np.flatnonzero(np.abs(start[1:] - end[:-1]) > tolerance)
    if breaks.size:
        raise InputError(
            f"{file}: a cell ends at s = {end[breaks[0]]:g}, the next begins at {start[breaks[0] + 1]:g}"
        )
    wrong = np.flatnonzero(~(np.abs(values) < MAX_INPUT_VALUE))
    if wrong.size:
        raise InputError(
            f"{file}: multiplier is {values[wrong[0]]} on the cell from s = {start[wrong[0]]:g}; "
            f"a number below {MAX_INPUT_VALUE:g} is needed"
        )
    ends = np.append(start, end[-1:])
    if ends.size:
        # ends of cells that are nodes, vertices among them, up to the digits written: the nodes themselves
        node = mesh.s[np.abs(ends[:, None] - mesh.s).argmin(axis=1)]
        ends = np.where(np.abs(ends - node) <= tolerance, node, ends)
    try:
        cells = partitions.from_points(mesh.polygon, ends)
    except InputError as error:
        raise InputError(f"{file}: {error}") from error
    return piecewise_constant(cells, values)


def _fill_clamped_values(level: ExportedLevel, sides: Index, values: Array) -> Array:
    """A multiplier (k,) on the sides (k,), with 0 for NaN on clamped sides, where none is needed."""
    return np.where(np.isnan(values) & np.isin(sides, level.clamped_sides), 0.0, values)


def _order_by_boundary_edges(level: ExportedLevel, end_nodes: Index, values: Array, file: str) -> Array:
    """Values (nb,) of line cells, with their `end_nodes` (e, 2), in the order of the boundary edges."""
    mesh = level.mesh
    nb = len(mesh.boundary)
    boundary_index = np.full(mesh.n_nodes, -1)
    boundary_index[mesh.boundary] = np.arange(nb)
    first, last = boundary_index[end_nodes].T
    # edge e runs from boundary node e to the next; line cells may run either way
    edge = np.where((first + 1) % nb == last, first, last)
    wrong = np.flatnonzero(
        (first < 0) | (last < 0) | ((edge + 1) % nb != np.where(edge == first, last, first))
    )
    if wrong.size:
        raise InputError(f"{file}: line cell {wrong[0]} is no boundary edge of the mesh")
    edge_values = np.full(nb, np.nan)
    edge_values[edge] = values
    edge_values = _fill_clamped_values(level, mesh.side, edge_values)
    wrong = np.flatnonzero(~(np.abs(edge_values) < MAX_INPUT_VALUE))
    if wrong.size:
        place = _first_place(mesh.points, mesh.boundary[wrong])
        raise InputError(
            f"{file}: the boundary edge from {place} has no multiplier, or none below {MAX_INPUT_VALUE:g}"
        )
    return edge_values


class FileContents(NamedTuple):
    """Contents of a file: `points` (k, 2) and `nodal_values` (k,) by name, values on `cells` and `edges`.

    `cells` are starts, ends and values (m,), `edges` the nodes (e, 2) and values (e,). What the file does not
    have is None or not there.
    """

    points: Array | None
    nodal_values: dict[str, Array]
    cells: tuple[Array, Array, Array] | None = None
    edges: tuple[Index, Array] | None = None


def read_solution_file(file: str, field: str | None = None) -> FileContents:
    """Contents of a file that holds a solution: .csv, .nc, or one of meshio's formats.

    Raises InputError if that fails.
    """
    if not Path(file).is_file():
        raise InputError(f"there is no file {file}")
    try:
        if Path(file).suffix == ".csv":
            import pandas as pd

            return _parse_columns(_rename_field(dict(pd.read_csv(file, skipinitialspace=True)), field), file)
        if Path(file).suffix == ".nc":
            import xarray as xr

            with xr.open_dataset(file) as dataset:
                columns = {str(name): variable.to_numpy() for name, variable in dataset.variables.items()}
                return _parse_columns(_rename_field(columns, field), file)
        return _parse_mesh_file(file, field)
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{file}: it cannot be read ({str(error) or type(error).__name__})") from error


def _rename_field(fields: Mapping[str, Any], field: str | None) -> Mapping[str, Any]:
    """The fields with `field` as u; a field of another meaning stays what it is."""
    if field is None or (field in NODAL_FIELDS and field in fields):
        return fields
    remaining = {name: values for name, values in fields.items() if name != field}
    return {**remaining, "u": fields[field]} if field in fields else {}


def _parse_columns(columns: Mapping[str, Any], file: str) -> FileContents:
    """Contents of a file with columns, at nodes or, with start, end and multiplier, on cells."""
    arrays = {
        str(name): np.asarray(columns[name], dtype=float)
        for name in ("x", "y", "start", "end", *NODAL_FIELDS)
        if name in columns
    }
    cells = None
    if {"start", "end", "multiplier"} <= set(arrays):
        cells = arrays["start"], arrays["end"], arrays.pop("multiplier")
    nodal = {name: arrays[name] for name in NODAL_FIELDS if name in arrays}
    if "x" not in arrays or "y" not in arrays:
        if "u" in arrays and len(columns) > 1:  # places under other names would be passed over
            raise InputError(
                f"{file}: there are no columns x and y; name the places so, or give u as the only column, in "
                "the order of the nodes"
            )
        return FileContents(None, nodal, cells)
    return FileContents(np.column_stack([arrays["x"], arrays["y"]]), nodal, cells)


def _parse_mesh_file(file: str, field: str | None) -> FileContents:
    """Contents of a file of meshio's: fields at the nodes of triangles, and a multiplier on its lines."""
    content = read_with_meshio(file)
    names = [*content.point_data]
    if field is None and len(names) == 1 and content.point_data[names[0]].dtype.kind == "f":
        field = names[0]  # integers are numbers of nodes or groups rather than u
    fields = _rename_field(content.point_data, field)
    n = len(content.points)
    nodal = {name: np.reshape(fields[name], n).astype(float) for name in NODAL_FIELDS if name in fields}
    triangles = [block.data[:, :3].ravel() for block in content.cells if block.type.startswith("triangle")]
    if not triangles:
        raise InputError(f"{file}: it has no triangles; u is needed at the nodes of a mesh of triangles")
    # nodes that belong to no triangle are left out; of second order the corners alone belong
    used = np.unique(np.concatenate(triangles))
    number = np.full(len(content.points), -1)
    number[used] = np.arange(len(used))
    edges = None
    if "multiplier" in content.cell_data and "line" in content.cells_dict:
        values = np.ravel(content.cell_data_dict["multiplier"]["line"]).astype(float)
        edges = number[content.cells_dict["line"]], values
    return FileContents(
        content.points[used, :2].astype(float),
        {name: array[used] for name, array in nodal.items()},
        None,
        edges,
    )
