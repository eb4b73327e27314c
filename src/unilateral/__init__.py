"""The mixed finite element method of Haslinger and Lovíšek (1980) for unilateral problems, verified.

>>> import unilateral as ul
>>> s = ul.solve(ul.case("natural"), h=1 / 16, H=1 / 8)
>>> s.errors.h1 <= s.bounds.u
True

Public names live in `api` and are imported lazily; `__init__.pyi` lists them. The method is in `formulas`,
`geometry`, `problems`, `fem`, `solvers`, `norms`, `bounds`, and on them `discrete`, `adaptive` and
`solution`. `cli` is the command line.
"""

from importlib import import_module
from typing import Any

PUBLIC = dict.fromkeys(("BudgetError", "InputError", "SolutionWarning"), "errors")
PUBLIC |= {"Polygon": "geometry.polygon", "Solution": "solution", "Stop": "solvers.stop"}
PUBLIC |= dict.fromkeys(("Problem", "Solver", "case", "certify", "load", "mesh", "solve"), "api")
__all__ = [
    *("BudgetError", "InputError", "Polygon", "Problem", "Solution", "SolutionWarning", "Solver", "Stop"),
    *("case", "certify", "load", "mesh", "solve"),
]


def __dir__() -> list[str]:
    """The public names, and not the rooms of the library that were imported meanwhile."""
    return [*__all__, "__version__"]


def __getattr__(name: str) -> Any:
    """The public names, and the version: each takes longer to import than what most callers need."""
    if name in PUBLIC:
        return getattr(import_module(f"unilateral.{PUBLIC[name]}"), name)
    if name == "__version__":
        return import_module("importlib.metadata").version("unilateral")
    raise AttributeError(f"module 'unilateral' has no attribute '{name}'")
