"""What commands refuse, in one sentence and with code 2: arguments and files."""

import shlex

import pytest
from conftest import ROOT
from typed import OWN_CASE, PROBLEM, SIZES

pytestmark = pytest.mark.usefixtures("shared_cases")


@pytest.mark.parametrize("option", ["--h", "--H", "--rho", "--tolerance"])
@pytest.mark.parametrize(
    "text", ["0", "-1", "nan", "inf", "1/0", "abc", "1/", "", "1e-400", "1e400", "0/3", "1e999999999", "1;2"]
)
def test_a_size_must_be_a_positive_number(refused, option, text):
    message = refused("solve", "natural", *SIZES, f"{option}={text}")
    assert f"'{option}': '{text}' must be a positive number or a fraction such as 1/64" in message


THIRDS = ROOT / "manufactured/thirds.yaml"
AT = "--h 1/8 --H 1/4"
SHELTER = f"'{ROOT}/examples/shelter.yaml'"
BAD = [
    ("draw", "No such command 'draw'"),
    ("slove", "Did you mean"),
    ("solve", "Missing argument 'PROBLEM'"),
    ("solve natural --absolute", "solve needs --h and --H, or --accuracy; --h is missing"),
    ("solve natural --tolerance 1e-9", "solve needs --h and --H, or --accuracy; --h is missing"),
    ("solve natural --mesh own.msh", "a mesh in a file needs --H, the longest cell of the multiplier"),
    (
        "solve natural --mesh own.msh --accuracy 1/2",
        "--accuracy makes its own meshes; with a mesh in a file give",
    ),
    ("solve natural --h 1/8", "solve needs --h and --H, or --accuracy; --H is missing"),
    (f"solve natural {AT} --accuracy 0.1", "--H is chosen by --accuracy; leave one of the"),
    ("solve natural --accuracy 0.1 --tolerance 1", "--tolerance is chosen by --accuracy"),
    (
        "solve natural --accuracy 1",
        "the accuracy 1 is relative and must be below 1, or made absolute (--absolute)",
    ),
    (f"solve natural {AT} --absolute", "--absolute is only for --accuracy"),
    (f"solve natural {AT} --norm h1", "--norm is only for --accuracy"),
    (f"solve natural {AT} --max-seconds 9", "--max-seconds is only for --accuracy"),
    ("solve natural --norm l2", "Invalid value for '--norm': 'l2'"),
    ("solve natural --acuracy 1", "Did you mean '--accuracy'?"),
    ("solve natural --accuracy 0.1 --max-unknowns 8", "needs 9 unknowns; --max-unknowns"),
    ("solve natural --h 1/8 --H 1/8 --rho 1/2", "rho has no use where S is singular"),
    (f"solve smooth {AT} --free-sides 1,x", "'1,x' must be numbers of sides such as 1,2,3"),
    (f"solve smooth {AT} --free-sides 2,4", "the polygon has the sides 0 to 3, not 4"),
    (f"solve smooth {AT} --free-sides 0", "case 'smooth' has contact on side 0"),
    (f"solve no_contact {AT} --free-sides 0,1,2,3", "one side at least must not be free"),
    (f"solve natural {AT} --leave-out-idle-sides", "is for problem files; for a case use"),
    (f"solve '{PROBLEM}' {AT} --side 1", "--side is for cases; "),
    (f"solve '{PROBLEM}' {AT} --polygon square", "--polygon is for cases; "),
    (f"solve '{PROBLEM}' {AT} --free-sides 1", "--free-sides is for cases; "),
    (f"solve '{PROBLEM}' {AT} --mesh structured", "polygon 'triangle' has no structured mesh"),
    (f"solve natural {AT} --levels 3", "No such option '--levels'"),
    ("solve natural --h", "Option '--h' requires an argument"),
    ("solve natural smooth", "unexpected extra argument (smooth)"),
    (f"solve natural {AT} --js", "Did you mean"),
    (f"solve 'two\nlines' {AT}", "case 'two lines' is unknown"),
    (f"solve natral {AT}", "did you mean natural?"),
    ("solve natural --h 1e-7 --H 1/4", "h = 1e-07 makes 1e+14 unknowns on 'square',"),
    ("solve natural --h 1/4 --H 1e-6", "16 of them on the boundary, take about"),
    (f"solve thirds {AT} --polygon disc", "polygon 'disc' is unknown; the named ones are"),
    (f"solve thirds {AT} --polygon lshap", "named ones are square, lshape, hexagon; did you mean lshape?"),
    (f"solve thirds {AT} --side left", "Invalid value for '--side': 'left'"),
    (f"solve natural {AT} --mesh quads", "'quads' is neither structured nor unstructured nor"),
    (f"solve natural {AT} --algorithm simplex", "Invalid value for '--algorithm': 'simplex'"),
    (f"solve natural {AT} --max-steps 0", "'0' must be a whole number of at least 1"),
    (f"solve natural {AT} --max-steps 1.5", "'1.5' must be a whole number of at least 1"),
    ("solve natural --h 0,5 --H 1", "number or a fraction such as 1/64; write 0.5 for 0,5"),
    (
        "check natural",
        "unilateral: natural declares a case, not a problem; to see it type: unilateral cases natural",
    ),
    ("check none.yaml", "unilateral: there is no file none.yaml"),
    (f"check {SHELTER} --out a.txt", "unilateral: a.txt: the ending must be .svg, .png or .pdf"),
    ("cases --format python", "--format python is for one case; name it, such as natural"),
    ("cases --side 1", "--side is for one case"),
    ("cases natural --format fortran", "Invalid value for '--format': 'fortran'"),
    ("cases natural --polygon lshape", "case 'natural' is for square, not for 'lshape'"),
    ("cases thirds --polygon none.yaml", "there is no file none.yaml"),
    ("cases thirds --side 4", "the polygon has the sides 0 to 3, not 4"),
    (f"cases natural --polygon {SHELTER}", "case 'natural' is for square, not for '"),
    ("cases violates_jjj --format python", "'violates_jjj': there are no closed formulas"),
    ("cases violates_jjj --format ufl", "'violates_jjj': there are no closed formulas"),
    (f"export natral {AT} --out out", "case 'natral' is unknown"),
    (f"export smoth {AT} --out out", "did you mean smooth?"),
    ("export natural --H 1/2 --out out", "either --h or --mesh"),
    (f"export natural {AT} --mesh own.msh --out out", "either --h or --mesh"),
    ("export natural --H 1/2 --mesh none.msh --out out", "there is no file 'none.msh'"),
    (f"export natural {AT} --levels 99 --out out", "99 is more than 12"),
    (f"export {SHELTER} {AT} --out out", "declares a problem"),
    (f"export natural --polygon lshape {AT} --out out", "is for square, not for 'lshape'"),
    (f"export thirds --polygon lshap {AT} --out out", "did you mean lshape"),
    (f"export thirds --polygon '{ROOT}/README.md' {AT} --out out", "does not end in .yaml"),
    (f"export thirds --polygon '{THIRDS}' {AT} --out out", "the field polygon is missing"),
    (f"export thirds --side 4 {AT} --out out", "has the sides 0 to 3, not 4"),
    (f"export thirds --free-sides 0 {AT} --out out", "has contact on side 0"),
    ("infsup", "infsup needs either --mesh or --h"),
    ("infsup --h 1/4 --mesh own.msh --H 1", "infsup needs either --mesh or --h"),
    ("infsup --h 1/4", "infsup needs either --cells or --H"),
    ("infsup --h 1/4 --H 1", "--h needs --polygon"),
    ("infsup --mesh none.msh --H 1", "argument --mesh: there is no file 'none.msh'"),
    ("infsup --polygon square --h 1/4 --cells 0", "argument --cells: 0 must lie between 1 and 100000"),
    ("infsup --polygon square --h 1/4 --cells none.csv", "none.csv cannot be read: No such file"),
    ("infsup --polygon square --h 1e-7 --H 1", "unknowns on 'square', which take at least"),
    ("solve nothing --accuracy 0.1 --json", "case 'nothing' is unknown"),
    ("cases nothing --json", "case 'nothing' is unknown"),
    ("score nothing u.csv --json", "not a folder that 'unilateral export' wrote"),
    ("infsup --h 1 --json", "infsup needs either --cells or --H"),
    ("claims nothing --json", "nothing"),
]
"""What is typed, and a part of the message. Nothing goes to standard output."""


