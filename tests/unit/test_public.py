"""What is public is explain, with examples that run."""

import doctest
import inspect
from dataclasses import fields
from importlib import import_module

import pytest
from conftest import ROOT

import unilateral as ul

SOURCES = ROOT / "src"
WITH_EXAMPLES = sorted(
    ".".join(file.relative_to(SOURCES).with_suffix("").parts).removesuffix(".__init__")
    for file in (SOURCES / "unilateral").rglob("*.py")
    if ">>> " in file.read_text(encoding="utf-8")
)


@pytest.mark.usefixtures("shared_cases")
@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples_in_docstrings_run(name):
    failed, tried = doctest.testmod(import_module(name))
    assert failed == 0
    assert tried > 0


def lack_in_docstring(names, owner, expected):
    """Those names whose docstring has not what is wanted."""
    return [name for name in names if expected not in (inspect.getdoc(getattr(owner, name)) or "")]


def test_every_public_name_has_an_example():
    assert lack_in_docstring(ul.__all__, ul, ">>> ") == []


def test_every_attribute_of_a_solution_is_explained():
    """Fields are explain by the docstring of the class, each below a line with its name."""
    public = [name for name in dir(ul.Solution) if not name.startswith("_")]
    class_fields = [field.name for field in fields(ul.Solution)]
    assert len(public) > 20
    assert lack_in_docstring(set(public) - {*class_fields}, ul.Solution, ".") == []
    assert {*class_fields} <= {*inspect.getdoc(ul.Solution).splitlines()}


def test_a_name_without_an_example_is_noticed():
    """Control."""

    class Given:
        def explain(self):
            """A sentence."""

        def silent(self): ...

    assert lack_in_docstring(["explain", "silent"], Given, ".") == ["silent"]
    assert lack_in_docstring(["explain"], Given, ">>> ") == ["explain"]


def test_completion_shows_public_names_only():
    """Modules that are imported meanwhile are attributes of the package, too."""
    import_module("unilateral.geometry.mesh")
    assert dir(ul) == sorted([*ul.__all__, "__version__"])
    assert ul.geometry
    assert all(not isinstance(getattr(ul, name), type(ul)) for name in dir(ul))
