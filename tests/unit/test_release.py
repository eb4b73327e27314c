"""A release has one version and one date, wherever they are told."""

import json
import re
import tomllib

import yaml
from conftest import ROOT

import unilateral

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
CATALOGUE = json.loads((ROOT / "codemeta.json").read_text(encoding="utf-8"))
CHANGES = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def newest():
    """Version and date of the first heading of a release, as Keep a Changelog 1.1.0 has it."""
    return re.search(r"^## \[(\d+\.\d+\.\d+)\] - (\d{4}-\d\d-\d\d)$", CHANGES, re.MULTILINE).groups()


def test_the_version_is_that_of_pyproject_everywhere():
    """An installation that is older than pyproject.toml is told, too."""
    report = [unilateral.__version__, CITATION["version"], CATALOGUE["version"], newest()[0]]
    assert report == [PROJECT["version"]] * 4


def test_the_date_is_that_of_the_changelog_everywhere():
    assert [str(CITATION["date-released"]), CATALOGUE["datePublished"]] == [newest()[1]] * 2


def test_catalogues_are_told_what_the_citation_says():
    """As cffconvert makes the one of the other."""
    assert CATALOGUE["name"] == CITATION["title"]
    assert CATALOGUE["keywords"] == CITATION["keywords"] == PROJECT["keywords"]
    assert [author["name"] for author in CATALOGUE["author"]] == [
        author["name"] for author in CITATION["authors"]
    ]
    assert CATALOGUE["license"] == f"https://spdx.org/licenses/{CITATION['license']}"
    assert CITATION["license"] == PROJECT["license"]


def test_the_changelog_has_the_sections_of_its_format_only():
    """Keep a Changelog 1.1.0, "How do I make a good changelog?"."""
    expected = {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
    assert set(re.findall(r"^### (.*)$", CHANGES, re.MULTILINE)) <= expected
    headings = re.findall(r"^## (.*)$", CHANGES, re.MULTILINE)
    assert all(
        re.fullmatch(r"\[Unreleased\]|\[\d+\.\d+\.\d+\] - \d{4}-\d\d-\d\d", heading) for heading in headings
    )
