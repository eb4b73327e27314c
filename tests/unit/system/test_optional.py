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


def wanted(entries, extra=""):
    """The names of what these requirements ask for here."""
    found = set()
    for each in map(Requirement, entries):
        if each.marker is None or each.marker.evaluate({"extra": extra}):
            own = [wanted(EXTRAS[of]) for of in each.extras] if each.name == "unilateral" else []
            found |= set().union(*own) if own else {canonical(each.name)}
    return found


@cache
def distributions(name):
    """All that an installation of that set brings, as the packages that are installed here declare it."""
    waiting = wanted(PROJECT["dependencies"]) | (wanted(EXTRAS[name]) if name != "core" else set())
    found = {"unilateral"}
    while waiting:
        found.add(each := waiting.pop())
        waiting |= wanted(importlib.metadata.requires(each) or []) - found
    return found


def absent(name):
    """The modules at the top of what is installed here but not by that set, the study among them."""
    kept = distributions(name)
    return ["study", *(module for module, of in TOP.items() if not kept & {*map(canonical, of)})]


def tried(name, folder, missing):
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
    done = tried(name, tmp_path, absent(name))
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"{name}: ")


@pytest.mark.parametrize(("name", "module"), [("core", "yaml"), ("mesh", "gmsh")])
def test_a_set_without_one_of_its_packages_fails(tmp_path, name, module):
    """Control."""
    assert tried(name, tmp_path, [*absent(name), module]).returncode != 0


def test_the_core_has_none_of_the_optional_packages():
    """And each extra has those that its name stands for: what is asked for is what is installed."""
    absent_of_core = set(absent("core"))
    assert set(optional.EXTRAS) <= absent_of_core
    modules = {canonical(name): name for name in optional.EXTRAS}
    for extra in ("plot", "files", "mesh"):
        own = {name for name, module in modules.items() if optional.EXTRAS[module] == extra}
        assert wanted(EXTRAS[extra]) == own


def test_all_extras_together_have_what_the_solver_can_use():
    assert distributions("all") == set().union(*map(distributions, ("plot", "files", "mesh")))
    assert distributions("all") < distributions("study")


def test_what_is_asked_for_names_every_missing_package(monkeypatch):
    for name in ("gmsh", "pandas", "xarray"):
        monkeypatch.setitem(sys.modules, name, None)
    with sentences.raises(optional.InputError, "gmsh, pandas and xarray"):
        optional.require("tasks need", "gmsh", "xarray", "meshio", "pandas")
    optional.require("tasks need", "meshio")
