"""What commands refuse, in one sentence and with code 2: arguments and files."""

import shlex

import pytest
from conftest import ROOT
from sentences import recorder
from typed import OWN_CASE, PROBLEM, SIZES

pytestmark = pytest.mark.usefixtures("shared_cases")


@pytest.mark.parametrize("option", ["--h", "--H", "--rho", "--tolerance"])
@pytest.mark.parametrize(
    "text", ["0", "-1", "nan", "inf", "1/0", "abc", "1/", "", "1e-400", "1e400", "0/3", "1e999999999", "1;2"]
)
def test_a_size_must_be_a_positive_number(refusal, option, text):
    message = refusal("solve", "natural", *SIZES, f"{option}={text}")
    assert f"'{option}': '{text}' must be a positive number or a fraction such as 1/64" in message


THIRDS = ROOT / "manufactured/thirds.yaml"
AT = "--h 1/8 --H 1/4"
SHELTER = f"'{ROOT}/examples/shelter.yaml'"
BY_CLICK = [
    "draw",
    "slove",
    "solve",
    "solve natural --norm l2",
    "solve natural --acuracy 1",
    f"solve natural {AT} --levels 3",
    "solve natural --h",
    "solve natural smooth",
    f"solve natural {AT} --js",
    f"solve thirds {AT} --side left",
    f"solve natural {AT} --algorithm simplex",
    "cases natural --format fortran",
]
OWN = [
    "solve natural --absolute",
    "solve natural --tolerance 1e-9",
    "solve natural --mesh own.msh",
    "solve natural --mesh own.msh --accuracy 1/2 --H 1/2",
    "solve natural --h 1/8",
    f"solve natural {AT} --accuracy 0.1",
    "solve natural --accuracy 0.1 --tolerance 1",
    "solve natural --accuracy 1",
    f"solve natural {AT} --absolute",
    f"solve natural {AT} --norm h1",
    f"solve natural {AT} --max-seconds 9",
    "solve natural --accuracy 0.1 --max-unknowns 8",
    "solve natural --h 1/8 --H 1/8 --rho 1/2",
    f"solve smooth {AT} --free-sides 1,x",
    f"solve smooth {AT} --free-sides 2,4",
    f"solve smooth {AT} --free-sides 0",
    f"solve no_contact {AT} --free-sides 0,1,2,3",
    f"solve natural {AT} --leave-out-idle-sides",
    f"solve '{PROBLEM}' {AT} --side 1",
    f"solve '{PROBLEM}' {AT} --polygon square",
    f"solve '{PROBLEM}' {AT} --free-sides 1",
    f"solve '{PROBLEM}' {AT} --mesh structured",
    f"solve 'two\nlines' {AT}",
    f"solve natral {AT}",
    f"solve thirds {AT} --polygon disc",
    f"solve thirds {AT} --polygon lshap",
    f"solve natural {AT} --mesh quads",
    f"solve natural {AT} --max-steps 0",
    f"solve natural {AT} --max-steps 1.5",
    "solve natural --h 0,5 --H 1",
    "solve natural --h 10mm --H 1",
    "solve natural --accuracy 5%",
    "'my seal.yaml' --accuracy 0.1",
    "check natural",
    "check none.yaml",
    f"check {SHELTER} -o a.txt",
    "cases --format python",
    "cases --side 1",
    "cases natural --polygon lshape",
    "cases thirds --polygon none.yaml",
    "cases thirds --side 4",
    f"cases natural --polygon {SHELTER}",
    "cases violates_jjj --format python",
    "cases violates_jjj --format ufl",
    f"export natral {AT} --out out",
    f"export smoth {AT} --out out",
    "export natural --H 1/2 --out out",
    f"export natural {AT} --mesh own.msh --out out",
    "export natural --H 1/2 --mesh none.msh --out out",
    f"export natural {AT} --levels 99 --out out",
    f"export {SHELTER} {AT} --out out",
    f"export natural --polygon lshape {AT} --out out",
    f"export thirds --polygon lshap {AT} --out out",
    f"export thirds --polygon '{ROOT}/README.md' {AT} --out out",
    f"export thirds --polygon '{THIRDS}' {AT} --out out",
    f"export thirds --side 4 {AT} --out out",
    f"export thirds --free-sides 0 {AT} --out out",
    "infsup",
    "infsup --h 1/4 --mesh own.msh --H 1",
    "infsup --h 1/4",
    "infsup --h 1/4 --H 1",
    "infsup --mesh none.msh --H 1",
    "infsup --polygon square --h 1/4 --cells 0",
    "infsup --polygon square --h 1/4 --cells none.csv",
    "solve nothing --accuracy 0.1 --json",
    "cases nothing --json",
    "score nothing u.csv --json",
    "infsup --h 1 --json",
    "claims nothing --json",
]


@pytest.mark.parametrize("typed", BY_CLICK)
def test_what_click_refuses_leaves_the_folder_empty(refusal, tmp_path, monkeypatch, typed):
    """The folder stays empty."""
    monkeypatch.chdir(tmp_path)
    assert "Error: " in refusal(*shlex.split(typed))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("typed", OWN, ids=[typed.replace(f"{ROOT}/", "") for typed in OWN])
def test_bad_arguments_are_refused_in_one_sentence(refusal, tmp_path, monkeypatch, typed):
    """One sentence; what is like a misspelt name is offered; the folder stays empty."""
    monkeypatch.chdir(tmp_path)
    recorder.check(refusal(*shlex.split(typed)).rpartition("Error: ")[2].strip())
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "typed",
    [
        "solve natural --h 1e-7 --H 1/4",
        "solve natural --h 1/4 --H 1e-6",
        "infsup --polygon square --h 1e-7 --H 1",
    ],
)
def test_what_does_not_fit_into_the_memory_is_refused(refusal, typed):
    """The message says how much is free."""
    assert " MB" in refusal(*typed.split())


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
def test_a_file_that_differs_in_its_ending_is_offered(refusal, tmp_path, monkeypatch, typed, message):
    """Control: one with another name is not."""
    folder = tmp_path / "here"
    folder.mkdir()
    (folder / "seal.yaml").write_text(OWN_PROBLEM)
    monkeypatch.chdir(folder)
    assert message in refusal(*typed.split())


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
def test_bad_files_are_refused_with_the_reason(refusal, tmp_path, content, message):
    """What else a file may have is refused in the tests of declarations, cases and problems."""
    file = tmp_path / "own.yaml"
    file.write_text(content)
    assert message in refusal("solve", str(file), *SIZES)
