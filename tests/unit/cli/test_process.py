"""The command in a process of its own: streams that fail, imports, interrupts, and failures in the midst."""

import json
import os
import subprocess
import sys
import tomllib
import warnings

import pytest
from conftest import ROOT
from typed import KEYS, PROBLEM, SCRIPT, SIZES, run_in_python

from study.ledger import claims
from unilateral.cli.application import application


def run_process(*arguments, shell="", **environment):
    """The command in a process of its own; `shell` redirects its streams."""
    command = f"{SCRIPT} {' '.join(arguments)} {shell}"
    environment = {**os.environ, **environment}
    process = subprocess.run(
        ["sh", "-c", command], capture_output=True, env=environment, timeout=60, cwd=ROOT
    )
    return process.returncode, process.stdout, process.stderr.decode()


def test_the_installed_command_prints_json_and_ends_with_its_code():
    code, out, err = run_process("solve", "full_contact", *SIZES, "--json")
    assert (code, err, list(json.loads(out))) == (0, "", KEYS)
    code, out, err = run_process("solve", "unknown.yaml", *SIZES)
    assert (code, out, err.count("\n")) == (2, b"", 1)


@pytest.mark.parametrize(
    ("arguments", "unbuffered"),
    [(("solve", "--help"), ""), (("solve", "--help"), "1"), (("solve", "full_contact", *SIZES), "1")],
)
def test_a_closed_pipe_is_no_error(arguments, unbuffered):
    """Written at the end or line by line; gmsh, which resets SIGPIPE, is imported by `solve`."""
    reader, writer = os.pipe()
    os.close(reader)
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    try:
        process = subprocess.run(
            [SCRIPT, *arguments], stdout=writer, stderr=subprocess.PIPE, env=environment, timeout=60
        )
    finally:
        os.close(writer)
    assert (process.returncode, process.stderr) == (0, b"")


@pytest.mark.parametrize("command", ["help", "solve"])
@pytest.mark.parametrize(
    ("shell", "unbuffered", "message"),
    [
        (">/dev/full", "", "No space left on device"),
        (">/dev/full", "1", "No space left on device"),
        (">&-", "", "standard output is closed"),
    ],
    ids=["full", "full at once", "closed"],
)
def test_output_that_cannot_be_written_is_code_4(problem_file_of, command, shell, unbuffered, message):
    """A full disk is what writing to /dev/full gives, see full(4); without a buffer it is met earlier."""
    arguments = ("--help",) if command == "help" else ("solve", problem_file_of(f=1, g=0), *SIZES)
    outcome = run_process(*arguments, shell=shell, PYTHONUNBUFFERED=unbuffered)
    assert outcome == (4, b"", f"unilateral: the system failed: {message}\n")


@pytest.mark.parametrize("shell", ["2>&-", "2>/dev/full"])
def test_messages_that_cannot_be_written_change_no_code(problem_file_of, shell):
    """And do not go to standard output; the solve warns, the other one is refused."""
    assert run_process("solve", "unknown.yaml", *SIZES, shell=shell)[:2] == (2, b"")
    file = problem_file_of(f=1, g=0)
    code, out, _ = run_process("solve", file, "--h", "1/4", "--H", "1/8", "--json", shell=shell)
    assert code == 0
    assert list(json.loads(out)) == KEYS
    assert run_process("--help", shell=f"{shell} >/dev/full")[0] == 4


TITLE = "λ-λ_H ‖·‖ – 90° š…"


@pytest.mark.parametrize(
    ("encoding", "letters"),
    [
        ("utf-8", TITLE),
        ("cp1252", "lambda-lambda_H ||·|| – 90° š…"),
        ("latin-1", r"lambda-lambda_H ||·|| - 90° \u0161\u2026"),
        ("ascii", r"lambda-lambda_H ||*|| - 90 degrees \u0161\u2026"),
        ("ascii:replace", "?-?_H ??? ? 90? ??"),
    ],
)
def test_letters_that_a_terminal_does_not_have_are_replaced(encoding, letters):
    """By their names, or their codes; a user's own choice, such as ascii:replace, is left."""
    source = f"from unilateral.cli import guard; guard.prepare_streams(); guard.print_result({TITLE!r})"
    environment = {**os.environ, "PYTHONIOENCODING": encoding}
    done = subprocess.run([sys.executable, "-c", source], capture_output=True, env=environment, timeout=60)
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout.decode(encoding.split(":")[0]).splitlines() == [letters]


