"""A reader of the documents, who types the code blocks of a page from top to bottom in a folder of their own.

Commands are run, programs executed, problem files looked at, and what is said to be printed is compared.
"""

from __future__ import annotations

import glob
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterable
from contextlib import chdir, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import meshio
import numpy as np
import yaml
from conftest import ROOT
from documents import Block

import unilateral as ul
from unilateral.cli import main
from unilateral.geometry.polygon import find_polygon
from unilateral.geometry.structured import make_structured_mesh

FOLDERS = ("certificate", "examples", "results")
"""What pages name of the project."""


def own_mesh() -> None:
    """A reader's mesh of the unit square, in three coordinates as gmsh writes them."""
    mesh = make_structured_mesh(find_polygon("square"), 1 / 8)
    points = np.column_stack([mesh.points, np.zeros(mesh.n_nodes)])
    meshio.Mesh(points, [("triangle", mesh.triangles)]).write("own.msh", file_format="gmsh")


def own_solutions() -> None:
    """A reader's solutions of `natural` on the levels of docs/own-solver.md; here they are this project's."""
    for level in range(5):
        h = 1 / 2 ** (level + 2)
        ul.solve(ul.case("natural"), h=h, H=2 * h).save(f"level_{level}.vtu")


READERS_FILES: dict[str, Callable[[], object]] = {
    "own.msh": own_mesh,
    "level_": own_solutions,
    "solve problem.yaml": lambda: main(["init", "problem.yaml"]),
}
"""What a reader has: what a page says of it, and what makes it."""


def follow(page: Iterable[Block], folder: Path) -> list[Block]:
    """Types the blocks one after the other, and returns those that were run.

    Raises what a block raises, and AssertionError for a command that fails and for another output. Blocks of
    the kind `text` show what the block before them prints.
    """
    page = list(page)
    everything = "".join(block.text for block in page)
    printed = ""
    done = []
    names = {"__name__": "__main__"}
    with chdir(folder):
        for name in FOLDERS:
            if not Path(name).exists():
                Path(name).symlink_to(ROOT / name)
        for reader, make in READERS_FILES.items():
            if reader in everything:
                with redirect_stdout(StringIO()):
                    make()
        for block in page:
            if block.reason is not None:
                continue
            with redirect_stdout(StringIO()) as out, redirect_stderr(StringIO()) as err:
                RUN[block.kind](block, printed, names)
            printed = printed if block.kind == "text" else out.getvalue() + err.getvalue()
            done.append(block)
    return done


def commands(block: Block, *_: object) -> None:
    for line in block.text.splitlines():
        if words := shlex.split(line, comments=True):
            program, *arguments = [name for word in words for name in sorted(glob.glob(word)) or [word]]
            assert RUNNERS[program](arguments) == 0, f"{place(block)}: {line}"


def python_file(arguments: list[str]) -> int:
    return subprocess.run([sys.executable, *arguments], timeout=120).returncode


def plain_python(arguments: list[str]) -> int:
    """A file for which no package is installed."""
    return python_file(["-I", "-S", *arguments])


def program(block: Block, _: str, names: dict[str, object]) -> None:
    """The programs of a page follow one another and know the same names."""
    exec(compile(block.text, place(block), "exec"), names)


def declaration(block: Block, *_: object) -> None:
    """A case or a problem; its first line may name its file."""
    name = re.match(r"# ([\w.]+\.yaml)\n", block.text)
    file = name[1] if name else "declared.yaml"
    Path(file).write_text(block.text, encoding="utf-8")
    if "polygons" in yaml.safe_load(block.text):
        ul.case(file)
    else:
        assert main(["check", file]) == 0, place(block)


def output(block: Block, printed: str, _: object) -> None:
    escapes = [re.escape(word.strip()) for word in block.text.split("...")]
    assert re.search(".*".join(escapes), printed, re.DOTALL), f"{place(block)}: printed was\n{printed}"


def place(block: Block) -> str:
    return f"{block.page}, line {block.line}"


RUNNERS: dict[str, Callable[[list[str]], int]] = {
    "unilateral": main,
    "python": python_file,
    "python3": plain_python,
}
RUN = {"": commands, "python": program, "yaml": declaration, "text": output}
