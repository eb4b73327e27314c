"""`unilateral claims` on the study's results."""

import shlex

import click
import pytest
from conftest import ROOT

from unilateral.cli import main
from unilateral.cli.application import application

EXAMPLES = application.get_command(click.Context(application), "claims").examples


@pytest.mark.parametrize("example", EXAMPLES)
def test_the_examples_of_help_work_as_typed(monkeypatch, capsys, example):
    """Where the results are: every claim of the study holds. A spoilt one would end with 1."""
    monkeypatch.chdir(ROOT)
    program, *arguments = shlex.split(example)
    assert (program, main(arguments)) == ("unilateral", 0)
    out, err = capsys.readouterr()
    assert (out != "", err) == (True, "")
