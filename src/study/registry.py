"""The experiments, figures, checks and kinds of axes that there are.

They are found by the names of modules and functions, in their source, for an import takes a second.
"""

from __future__ import annotations

import ast
from functools import cache
from importlib import resources
from typing import Any, NamedTuple

STUDY = resources.files("study")
EXTREMES = "experiments.extremes"
FIGURE = "_figure"
"""The end of the name of a figure's module."""
OF_AXIS = ["values", "h", "H", "budget"]
"""The arguments of a function that makes an axis of extreme problems."""


class Arguments(NamedTuple):
    """The names of the arguments that a function needs, and of those that have a default."""

    needed: list[str]
    optional: list[str]


def modules(package: str) -> list[str]:
    """The modules of a package of the study, such as experiments.cost."""
    names = [file.name for file in STUDY.joinpath(*package.split(".")).iterdir()]
    return sorted(
        name.removesuffix(".py") for name in names if name.endswith(".py") and name != "__init__.py"
    )


@cache
def experiments() -> dict[str, str]:
    """The experiments by name, each with its package, such as experiments.cost."""
    folders = [each for each in (STUDY / "experiments").iterdir() if (each / "__init__.py").is_file()]
    return {name: f"experiments.{name}" for name in sorted(folder.name for folder in folders)}


def having(module: str) -> list[str]:
    """The packages of the experiments that have such a module."""
    return [package for package in experiments().values() if module in modules(package)]


@cache
def figures() -> dict[str, str]:
    """The figures by their names, each with its module, such as experiments.cost.work_precision_figure."""
    by_name = {
        name.removesuffix(FIGURE): f"{package}.{name}"
        for package in (*experiments().values(), "ledger")
        for name in modules(package)
        if name.endswith(FIGURE)
    }
    return dict(sorted(by_name.items()))


@cache
def checks() -> dict[str, str]:
    """The modules of checks, by experiment; the checks that serve several experiments are the ledger's."""
    packages = {"ledger": "ledger", **experiments()}
    return {name: f"{package}.checks" for name, package in packages.items() if "checks" in modules(package)}


def constant(module: str, name: str) -> Any:
    """The value of a constant of a module of the study, which has to be written as a literal."""
    (value,) = [
        each.value
        for each in _statements(module)
        if isinstance(each, ast.Assign) and ast.unparse(each.targets[0]) == name
    ]
    return ast.literal_eval(value)


@cache
def functions(module: str) -> dict[str, Arguments]:
    """The functions of a module of the study."""
    definitions = [each for each in _statements(module) if isinstance(each, ast.FunctionDef)]
    return {each.name: _arguments(each.args) for each in definitions}


def _statements(module: str) -> list[ast.stmt]:
    *package, name = module.split(".")
    return ast.parse(STUDY.joinpath(*package, f"{name}.py").read_text(encoding="utf-8")).body


def _arguments(given: ast.arguments) -> Arguments:
    names = [argument.arg for argument in given.args]
    count = len(names) - len(given.defaults)
    return Arguments(names[:count], names[count:])


@cache
def axes() -> dict[str, str]:
    """The kinds of axes of extreme problems, each with its module: the functions with arguments `OF_AXIS`."""
    return {
        name: module
        for module in modules(EXTREMES)
        for name, arguments in functions(f"{EXTREMES}.{module}").items()
        if arguments.needed == OF_AXIS and not name.startswith("_")
    }