def test_a_file_s_name_that_is_no_text_is_printed(tmp_path, problem_file_of):
    """Bytes that are not UTF-8, which Python keeps as surrogates."""
    file = os.fsencode(tmp_path) + b"/\xff.yaml"
    os.rename(problem_file_of(f=1, g=0), file)
    process = subprocess.run([SCRIPT, "solve", file, *SIZES], capture_output=True, timeout=60)
    assert (process.returncode, process.stderr) == (0, b"")
    assert process.stdout.startswith(rb"\udcff: h = ")


SLOW = {
    *("numpy", "scipy", "sympy", "gmsh", "skfem", "xarray", "pandas", "matplotlib", "jsonschema", "yaml"),
    *("pyamg", "meshio", "netCDF4", "scipy.spatial", "scipy.optimize", "importlib.metadata"),
}
"""What takes long to import."""


def slow_imports(source, **environment):
    """Which of the slow modules a process has imported after it executed that."""
    code, out, _ = run_in_python(
        f"{source}; import sys; print('', *{SLOW} & set(sys.modules))", **environment
    )
    assert code == 0
    return set(out.splitlines()[-1].split())


@pytest.mark.parametrize(
    ("imported", "run"),
    [
        ("unilateral", "None"),
        ("unilateral.cli", "None"),
        ("unilateral.cli", "unilateral.cli.main(['--help'])"),
        *(("unilateral.cli", f"unilateral.cli.main(['{name}', '--help'])") for name in application.commands),
    ],
    ids=["library", "entry", "help", *application.commands],
)
def test_what_comes_at_once_imports_next_to_nothing(imported, run):
    """The library's names are imported when they are asked for; `main` is there to be interrupted."""
    assert slow_imports(f"import {imported}; {run}") == set()


def test_a_small_problem_of_one_s_own_imports_what_it_needs(problem_file_of):
    """Neither what derives cases nor what draws, meshes, refines, tabulates or solves large systems."""
    formulas = {"f": "3 - 8*x*y - pi**2*sin(3*pi*x) + pos(x - 1/3, 0)", "g": "x*(1 - x)/3 - y*(1 - y)/5"}
    solve = ["solve", str(problem_file_of(**formulas)), *SIZES]
    imported_modules = slow_imports(f"import unilateral.cli; unilateral.cli.main({solve})")
    assert imported_modules - {"importlib.metadata"} == {
        "numpy",
        "scipy",
        "jsonschema",
        "yaml",
    }  # which numpy imports


def test_what_needs_it_is_imported():
    """Control: a command that runs imports what it works with, here to refuse a name."""
    imported_modules = slow_imports("import unilateral.cli; unilateral.cli.main(['cases', 'naturall'])")
    assert {"numpy", "yaml"} <= imported_modules


