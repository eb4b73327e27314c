"""What a program does, as one digest: of its own code, and of all that it imports of this project.

Docstrings, comments and layout are no part of it, nor is code that the program does not import. So the
workflow makes anew what a change of the sources may change, and nothing else.
"""

from __future__ import annotations

import ast
from functools import cache
from hashlib import sha256
from pathlib import Path

PACKAGE_FOLDERS = (Path("src"), Path(), Path("workflow/scripts"))
"""The folders with this project's packages, `unilateral`, `study` and `benchmarks`, and with `job`."""
DATA_ENDINGS = (".yaml", ".html", ".txt")
"""The endings of data files, which are used by the modules beside them that name them."""


def digest_program(program: str) -> str:
    """The SHA-256 of all files that a program uses, each with its path, in the project's folder."""
    lines = [f"{file.as_posix()} {_digest_source(file)[0]}" for file in sorted(used_files(program))]
    return sha256("\n".join(lines).encode()).hexdigest()


def used_files(program: str) -> set[Path]:
    """The program's file, those of the modules of this project that it imports, and their data files."""
    files: set[Path] = set()
    waiting = [Path(program)]
    while waiting:
        file = waiting.pop()
        if file not in files:
            files.add(file)
            waiting += _digest_source(file)[1]
    return files


@cache
def _digest_source(file: Path) -> tuple[str, list[Path]]:
    """The SHA-256 of one file, without what is for readers, and the files that it uses itself."""
    if file.suffix != ".py":
        return sha256(file.read_bytes()).hexdigest(), []
    tree = ast.parse(file.read_bytes())
    used: list[Path] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            used += [path for alias in node.names for path in _find_module_files(alias.name)]
        elif isinstance(node, ast.ImportFrom) and node.module:
            used += [
                path for alias in node.names for path in _find_module_files(f"{node.module}.{alias.name}")
            ]
        elif isinstance(node, ast.Constant) and str(node.value).endswith(DATA_ENDINGS):
            used += filter(Path.is_file, [file.parent / str(node.value)])
        _drop_docstrings(node)
    return sha256(ast.dump(tree).encode()).hexdigest(), used


@cache
def _find_module_files(name: str) -> list[Path]:
    """The files of a module of this project and of the packages that it is in; none of another project's.

    The last part of the name may be that of a class or a function in a module, too.
    """
    names = name.split(".")
    paths = [root.joinpath(*names[:k]) for root in PACKAGE_FOLDERS for k in range(1, len(names) + 1)]
    files = [file for path in paths for file in (path / "__init__.py", path.with_suffix(".py"))]
    return [file for file in files if file.is_file()]


def _drop_docstrings(node: ast.AST) -> None:
    """Drop the statements that are a text alone, as they document a module, a function or a constant."""
    if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
        node.body = [
            statement
            for statement in node.body
            if not (isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant))
        ]