@pytest.mark.parametrize(("typed", "message"), BAD, ids=[typed for typed, _ in BAD])
def test_bad_arguments(refused, tmp_path, monkeypatch, typed, message):
    """What is like a misspelt name is offered; the folder stays empty."""
    monkeypatch.chdir(tmp_path)
    assert message in refused(*shlex.split(typed))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        ("solve seal", "there is no case and no file seal; did you mean seal.yaml?"),
        ("solve seal.yml", "did you mean seal.yaml?"),
        ("check ../here/seal.txt", "no file ../here/seal.txt; did you mean ../here/seal.yaml?"),
        ("export thirds --h 1/8 --H 1/4 --polygon seal --out out", "did you mean seal.yaml?"),
        ("solve shelf", "case 'shelf' is unknown"),
        ("check shelf.yaml", "there is no file shelf.yaml\n"),
    ],
)
def test_a_file_that_differs_in_its_ending_is_offered(refused, tmp_path, monkeypatch, typed, message):
    """Control: one with another name is not."""
    folder = tmp_path / "here"
    folder.mkdir()
    (folder / "seal.yaml").write_text(OWN_PROBLEM)
    monkeypatch.chdir(folder)
    assert message in refused(*typed.split())


OWN_PROBLEM = "polygon: [[0, 0], [1, 0], [0, 1]]\nf: 1\ng: 0\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (OWN_CASE.replace("title", "titel"), "there is no field 'titel' here"),
        (OWN_CASE.replace("formula: ", "formula: -"), "lambda = du/dn < 0"),
        ("\x00", "is not a YAML file"),
        ("a: [1, 2", "is not a YAML file"),
        ("# λ\ng:\n\t- 0\n", "is not a YAML file: there is a tab in line 3; write spaces"),
        ("g: [a,\t1", "is not a YAML file: while parsing a flow sequence in line 1"),
        ("f: !!int x", "own.yaml: 'tag:yaml.org,2002:int' in line 1 is a tag; write the value alone"),
        (f"{OWN_PROBLEM}? {'k' * 100_000}\n: 1\n", f"there is no field '{'k' * 57}...' here; the fields are"),
        (f"{OWN_PROBLEM}title: [{'[1], ' * 2000}]\n", f"field title: it is [{'[1], ' * 11}[...; it"),
    ],
    ids=["typo", "not a solution", "binary", "half", "tab", "tab elsewhere", "tag", "long name", "long list"],
)
def test_bad_files(refused, tmp_path, content, message):
    """What else a file may have is refused in the tests of declarations, cases and problems."""
    file = tmp_path / "own.yaml"
    file.write_text(content)
    assert message in refused("solve", str(file), *SIZES)
