"""Where things stand in the package, and what they are called: one name for one thing."""

import ast
import io
import re
import tokenize
from collections import Counter

from conftest import ROOT

SOURCES = sorted((ROOT / "src").rglob("*.py"))
LOOSE = {"__init__", "__main__", "api", "arrays", "errors"}
"""The modules that belong to no room."""


def classes(sources):
    """How many classes of each name these texts define."""
    return Counter(
        node.name for text in sources for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ClassDef)
    )


def test_no_two_classes_have_one_name():
    class_places = classes(file.read_text(encoding="utf-8") for file in SOURCES)
    assert len(class_places) > 100
    assert [name for name, count in class_places.items() if count > 1] == []


def test_a_name_that_is_there_twice_is_noticed():
    """Control: in two modules, or inside a function."""
    assert classes(["class A: ...", "def f():\n    class A: ..."])["A"] == 2


def test_no_module_lies_loose():
    assert {file.stem for file in SOURCES if file.parent == ROOT / "src/unilateral"} == LOOSE


def test_every_room_says_what_is_in_it():
    for file in SOURCES:
        if file.name == "__init__.py" and "manufactured" not in file.parts:
            assert ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))), file


def named_tests(text):
    """The modules of tests that a document names."""
    return set(re.findall(r"`(test_\w+)(?:\.py)?`", text))


def test_modules_of_tests_that_documents_name_are_there():
    documents = [file for place in (".", "docs", "benchmarks") for file in (ROOT / place).glob("*.md")]
    named = set.union(*(named_tests(file.read_text(encoding="utf-8")) for file in documents))
    assert len(named) > 10
    assert sorted(named - {file.stem for file in (ROOT / "tests").rglob("test_*.py")}) == []


def test_a_named_module_is_found_in_a_document():
    """Control."""
    assert named_tests("see `test_a` and `test_b.py`, not test_c") == {"test_a", "test_b"}


MOST_LINES_OF_A_CHECKER = 320
"""A checker of certificates is read by people: as much code as half an hour allows."""
LAYOUT = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}


def lines_of_code(text):
    """How many lines have code, which docstrings, comments and blank lines are not."""
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
    nodes = [node for node in ast.walk(ast.parse(text)) if isinstance(node, documented)]
    docstrings = [node.body[0] for node in nodes if ast.get_docstring(node)]
    prose = {line for node in docstrings for line in range(node.lineno, node.end_lineno + 1)}
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    code = [range(token.start[0], token.end[0] + 1) for token in tokens if token.type not in LAYOUT]
    return len({line for lines in code for line in lines} - prose)


def test_checkers_of_certificates_are_short():
    for name in ("check.py", "check_formulas.py"):
        text = (ROOT / "certificate" / name).read_text(encoding="utf-8")
        assert 100 < lines_of_code(text) <= MOST_LINES_OF_A_CHECKER, name


def test_lines_of_code_are_counted():
    """Control."""
    assert (
        lines_of_code('"""A\nb."""\n\n# c\nx = [1,\n     2]  # d\n\n\ndef f():\n    """e"""\n    return x\n')
        == 4
    )