def test_case_names_are_completed_without_what_takes_long_to_import():
    """Control: the names of polygons are read from YAML into arrays."""
    for line, imported in (("solve nat", False), ("solve natural --polygon l", True)):
        words = f"unilateral {line}"
        asked = {"COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
        complete = {"_UNILATERAL_COMPLETE": "bash_complete", **asked}
        imported_modules = slow_imports("from unilateral.cli import main; main([])", **complete)
        assert ("numpy" in imported_modules) == imported
        assert imported or not imported_modules


def test_a_second_interrupt_ends_at_once():
    """The first one, in the second level, ends the search; the second one ends the printing of its result."""
    source = (
        "import os, signal, sys; from unilateral.adaptive import loop\n"
        "from unilateral.cli import main, solve\n"
        "loop.halve_triangle_edges = solve.describe_ending = lambda *_: os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.exit(main(['solve', 'natural', '--accuracy', '0.1']))\n"
    )
    code, out, err = run_in_python(source)
    assert (code, err) == (130, "unilateral: interrupted\n")
    assert out.count("\n") == 3  # what is wanted, the names of the columns, and the first level


def test_sigterm_is_told_and_is_code_143():
    """In one line, when the command works; the signal is sent in its first level."""
    source = (
        "import os, signal, sys; from unilateral.adaptive import loop\n"
        "from unilateral.cli import main\n"
        "loop.make_first_mesh = lambda *_: os.kill(os.getpid(), signal.SIGTERM)\n"
        "sys.exit(main(['solve', 'natural', '--accuracy', '0.1']))\n"
    )
    assert run_in_python(source) == (143, "", "unilateral: terminated\n")


SENT_WHILE_WRITING = """
import os, signal, sys
from unilateral.cli import main
from unilateral.geometry import triangulate
initialise, names, replaced = triangulate.gmsh.initialize, [], os.replace
triangulate.gmsh.initialize = lambda **options: (names.append("gmsh"), initialise(**options))
def replace(*paths):
    if paths[1].name == "b.json":
        print(*sorted(set(names)), len(list(paths[1].parent.glob(".*.tmp"))), file=sys.stderr, flush=True)
        os.kill(os.getpid(), signal.SIGNAL)
    replaced(*paths)
os.replace = replace
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.parametrize("sizes", [(*SIZES,), ("--accuracy", "0.3")], ids=["sizes", "accuracy"])
@pytest.mark.parametrize(
    ("name", "code", "report"), [("SIGTERM", 143, "terminated"), ("SIGINT", 130, "interrupted")]
)
def test_a_signal_after_gmsh_while_files_are_written_leaves_nothing_half_written(
    tmp_path, name, code, report, sizes
):
    """It is told; the file that was finished before stays. gmsh resets the handler of SIGTERM."""
    source = SENT_WHILE_WRITING.replace("SIGNAL", name)
    files = [option for file in ("a.csv", "b.json") for option in ("-o", str(tmp_path / file))]
    command = [sys.executable, "-c", source, "solve", PROBLEM, *sizes, *files]
    done = subprocess.run(command, capture_output=True, encoding="utf-8", timeout=60)
    assert (done.returncode, done.stderr) == (code, f"gmsh 1\nunilateral: {report}\n")
    assert [file.name for file in tmp_path.iterdir()] == ["a.csv"]


@pytest.mark.parametrize("module", ["unilateral.cli", "unilateral.cli.guard", "click", "numpy"])
def test_an_interrupt_while_the_command_begins_ends_it_in_one_line(module):
    """While it imports that; the installed command begins with `unilateral.__main__`."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["scripts"] == {"unilateral": "unilateral.__main__:main"}
    source = (
        "import os, signal, sys\n"
        "class Interrupting:\n"
        "    def find_spec(self, name, *_):\n"
        f"        name == {module!r} and os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Interrupting())\n"
        "from unilateral.__main__ import main\n"
        "sys.argv[1:] = ['cases']\n"
        "sys.exit(main())\n"
    )
    assert run_in_python(source) == (130, "", "unilateral: interrupted\n")


@pytest.mark.parametrize(
    ("fault", "outcome"),
    [
        ("os.kill(os.getpid(), signal.SIGINT)", (130, b"", "unilateral: interrupted\n")),
        ("raise ImportError('libx is missing')", (4, b"", "ImportError: libx is missing (numpy.py, line 5)")),
        ("raise OSError(5, 'Input/output error', 'x.so')", (4, b"", "failed: x.so: Input/output error\n")),
    ],
    ids=["interrupt", "missing", "unreadable"],
)
def test_a_library_that_cannot_be_imported_is_told_in_one_line(tmp_path, fault, outcome):
    """A library in the place of numpy which, as some written in C do, makes another error of an interrupt."""
    second = "except KeyboardInterrupt:\n    raise ImportError from None\n"
    (tmp_path / "numpy.py").write_text(f"import os, signal\n\n\ntry:\n    {fault}\n{second}")
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    code, out, err = run_process("cases", PYTHONPATH=path)
    assert (code, out, err.count("\n")) == (*outcome[:2], 1)
    assert outcome[2] in err


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (MemoryError(), "there is not enough memory; take larger sizes --h and --H"),
        (OSError(28, "No space left on device", "a.nc"), "failed: a.nc: No space left on device"),
        (RuntimeError("NetCDF: HDF error"), "RuntimeError: NetCDF: HDF error (test_process.py, line "),
    ],
    ids=["memory", "disk", "HDF"],
)
def test_a_failure_in_the_midst_is_code_4(run, monkeypatch, error, message):
    """And not 1, which is a claim that fails."""

    def failing(*_):
        raise error

    monkeypatch.setattr(claims, "judge_all", failing)
    code, out, err = run("claims", "4.12")
    assert (code, out, err.count("\n")) == (4, "", 1)
    assert message in err


def test_a_failure_in_code_without_a_file_is_told(run, monkeypatch):
    """Such as numpy functions that a package makes of a text: their place has no module's name."""
    source = "def failing(*_):\n    raise ArithmeticError('no number')\n"
    namespace = {"__builtins__": __builtins__}
    exec(compile(source, "<lambdifygenerated-1>", "exec"), namespace)
    del namespace["__builtins__"]
    monkeypatch.setattr(claims, "judge_all", namespace["failing"])
    code, _, err = run("claims", "4.12")
    assert (code, err.count("\n")) == (4, 1)
    assert err.endswith("ArithmeticError: no number (<lambdifygenerated-1>, line 2)\n")


def test_warnings_are_as_before_afterwards(run):
    before = warnings.showwarning
    run("solve", "unknown", *SIZES)
    assert warnings.showwarning is before
