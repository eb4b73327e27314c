"""Meshes in files, by meshio, and partitions of the boundary in CSV files."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from os import PathLike, stat
from pathlib import Path
from typing import Any

import numpy as np

from unilateral.errors import InputError, SolutionWarning, pluralise, quote_input
from unilateral.geometry.foreign import as_mesh, extract_meshio_triangles, find_named_edges
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, from_points
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.triangulation_checks import describe_node
from unilateral.system.files import replacing
from unilateral.system.limit import OutOfTime, run_with_limit
from unilateral.system.optional import require

CELL_JOIN_TOLERANCE = 1e-9
"""Arc lengths that differ by at most this part of the polygon's perimeter are the same."""
READER_SECONDS = 10.0
READER_SECONDS_PER_MB = 5.0
"""Readers have as long as this; the slowest one takes half a second for a megabyte. Some readers of meshio go
on for ever where a file's end is missing."""
MESH_FORMAT_ADVICE = "save the mesh as .msh of Gmsh or as .vtu"
REFUSED_SUFFIXES = {
    ".cgns": "files of CGNS are not read, because meshio reads only those that its older versions wrote",
    ".ele": "files of Triangle and TetGen are not read, because meshio reads only tetrahedra from them",
    ".node": "files of Triangle and TetGen are not read, because meshio reads only tetrahedra from them",
    ".wkt": "files of WKT are not read, because their reader may never end and cannot be stopped",
}
"""Endings of files that are not given to meshio, and why."""
FREEFEM_FIRST_LINE = re.compile(r"\s*\d+\s+\d+\s+\d+\s*")
DECIMAL_COMMA = re.compile(r"(^|\s)-?\d+,\d+(\s|$)")
COMMA_FREE_SUFFIXES = (".avs", ".mesh", ".msh", ".off", ".su2", ".vol", ".vtk")


