"""The page to begin with and the glossary: their links and modules exist and have what they name."""

import ast
import re
import tomllib
from pathlib import Path

import pytest
from conftest import ROOT
from documents import blocks

PAGE = ROOT / "docs/reading-the-code.md"
LINK = re.compile(r"\[([^\]]+)\]\(([^)#\s]*)(?:#([\w-]+))?\)")
STEP = re.compile(r"^## (\d+)\. .*\n", re.MULTILINE)
PAPERS = {ROOT / "paper.md", ROOT / "supplement.md"}


def defined_names(file):
    """The functions and classes of a module, and methods as `Class.name`."""
    definition = ast.FunctionDef | ast.ClassDef
    body = ast.parse(file.read_text(encoding="utf-8")).body
    definitions = [node for node in body if isinstance(node, definition)]
    methods = [
        f"{node.name}.{method.name}"
        for node in definitions
        if isinstance(node, ast.ClassDef)
        for method in node.body
        if isinstance(method, definition)
    ]
    return {node.name for node in definitions} | {*methods}


def has_anchor(file, anchor):
    """Whether a document sets this anchor, in braces as the papers do or by a heading of these words."""
    text = file.read_text(encoding="utf-8")
    in_braces = re.search(rf"\{{[^}}]*#{anchor}[ }}]", text)
    titles = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return in_braces is not None or anchor in {title.lower().replace(" ", "-") for title in titles}


def find_link_faults(text, folder=PAGE.parent):
    """Links of a page to files or anchors that do not exist, and to modules without the name in the text."""
    faults = []
    for name, path, anchor in LINK.findall(text):
        file = (folder / path).resolve()
        if not file.is_file():
            faults.append(f"no file {path}")
        elif anchor and not has_anchor(file, anchor):
            faults.append(f"{path} has no #{anchor}")
        elif name.startswith("`") and name.strip("`") not in defined_names(file):
            faults.append(f"{path} has no {name}")
    return faults


def split_steps(text):
    """The text of each numbered step by its number."""
    words = STEP.split(text)
    numbered = zip(words[1::2], words[2::2], strict=True)
    return {int(number): component.partition("\n## ")[0] for number, component in numbered}


def find_step_faults(text):
    """Numbers of steps that lack a formula, a link to code, or a link to their place in the papers."""
    faults = []
    for number, step in split_steps(text).items():
        code = [name for name, path, _ in LINK.findall(step) if name[0] == "`" and path.endswith(".py")]
        places = [path for _, path, _ in LINK.findall(step) if (PAGE.parent / path).resolve() in PAPERS]
        if not (step.count("\n$$\n") >= 2 and code and places):
            faults.append(number)
    return faults


def test_every_link_goes_to_a_file_that_has_what_it_names():
    text = PAGE.read_text(encoding="utf-8")
    assert len(LINK.findall(text)) > 40
    assert find_link_faults(text) == []


@pytest.mark.parametrize(
    ("link", "fault"),
    [
        ("[`solve`](../src/unilateral/api.py)", None),
        ("[`Lifting.make_feasible`](../src/unilateral/bounds/feasible.py)", None),
        ("[Theorem 8](../paper.md#thm-8)", None),
        ("[`solve`](../src/unilateral/none.py)", "no file ../src/unilateral/none.py"),
        ("[`solv`](../src/unilateral/api.py)", "../src/unilateral/api.py has no `solv`"),
        ("[`make_feasible`](../src/unilateral/bounds/feasible.py)", "has no `make_feasible`"),
        ("[`Lifting.solve`](../src/unilateral/bounds/feasible.py)", "has no `Lifting.solve`"),
        ("[`perf_counter`](../src/unilateral/api.py)", "has no `perf_counter`"),
        ("[Theorem 88](../paper.md#thm-88)", "../paper.md has no #thm-88"),
        ("[Theorem](../paper.md#thm)", "../paper.md has no #thm"),
    ],
)
def test_a_link_that_leads_nowhere_is_found(link, fault):
    """Control; the first three have no fault."""
    faults = find_link_faults(link)
    assert len(faults) == (fault is not None)
    assert fault is None or faults[0].endswith(fault)


