"""A solution as a netCDF file, and back.

A file has what readers look for, by the CF conventions (`tables`), and a group with the rest of what makes
the solution again: the problem, the first mesh and how it was refined, what the solver told. Where k or c is
not 1 the group has the arrays of the scaled domain, too. Bounds, true errors and forces are computed again.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from unilateral.accuracy.goal import Goal
from unilateral.accuracy.level import Level, Summary
from unilateral.accuracy.search import Search
from unilateral.arrays import Array
from unilateral.discrete.base import NO_LOAD, DiscreteSolution, Facts, KeptProblem
from unilateral.discrete.loads import form_of
from unilateral.errors import InputError
from unilateral.geometry.mesh import Mesh, replayed, similar
from unilateral.geometry.partition import Partition
from unilateral.geometry.polygon import Polygon
from unilateral.geometry.triangulation_checks import check_areas
from unilateral.problems.record import of_record, on_mesh, record
from unilateral.problems.scaled import scaled
from unilateral.solution import tables
from unilateral.solution.solution import Solution
from unilateral.solvers.uzawa import DualResult
from unilateral.system.files import write_netcdf
from unilateral.system.optional import require

if TYPE_CHECKING:
    import xarray as xr

GROUP = "solved"
FORMAT = 2
"""The number of this format; files of another one are refused."""
FACE = ("x", "y", "triangles", "u", "start", "end", "multiplier")
"""The variables for readers that the solution is made of, too."""

NO_EDGES = np.empty((0, 2), dtype=np.int32)

Arrays = dict[str, np.ndarray]


def write(solution: Solution, path: Path) -> None:
    """Writes the file."""
    table = solution.dataset()
    of = solution.solved.discrete
    arrays = {name: table[name].to_numpy() for name in FACE}
    scaled_arrays = _face(of.mesh, of.partition, solution.solved.u_h, solution.solved.lambda_H)
    group = {name: of for name, of in scaled_arrays.items() if not np.array_equal(of, arrays[name])}
    group |= _history(of.mesh) | {"g_means": of.g_means}
    if solution.solved.potential is not None:
        group["potential"] = solution.solved.potential
    problem = solution.problem
    if problem.f_at_nodes is not None:
        group["f_at_nodes"] = problem.f_at_nodes
    text = json.dumps(_record(solution))
    write_netcdf(table, path)
    attributes = {"record": text, "sha256": _digest(text, arrays | group)}
    write_netcdf(tables.group(group, attributes), path, group=GROUP, mode="a")


def read(path: Path) -> Solution:
    """The solution in a file that `write` wrote; raises InputError for any other, and for a damaged one."""
    root, group = _tables(path)
    text = str(group.attrs.get("record", ""))
    arrays = {name: root[name].to_numpy() for name in FACE if name in root}
    arrays |= {str(name): of.to_numpy() for name, of in group.variables.items()}
    if _digest(text, arrays) != group.attrs.get("sha256"):
        raise InputError(f"{path} is damaged or was changed, for it has another SHA-256 than it says")
    known = json.loads(text)
    if known["format"] != FORMAT:
        raise InputError(
            f"{path} is of format {known['format']}, by unilateral {known['version']}; this version reads "
            f"format {FORMAT}"
        )
    return _solution(known, arrays, path)


def _tables(path: Path) -> tuple[xr.Dataset, xr.Dataset]:
    """The variables for readers and the group, as they are stored."""
    require("files that end in .nc need", "netCDF4", "xarray")
    import xarray as xr

    try:
        if not path.is_file():
            raise InputError(f"there is no file {path}")
        root, group = (
            xr.load_dataset(path, engine="netcdf4", group=name, decode_cf=False) for name in (None, GROUP)
        )
    except InputError:
        raise
    except Exception as error:  # of several libraries, for files of any content
        raise InputError(
            f"{path} holds no solution; a file that s.save('name.nc') wrote is needed ({error})"
        ) from None
    return root, group


def _digest(text: str, arrays: Mapping[str, np.ndarray]) -> str:
    found = hashlib.sha256(text.encode())
    for name, values in sorted(arrays.items()):
        found.update(f"{name} {values.dtype.str} {values.shape} ".encode())
        found.update(np.ascontiguousarray(values).data)
    return found.hexdigest()


def _face(mesh: Mesh, cells: Partition, u_h: Array, lambda_H: Array) -> Arrays:
    """The arrays of `FACE`."""
    (x, y), s = mesh.points.T, cells.points
    triangles = mesh.triangles.astype(np.int32)
    return dict(zip(FACE, (x, y, triangles, u_h, s[:-1], s[1:], lambda_H), strict=True))


def _history(mesh: Mesh) -> Arrays:
    """The first mesh, and the ends (k, 2) of the edges that were halved, so many in each step."""
    first = mesh.coarse or mesh
    found: Arrays = {
        "first_triangles": first.triangles.astype(np.int32),
        "first_boundary": first.boundary.astype(np.int32),
        "first_s": first.s,
        "s": mesh.s,
    }
    if not mesh.steps:
        return found
    halved = [step.ends for step in mesh.steps]
    return found | {
        "halved": np.concatenate(halved),
        "halved_in_step": np.array([len(ends) for ends in halved], dtype=np.int32),
    }


def _record(solution: Solution) -> dict[str, Any]:
    """All that is no array."""
    solved, search = solution.solved, solution.search
    result = {name: value for name, value in vars(solved.result).items() if name != "lambda_H"}
    return {
        "format": FORMAT,
        "version": version("unilateral"),
        "problem": record(solution.problem),
        "tolerance": solved.tolerance,
        "result": result,
        "facts": {"unique": solved.facts.unique, "beta": solved.facts.beta},
        "believed": search is None or bool(search.believed),
        "search": _of_search(search) if search else None,
    }


def _of_search(search: Search) -> dict[str, Any]:
    return {
        "goal": asdict(search.best.goal),
        "ended": search.ended,
        "refusal": str(search.refusal) if search.refusal else None,
        "reach": search.reach,
        "told": search.summaries,
    }


def _solution(known: dict[str, Any], arrays: Arrays, path: Path) -> Solution:
    problem = of_record(known["problem"], arrays.get("f_at_nodes"))
    _check_finite(path, x=arrays["x"], y=arrays["y"], s=arrays["s"])
    mesh = _mesh(scaled(problem).polygon, arrays)
    check_areas(mesh.points, mesh.triangles, str(path))
    if not np.array_equal(mesh.triangles, arrays["triangles"]):
        raise InputError(
            f"{path}: unilateral {known['version']}, which wrote it, refined meshes in another way than this "
            "version; open it there"
        )
    if known["problem"].get("on_mesh"):
        problem = on_mesh(problem, similar(mesh, problem.polygon))
    of_v = scaled(problem)
    data = of_v if known["believed"] else None
    partition = Partition(mesh.polygon, np.append(arrays["start"], arrays["end"][-1]))
    without = [*problem.free_sides, *problem.clamped_sides]
    cells, lambda_H = np.flatnonzero(~np.isin(partition.side, without)), arrays["multiplier"]
    _check_finite(path, u=arrays["u"], multiplier=lambda_H[cells])
    # No lower bound on ||lambda_H||_-1/2 is read, for an accuracy of lambda would be certified by it
    facts, g_means = Facts(**known["facts"] | {"lambda_norm": 0.0}), arrays["g_means"]
    form = form_of(of_v, mesh)
    discrete = KeptProblem(mesh, partition, cells, NO_LOAD, g_means, facts, data=data, form=form)
    result = DualResult(lambda_H=lambda_H[cells], **known["result"])
    potential = arrays.get("potential")
    solved = DiscreteSolution(discrete, result, known["tolerance"], lambda_H, arrays["u"], potential)
    return Solution(solved, problem, _search(known["search"], solved) if known["search"] else None)


def _check_finite(path: Path, **variables: Array) -> None:
    """Raises InputError for a variable of the file that has no finite number somewhere."""
    for name, values in variables.items():
        wrong = np.flatnonzero(~np.isfinite(values))
        if wrong.size:
            raise InputError(
                f"{path}: the variable {name} is {values[wrong[0]]} at {wrong[0]}; it has to be finite"
            )


def _mesh(polygon: Polygon, arrays: Arrays) -> Mesh:
    """The mesh, refined as it was; the first one if that cannot be done."""
    points, halved = np.column_stack([arrays["x"], arrays["y"]]), arrays.get("halved", NO_EDGES)
    triangles, boundary = (arrays[f"first_{name}"].astype(np.intp) for name in ("triangles", "boundary"))
    first = Mesh(polygon, points[: len(points) - len(halved)], triangles, boundary, arrays["first_s"])
    if not len(halved):
        return first
    steps = np.split(halved, np.cumsum(arrays["halved_in_step"])[:-1])
    try:
        return replayed(polygon, points, arrays["s"], first, steps)
    except KeyError:
        return first


def _search(known: dict[str, Any], solved: DiscreteSolution) -> Search:
    """The search with the level that the file holds."""
    level = Level(solved, Goal(**known["goal"]), seconds=math.nan)
    refusal = InputError(known["refusal"]) if known["refusal"] else None
    told = tuple(Summary(*each) for each in known["told"])
    return Search([level], known["ended"], refusal, reach=known["reach"], told=told)