def write_mesh(
    mesh: Mesh,
    path: str | PathLike[str],
    edge_data: Mapping[str, np.ndarray] | None = None,
    node_data: Mapping[str, np.ndarray] | None = None,
    triangle_data: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Writes the triangles and the boundary edges, with their sides as the cell data "side" (triangles: -1).

    Further data of boundary edges (nb,) and of triangles (m,), NaN on the other cells, and of nodes (n,) can
    be added. The file's ending says the format, one of meshio's that can hold both; .vtu keeps every bit. In
    .msh, as text, which all of Gmsh's readers take, side i is the physical group i + 1, the triangles are the
    one after the last side's, and edges have no further data.
    Raises InputError if the file cannot be written.
    """
    require("files of meshes need", "meshio")
    import meshio

    options: dict[str, Any] = {}
    names: dict[str, np.ndarray] = {}
    cell_data = _cell_data(mesh, edge_data or {}, triangle_data or {})
    if Path(path).suffix == ".msh":
        cell_data, names = _gmsh_groups(mesh)
        options = {"file_format": "gmsh22", "binary": False}
    lines = np.column_stack([mesh.boundary, np.roll(mesh.boundary, -1)])
    content = meshio.Mesh(
        np.column_stack([mesh.points, np.zeros(mesh.n_nodes)]),
        [("triangle", mesh.triangles), ("line", lines)],
        point_data=dict(node_data or {}),
        cell_data=cell_data,
        field_data=names,
    )
    with replacing(path) as temporary:
        try:
            with _silence_output(StringIO()):
                meshio.write(temporary, content, **options)
        except OSError:
            raise
        except Exception as error:
            raise InputError(f"{path}: the mesh cannot be written there ({_one_line(error)})") from error


def _gmsh_groups(mesh: Mesh) -> tuple[dict[str, list[np.ndarray]], dict[str, np.ndarray]]:
    """The numbers of gmsh's groups on the triangles and boundary edges, and the groups by their names.

    A name, which some readers ask for, has the group's number and dimension.
    """
    sides = mesh.polygon.n_sides
    numbers = [np.full(len(mesh.triangles), sides + 1, np.int32), (mesh.side + 1).astype(np.int32)]
    names = {f"side_{i}": np.array([i + 1, 1]) for i in range(sides)}
    names["domain"] = np.array([sides + 1, 2])
    return {"gmsh:physical": numbers, "gmsh:geometrical": numbers}, names


def _cell_data(
    mesh: Mesh, edge_data: Mapping[str, np.ndarray], triangle_data: Mapping[str, np.ndarray]
) -> dict[str, list[np.ndarray]]:
    """The sides and further data, those of the triangles (m,) and of the boundary edges (nb,)."""
    no_triangle_data = np.full(len(mesh.triangles), np.nan)
    no_edge_data = np.full(len(mesh.boundary), np.nan)
    cell_data = {"side": [np.full(len(mesh.triangles), -1), mesh.side]}
    cell_data |= {name: [no_triangle_data, data] for name, data in edge_data.items()}
    return cell_data | {name: [data, no_edge_data] for name, data in triangle_data.items()}


def read_mesh(path: str | PathLike[str], polygon: Polygon | None = None, corners_only: bool = False) -> Mesh:
    """The mesh of the triangles in a file of meshio's formats, checked as by `from_arrays`.

    If no polygon is given, it is the one that the triangles' boundary forms. Nodes of no triangle are left
    out, and a SolutionWarning tells of them. Of triangles of second order the `corners_only` can be taken.
    """
    where = str(path)
    content = read_with_meshio(path)
    second_order = corners_only and any(block.type == "triangle6" for block in content.cells)
    points, triangles = extract_meshio_triangles(content, where, corners_only)
    in_range = (triangles >= 0) & (triangles < len(points))
    used = np.unique(triangles[in_range])
    # numbers out of range are left to as_mesh to refuse, as the file has them
    if len(used) == len(points) or not in_range.all():
        return as_mesh(points, triangles, polygon, where, find_named_edges(content))
    unused = np.setdiff1d(np.arange(len(points)), used)
    dropped = pluralise(len(unused), "node of no triangle is", "nodes of no triangle are")
    message = (
        "its triangles are of second order; the linear function with the values at their corners is used"
        if second_order
        else f"{dropped} left out, such as node {describe_node(points[:, :2], int(unused[0]))}; the other "
        "nodes are numbered anew"
    )
    warnings.warn(f"{where}: {message}", SolutionWarning, stacklevel=3)
    named = {
        name: np.searchsorted(used, pairs[np.isin(pairs, used).all(axis=1)])
        for name, pairs in find_named_edges(content).items()
    }
    return as_mesh(points[used], np.searchsorted(used, triangles), polygon, where, named)


def read_with_meshio(path: str | PathLike[str]) -> Any:
    """The mesh object that meshio reads from the file.

    Raises InputError, with what happened, for what it cannot read.
    """
    require("files of meshes need", "meshio")
    import meshio

    suffix = Path(path).suffix.lower()
    printed = StringIO()
    cause: BaseException
    try:
        size = stat(path).st_size
        if size == 0:
            raise InputError(f"{path}: the file is empty; a mesh of plain triangles is needed")
        if suffix in REFUSED_SUFFIXES:
            raise InputError(f"{path}: {REFUSED_SUFFIXES[suffix]}; {MESH_FORMAT_ADVICE}")
        seconds = READER_SECONDS + READER_SECONDS_PER_MB * size / 1e6
        with _silence_output(printed):
            return run_with_limit(lambda: meshio.read(path), seconds)
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from None
    except ModuleNotFoundError as error:
        raise InputError(
            f"{path}: files that end in {suffix} need {error.name}; type: pip install {error.name}"
        ) from error
    except OutOfTime as error:
        cause = error
        why = "reading it does not end; the file may be cut off"
    except (Exception, SystemExit) as error:  # of several readers, for files of any content
        cause = error
        why = _find_usual_fault(path, suffix) or _explain_stop(error, printed.getvalue())
    raise InputError(
        f"{path}: no mesh can be read from this file, because {why}; {MESH_FORMAT_ADVICE}"
    ) from cause


def _find_usual_fault(path: str | PathLike[str], suffix: str) -> str:
    """The usual fault of a text file that meshio could not read, as words for a message, or ""."""
    if suffix not in COMMA_FREE_SUFFIXES:
        return ""
    with open(path, encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            if number == 1 and suffix == ".msh" and FREEFEM_FIRST_LINE.fullmatch(line):
                return "it is a .msh of FreeFEM, and only .mesh of FreeFEM is read"
            if DECIMAL_COMMA.search(line):
                return f"line {number} has a number with a decimal comma, '{quote_input(line.strip())}'"
    return ""


def _explain_stop(error: BaseException, printed: str) -> str:
    """The reason why meshio stopped, as words for a message."""
    if isinstance(error, SystemExit):
        return re.sub("Error: Couldn't read file .* as", "meshio cannot read it as", _one_line(printed))
    import meshio

    if isinstance(error, meshio.ReadError) and str(error):
        return _one_line(error)
    cause = type(error).__name__ + (f": {_one_line(error)}" if str(error) else "")
    return f"it is cut off, or has not the format of its ending (meshio stopped with {cause})"


def read_partition(path: str | PathLike[str], polygon: Polygon) -> Partition:
    """The cells of a CSV file: the columns `start` and `end`, arc lengths anticlockwise from vertex 0.

    Raises InputError, with the file, for what cannot be read, cells that do not join, and as `from_points`.
    """
    require("files of cells need", "pandas")
    import pandas as pd

    try:
        table = pd.read_csv(path, skipinitialspace=True)
        start = table["start"].to_numpy(dtype=float)
        end = table["end"].to_numpy(dtype=float)
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from None
    except (ValueError, KeyError) as error:
        raise InputError(f"{path}: the columns start and end are needed, a row per cell ({error})") from None
    order = np.argsort(start)
    start = start[order]
    end = end[order]
    apart = np.flatnonzero(~(np.abs(start[1:] - end[:-1]) <= CELL_JOIN_TOLERANCE * polygon.perimeter))
    if apart.size:
        first = apart[0]
        raise InputError(
            f"{path}: a cell ends at s = {end[first]:g}, the next begins at {start[first + 1]:g}; cells have "
            "to follow one another"
        )
    try:
        return from_points(polygon, np.append(start, end[-1:]))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


@contextmanager
def _silence_output(printed: StringIO) -> Iterator[None]:
    """Keeps meshio's own messages and warnings off the terminal."""
    with redirect_stdout(printed), redirect_stderr(printed), warnings.catch_warnings(action="ignore"):
        yield


def _one_line(message: object) -> str:
    """A message in one line, without the full stop at its end."""
    return " ".join(str(message).split()).rstrip(".") or type(message).__name__
