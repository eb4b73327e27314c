"""Each set of extras does what it should, and says what is missing for the rest."""

import importlib.metadata
import re
import subprocess
import sys
import tomllib
from functools import cache

import pytest
import sentences
import smoke
from conftest import ROOT
from packaging.requirements import Requirement

from unilateral.system import optional

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]
TOP = importlib.metadata.packages_distributions()
"""The distributions that each module at the top belongs to."""


def canonical(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def list_required_packages(entries, extra=""):
    """The names of what these requirements ask for here."""
    names = set()
    for requirement in map(Requirement, entries):
        if requirement.marker is None or requirement.marker.evaluate({"extra": extra}):
            original = (
                [list_required_packages(EXTRAS[extra_name]) for extra_name in requirement.extras]
                if requirement.name == "unilateral"
                else []
            )
            names |= set().union(*original) if original else {canonical(requirement.name)}
    return names


@cache
def distributions(name):
    """All that an installation of that set brings, as the packages that are installed here declare it."""
    waiting = list_required_packages(PROJECT["dependencies"]) | (
        list_required_packages(EXTRAS[name]) if name != "core" else set()
    )
    names = {"unilateral"}
    while waiting:
        names.add(item := waiting.pop())
        waiting |= list_required_packages(importlib.metadata.requires(item) or []) - names
    return names


def absent(name):
    """The modules at the top of what is installed here but not by that set, the study among them."""
    kept_distributions = distributions(name)
    return [
        "study",
        *(
            module
            for module, distributions in TOP.items()
            if not kept_distributions & {*map(canonical, distributions)}
        ),
    ]


def run_smoke(name, folder, missing):
    return subprocess.run(
        [sys.executable, str(ROOT / "tests/smoke.py"), name, *missing],
        capture_output=True,
        text=True,
        cwd=folder,
        timeout=120,
    )


@pytest.mark.parametrize("name", smoke.HAS)
def test_a_set_does_what_it_should_with_its_own_packages_only(tmp_path, name):
    """In a process in which no other package can be imported. All of them are imported for the set `all`, and
    pictures drawn, which takes 10 s."""
    done = run_smoke(name, tmp_path, absent(name))
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"{name}: ")


@pytest.mark.parametrize(("name", "module"), [("core", "yaml"), ("mesh", "gmsh")])
def test_a_set_without_one_of_its_packages_fails(tmp_path, name, module):
    """Control."""
    assert run_smoke(name, tmp_path, [*absent(name), module]).returncode != 0


def test_the_core_has_none_of_the_optional_packages():
    """And each extra has those that its name stands for: what is asked for is what is installed."""
    absent_of_core = set(absent("core"))
    assert set(optional.EXTRAS) <= absent_of_core
    modules = {canonical(name): name for name in optional.EXTRAS}
    for extra in ("plot", "files", "mesh"):
        original = {name for name, module in modules.items() if optional.EXTRAS[module] == extra}
        assert list_required_packages(EXTRAS[extra]) == original


def test_all_extras_together_have_what_the_solver_can_use():
    assert distributions("all") == set().union(*map(distributions, ("plot", "files", "mesh")))
    assert distributions("all") < distributions("study")


def test_what_is_asked_for_names_every_missing_package(monkeypatch):
    for name in ("gmsh", "pandas", "xarray"):
        monkeypatch.setitem(sys.modules, name, None)
    with sentences.raises(optional.InputError, "gmsh, pandas and xarray"):
        optional.require("tasks need", "gmsh", "xarray", "meshio", "pandas")
    optional.require("tasks need", "meshio")
