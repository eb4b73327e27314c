"""Says whether two trees of results are equal by value, and if not, what differs and by how much.

    python workflow/compare.py BEFORE AFTER [--within 1e-13]

A tree is a folder that holds results/ and figures/, such as a clone in which `make` has run. Compared are
the variables of all tables (but timings, which no two runs share), claims, numbers, and the tables that
figures are drawn from. Attributes, such as versions and parameters, are not compared. The exit code is 0 if
all are equal, else 1.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

MAX_SHOWN_DIFFERENCES = 5
"""So many differences of one file are printed."""


def main() -> int:
    """Print the differences; 1 if there are any, else 0."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("before", type=Path, help="a folder with results/ and figures/")
    parser.add_argument("after", type=Path, help="another one")
    parser.add_argument(
        "--within",
        type=float,
        default=0.0,
        help="largest difference that counts as equal, relative to the largest number of the variable",
    )
    options = parser.parse_args()
    files = [set(list_files(tree)) for tree in (options.before, options.after)]
    if not files[0]:
        parser.error(f"{options.before} has no results/ or figures/ to compare")
    unequal = 0
    for name in sorted(files[0] | files[1]):
        differences = (
            [f"is only in {options.before if name in files[0] else options.after}"]
            if name not in files[0] & files[1]
            else [*compare(options.before / name, options.after / name, options.within)]
        )
        unequal += bool(differences)
        for difference in differences[:MAX_SHOWN_DIFFERENCES]:
            print(f"{name}: {difference}")
        if len(differences) > MAX_SHOWN_DIFFERENCES:
            print(f"{name}: and {len(differences) - MAX_SHOWN_DIFFERENCES} more differences")
    total = len(files[0] | files[1])
    print(f"{total} files compared: {f'{unequal} differ' if unequal else 'all are equal'}")
    return 1 if unequal else 0


def list_files(tree: Path) -> Iterator[str]:
    """The files of a tree that are compared, as paths relative to it."""
    patterns = ("results/**/*.nc", "results/claims.json", "results/numbers.json", "figures/*.csv")
    for pattern in patterns:
        for file in tree.glob(pattern):
            if not file.name.endswith("timings.nc"):
                yield file.relative_to(tree).as_posix()


def compare(before: Path, after: Path, tolerance: float) -> Iterator[str]:
    """The differences of two files, each as a sentence without its subject."""
    old = read(before)
    new = read(after)
    for name in [*old, *(name for name in new if name not in old)]:
        if name not in old or name not in new:
            yield f"{name} is {'gone' if name in old else 'new'}"
        elif difference := difference_between(old[name], new[name], tolerance):
            yield f"{name} {difference}"


def read(file: Path) -> dict[str, np.ndarray]:
    """The arrays of a file by their names: variables with their dimensions, fields of a claim with its id."""
    if file.suffix == ".nc":
        table = xr.load_dataset(file, engine="netcdf4")
        return {
            f"{name}({', '.join(map(str, variable.dims))})": variable.to_numpy()
            for name, variable in table.variables.items()
        }
    if file.suffix == ".csv":
        return {str(name): column.to_numpy() for name, column in pd.read_csv(file).items()}
    content = json.loads(file.read_text(encoding="utf-8"))
    if isinstance(content, list):
        content = {f"{entry['id']}.{field}": value for entry in content for field, value in entry.items()}
    return {name: np.asarray(value) for name, value in content.items()}


def difference_between(old: np.ndarray, new: np.ndarray, tolerance: float) -> str:
    """How two arrays differ; empty if they do not."""
    if old.shape != new.shape:
        return f"has the shape {new.shape} instead of {old.shape}"
    numeric = all(np.issubdtype(array.dtype, np.number) for array in (old, new))
    if not numeric:
        wrong = np.flatnonzero((old != new) & ~(pd.isna(old) & pd.isna(new)))
        return f"is '{new.flat[wrong[0]]}' instead of '{old.flat[wrong[0]]}'" if wrong.size else ""
    unequal = ~((old == new) | (np.isnan(old) & np.isnan(new)))
    if not unequal.any():
        return ""
    scale = np.abs(old[np.isfinite(old)]).max(initial=0.0)
    distance = np.abs(new[unequal] - old[unequal])
    if np.isfinite(distance).all() and distance.max() <= tolerance * scale:
        return ""
    relative = distance.max() / scale if scale else np.inf
    return f"differs in {unequal.sum()} of {old.size} numbers, by at most {relative:.2g} of the largest one"


if __name__ == "__main__":
    sys.exit(main())
