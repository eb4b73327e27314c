"""Packages that only some tasks need, and the line to type for them."""

from __future__ import annotations

from importlib.util import find_spec

from unilateral.errors import InputError

EXTRAS = {
    "gmsh": "mesh",
    "matplotlib": "plot",
    "meshio": "files",
    "netCDF4": "files",
    "pandas": "files",
    "plotly": "plot",
    "xarray": "files",
}
"""Each optional package, by the name of its module, and the extra of pyproject.toml that has it."""


def require(task: str, *packages: str) -> None:
    """Raises InputError with the line to type where one of these packages is not installed.

    The message begins with what the `task` is and its verb. Nothing is imported.

    >>> require("pictures need", "matplotlib")
    """
    missing = find_missing_packages(*packages)
    if missing:
        named = " and ".join(filter(None, [", ".join(missing[:-1]), missing[-1]]))
        raise InputError(f"{task} {named}; type: pip install '{name_requirement(*missing)}'")


def find_missing_packages(*packages: str) -> list[str]:
    """Names of the packages that are not installed, in alphabetical order."""
    return sorted(name for name in {*packages} if find_spec(name) is None)


def name_requirement(*packages: str) -> str:
    """The project's requirement with the extras that bring these packages.

    >>> name_requirement("gmsh", "xarray", "pandas")
    'unilateral[files,mesh]'
    """
    return f"unilateral[{','.join(sorted({EXTRAS[name] for name in packages}))}]"
