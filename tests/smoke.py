"""What an installation with each set of extras has to do, and to say where it cannot.

`python tests/smoke.py plot` tries it with the packages of the core and of the extra `plot`, in an environment
that has these. Further names are modules that are taken to be missing. It needs this project and its examples
only, and works in the current folder, which should be empty.
"""

import contextlib
import io
import re
import subprocess
import sys
from pathlib import Path

HAS = {
    "core": set(),
    "plot": {"plot"},
    "files": {"files"},
    "mesh": {"mesh"},
    "all": {"files", "mesh", "plot"},
}
"""The extras that each set has."""
SIZES = ("--h", "1/8", "--H", "1/4")
TASKS = [
    ("solve corner.yaml --accuracy 0.2 -o corner.csv -o corner.json", set()),
    ("init own.yaml", set()),
    ("check own.yaml", set()),
    ("solve own.yaml --accuracy 0.3", set()),
    ("check corner.yaml -o check.svg", {"plot"}),
    ("solve corner.yaml --h 1/8 --H 1/4 -o corner.svg", {"plot"}),
    ("solve corner.yaml --h 1/8 --H 1/4 -o corner.html", {"plot"}),
    ("solve corner.yaml --h 1/8 --H 1/4 -o corner.vtu", {"files"}),
    ("solve corner.yaml --H 1/4 --mesh corner.vtu", {"files"}),
    ("certify corner.yaml --solution corner.vtu", {"files"}),
    ("solve corner.yaml --h 1/8 --H 1/4 -o corner.nc", {"files"}),
    ("solve corner.yaml --h 1/8 --H 1/4 --out kept", {"files", "plot"}),
    ("solve triangle.yaml --accuracy 0.3", {"mesh"}),
    ("infsup --polygon square --h 1/8 --H 1/4", {"mesh"}),
    ("cases full_contact", set()),
    ("solve full_contact --h 1/8 --H 1/4", set()),
    ("export full_contact --h 1/8 --H 1/4 --out full_contact", {"files"}),
    ("solve full_contact --h 1/8 --H 1/4 -o contact.vtu", {"files"}),
    ("score full_contact contact.vtu", {"files", "mesh"}),
    ("score full_contact contact.vtu --html contact.html", {"files", "mesh", "plot"}),
]
"""Commands, one after the other, and the extras that each needs."""
PROBLEMS = {
    "corner": "{polygon: [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], f: -1, g: -x*y/4}",
    "triangle": "{polygon: [[0, 0], [1, 0], [0, 1]], f: x - 1, g: sin(pi*x)/9}",
}
LINE = re.compile(r"unilateral: .* needs? .*; type: pip install 'unilateral\[([\w,]+)\]'\n")


def run_line(line):
    """The exit code of a command, and what it prints on standard output and on standard error."""
    from unilateral.cli import main

    out = io.StringIO()
    err = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(line.split())
    return code, out.getvalue(), err.getvalue()


def commands(has):
    """Each task is done, or refused by one sentence that names missing extras which it needs."""
    for line, needs in TASKS:
        code, out, err = run_line(line)
        refused = LINE.fullmatch(err)
        if needs <= has:
            assert (code, err) == (0, ""), (line, code, err)
        else:
            assert refused, (line, code, out, err)
            assert (code, out) == (2, ""), (line, code, out)
            assert set(refused[1].split(",")) <= needs - has, (line, err)


def helps():
    """All help is there, and the study's command, which is not there, says so."""
    from unilateral.cli.application import application

    code, out, err = run_line("claims 4.12")
    assert (code, out) == (2, ""), (code, out, err)
    assert "claims belongs to the study" in err, err
    for name in ["", *application.commands]:
        code, out, err = run_line(f"{name} --help")
        assert (code, err) == (0, ""), (name, err)
        assert out, name


def python(has):
    """The same in Python, and what has no command: meshes in arrays, tables."""
    import unilateral as ul

    points = [(0, 0), (1, 0), (0, 1), (1 / 3, 1 / 3)]
    mesh = ul.mesh(points, [[0, 1, 3], [1, 2, 3], [2, 0, 3]])
    s = ul.solve(ul.Problem(mesh.polygon, f=-1, g="-x - y"), mesh=mesh, H=2)
    assert s.bounds.u > 0
    assert "Solution of" in repr(s)
    assert "</table>" in s._repr_html_()
    assert s.forces().whole.lower <= s.forces().whole.value <= s.forces().whole.upper
    for needs, call in (
        ({"files"}, s.cells),
        ({"files"}, s.dataset),
        ({"files"}, lambda: ul.mesh("corner.vtu")),
        ({"plot"}, s.plot),
    ):
        refused = LINE.fullmatch(f"unilateral: {refusal(call)}\n")
        assert bool(refused) == (not needs <= has), (needs, refused)
        assert refused is None or refused[1] in needs


def certificate():
    """The checkers come with the project, as files that run without it."""
    code, out, err = run_line("solve corner.yaml --h 1/8 --H 1/4 --certificate corner.json.gz")
    assert (code, err) == (0, ""), err
    program, file = re.search(r"check it with +python3 (\S+) (\S+)\n", out).groups()
    line = [sys.executable, "-I", "-S", program, file]
    checked = subprocess.run(line, capture_output=True, text=True, timeout=60)
    assert checked.returncode == 0, checked
    assert "PROVED" in checked.stdout, checked
    assert Path(program).with_name("check_formulas.py").is_file()


def refusal(call):
    """What an InputError says, "" without one."""
    from unilateral.errors import InputError

    try:
        call()
    except InputError as error:
        return str(error)
    return ""


def main():
    name, *missing = sys.argv[1:]
    sys.modules.update(dict.fromkeys(missing))
    for problem, text in PROBLEMS.items():
        with open(f"{problem}.yaml", "w", encoding="utf-8") as file:
            file.write(text)
    open("corner.vtu", "wb").close()  # which is asked for, too, where none can be written
    helps()
    commands(HAS[name])
    python(HAS[name])
    certificate()
    print(f"{name}: {len(TASKS)} commands and Python do what they should")


if __name__ == "__main__":
    main()
