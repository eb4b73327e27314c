"""Meshes in files, by meshio, and partitions of the boundary in CSV files."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np

from unilateral.errors import InputError
from unilateral.geometry.foreign import mesh_from
from unilateral.geometry.mesh import Mesh
from unilateral.geometry.partition import Partition, from_points
from unilateral.geometry.polygon import Polygon
from unilateral.system.files import replacing
from unilateral.system.optional import require

SAME = 1e-9
"""Arc lengths that differ by at most this part of the perimeter are the same."""
MALFORMED = "it has no nodes or no triangles, its end is missing, or it is not what its ending says"


def write_mesh(
    mesh: Mesh,
    path: str | os.PathLike[str],
    on_edges: Mapping[str, np.ndarray] | None = None,
    at_nodes: Mapping[str, np.ndarray] | None = None,
) -> None:
    """Writes the triangles and the boundary edges, with their sides as the cell data "side" (triangles: -1).

    Further data of boundary edges (nb,), NaN on triangles, and of nodes (n,) can be added. The file's ending
    says the format, one of meshio's that can hold both; .vtu keeps every bit. In .msh, as text, which all
    of Gmsh's readers take, side i is the physical group i + 1, the triangles are the one after the last
    side's, and edges have no further data.
    Raises InputError if the file cannot be written.
    """
    require("files of meshes need", "meshio")
    import meshio

    n, lines = len(mesh.triangles), np.column_stack([mesh.boundary, np.roll(mesh.boundary, -1)])
    for_gmsh = Path(path).suffix == ".msh"
    further = {name: [np.full(n, np.nan), data] for name, data in (on_edges or {}).items()}
    content = meshio.Mesh(
        np.column_stack([mesh.points, np.zeros(mesh.n_nodes)]),
        [("triangle", mesh.triangles), ("line", lines)],
        point_data=dict(at_nodes or {}),
        cell_data=_groups(mesh) if for_gmsh else {"side": [np.full(n, -1), mesh.side]} | further,
        field_data=_names(mesh) if for_gmsh else {},
    )
    with replacing(path) as temporary:
        try:
            with _quiet():
                if for_gmsh:
                    meshio.write(temporary, content, "gmsh22", binary=False)
                else:
                    meshio.write(temporary, content)
        except OSError:
            raise
        except Exception as error:
            raise InputError(f"{path}: the mesh cannot be written there ({_words(error)})") from error


def _groups(mesh: Mesh) -> dict[str, list[np.ndarray]]:
    """The sides, and all triangles, as Gmsh's physical groups."""
    numbers = [np.full(len(mesh.triangles), mesh.polygon.n_sides + 1), mesh.side + 1]
    return {
        f"gmsh:{kind}": [each.astype(np.int32) for each in numbers] for kind in ("physical", "geometrical")
    }


def _names(mesh: Mesh) -> dict[str, np.ndarray]:
    """The number and the dimension of each group; some readers ask for names."""
    n = mesh.polygon.n_sides
    return {f"side_{i}": np.array([i + 1, 1]) for i in range(n)} | {"domain": np.array([n + 1, 2])}


def read_mesh(path: str | os.PathLike[str], polygon: Polygon | None = None) -> Mesh:
    """The mesh of the triangles in a file of any of meshio's formats, checked as by `from_arrays`.

    If no polygon is given, it is the one that the triangles' boundary forms.
    """
    require("files of meshes need", "meshio")
    import meshio

    try:
        with _quiet():
            content = meshio.read(path)
    except (Exception, SystemExit) as error:
        reason = _words(error) if isinstance(error, OSError | meshio.ReadError) else MALFORMED
        raise InputError(f"{path}: no mesh can be read from this file ({reason})") from error
    return mesh_from(content, polygon=polygon, where=str(path))


def read_partition(path: str | os.PathLike[str], polygon: Polygon) -> Partition:
    """The cells of a CSV file: the columns `start` and `end`, arc lengths anticlockwise from vertex 0.

    Raises InputError, with the file, for what cannot be read, cells that do not join, and as `from_points`.
    """
    require("files of cells need", "pandas")
    import pandas as pd

    try:
        table = pd.read_csv(path, skipinitialspace=True)
        start, end = (table[name].to_numpy(dtype=float) for name in ("start", "end"))
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from None
    except (ValueError, KeyError) as error:
        raise InputError(f"{path}: the columns start and end are needed, a row per cell ({error})") from None
    order = np.argsort(start)
    start, end = start[order], end[order]
    apart = np.flatnonzero(~(np.abs(start[1:] - end[:-1]) <= SAME * polygon.perimeter))
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
def _quiet() -> Iterator[None]:
    """Keeps meshio's own messages off the terminal."""
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        yield


def _words(error: BaseException) -> str:
    return " ".join(str(error).split()).rstrip(".") or type(error).__name__