def test_ten_steps_in_order_have_a_formula_code_and_a_place():
    text = PAGE.read_text(encoding="utf-8")
    steps = split_steps(text)
    assert len(steps) >= 10
    assert [*steps] == [*range(1, len(steps) + 1)]
    assert find_step_faults(text) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [("$$\n", ""), ("[`uzawa`](../src/unilateral/solvers/uzawa.py)", "Uzawa"), ("../paper.md", "method.md")],
)
def test_a_step_without_one_of_them_is_found(old, new):
    """Control."""
    step = (
        "## 1. Iterate\n\n$$\nA u = b\n$$\n\n- Code: [`uzawa`](../src/unilateral/solvers/uzawa.py)\n"
        "- Place: [paper](../paper.md#prop-7)\n"
    )
    assert find_step_faults(step) == []
    assert find_step_faults(step.replace(old, new)) == [1]


def rooms_of_drawing(text):
    """The rooms in each line of the drawing, from the top."""
    return [re.split(r"  +", line.strip())[0] for line in text.splitlines()]


def test_the_drawing_has_the_rooms_in_the_order_of_the_contract():
    """Control: two rooms change places."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    (layers,) = [
        contract["layers"]
        for contract in project["tool"]["importlinter"]["contracts"]
        if contract.get("containers") == ["unilateral"]
    ]
    (drawing,) = [block.text for block in blocks("docs/reading-the-code.md")]
    assert rooms_of_drawing(drawing) == layers
    lines = drawing.splitlines()
    assert rooms_of_drawing("\n".join([lines[1], lines[0], *lines[2:]])) != layers


def glossary_rows(text):
    """Word, letter, meaning and module of each row of the glossary."""
    table = text.partition("| word | letter | meaning | where |\n|---|---|---|---|\n")[2].partition("\n\n")[0]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]


def find_glossary_faults(rows):
    """Rows whose module does not exist or does not use the word."""
    faults = []
    for word, _, _, where in rows:
        module = where.strip("`")
        home = ROOT / "src" if module.startswith("study/") else ROOT / "src/unilateral"
        file = Path(home, f"{module}.py")
        if not file.is_file():
            faults.append(f"{word}: no module {module}")
        elif not uses_word(file.read_text(encoding="utf-8"), word):
            faults.append(f"{word}: not in {module}")
    return faults


def uses_word(code, word):
    """Whether a word is in a module, as words, as a name_with_underscores or as a ClassName."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])|[_\s]+", " ", code).lower()
    return re.search(rf"(?<![a-z]){re.escape(word.lower())}", words) is not None


def test_the_glossary_names_modules_that_use_its_words():
    rows = glossary_rows((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"))
    assert len(rows) >= 60
    assert {len(row) for row in rows} == {4}
    words = [word.lower() for word, *_ in rows]
    assert words == sorted({*words})
    assert all(meaning for _, _, meaning, _ in rows)
    assert find_glossary_faults(rows) == []


def test_a_row_with_another_module_is_found():
    """Control: a module that does not exist, one of another room, and a word that the module lacks."""
    table = "| word | letter | meaning | where |\n|---|---|---|---|\n"
    places = [("patch", "bounds/equilibrated_flux"), ("patch", "bounds/none"), ("scene", "scenes")]
    places += [("scene", "study/scenes"), ("atom", "bounds/forces"), ("atch", "bounds/equilibrated_flux")]
    rows = glossary_rows(table + "".join(f"| {word} | | x | `{where}` |\n" for word, where in places))
    assert find_glossary_faults(rows) == [
        "patch: no module bounds/none",
        "scene: no module scenes",
        "atom: not in bounds/forces",
        "atch: not in bounds/equilibrated_flux",
    ]
