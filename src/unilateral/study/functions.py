"""Functions of the study's modules as their source declares them, for an import takes a second."""

from __future__ import annotations

import ast
from functools import cache
from importlib import resources
from typing import NamedTuple

STUDY = resources.files("unilateral.study")
OF_AXIS = ["values", "h", "H", "budget"]
"""The arguments of a function that makes an axis of extreme problems."""


class Arguments(NamedTuple):
    """The names of those that a function needs, and of those that have a default."""

    needed: list[str]
    optional: list[str]


def modules(folder: str) -> list[str]:
    """The modules in a folder of the study, such as figures."""
    names = [file.name for file in (STUDY / folder).iterdir()]
    return sorted(
        name.removesuffix(".py") for name in names if name.endswith(".py") and name != "__init__.py"
    )


@cache
def functions(folder: str, module: str) -> dict[str, Arguments]:
    """The functions of a module."""
    source = (STUDY / folder / f"{module}.py").read_text(encoding="utf-8")
    found = [each for each in ast.parse(source).body if isinstance(each, ast.FunctionDef)]
    return {each.name: _arguments(each.args) for each in found}


def _arguments(given: ast.arguments) -> Arguments:
    names = [argument.arg for argument in given.args]
    count = len(names) - len(given.defaults)
    return Arguments(names[:count], names[count:])


@cache
def axes() -> dict[str, str]:
    """The kinds of axes of extreme problems, which are the functions of `OF_AXIS`, and the module of each."""
    folder = "runs/extremes"
    return {
        name: module
        for module in modules(folder)
        for name, arguments in functions(folder, module).items()
        if arguments.needed == OF_AXIS and not name.startswith("_")
    }
