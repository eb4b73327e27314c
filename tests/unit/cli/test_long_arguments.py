"""Whatever is typed of 5000 characters is refused with exit code 2."""

import click
import pytest
from conftest import ROOT

from unilateral.cli.application import application

LONG = {
    "digits": "9" * 5000,
    "words": "1 a " * 1250,
    "list": "1," * 2500 + "1",
    "path": "a/" * 2500 + "b.svg",
}
SIZES = {"--h": "1/8", "--H": "1/4"}
ARGUMENTS = {
    "solve": ["natural"],
    "check": [str(ROOT / "examples/shelter.yaml")],
    "cases": ["natural"],
    "export": ["natural"],
    "score": ["folder", "u.csv"],
    "certify": ["natural"],
}
OPTIONS = {
    "solve": SIZES,
    "export": SIZES | {"--out": "out"},
    "certify": {"--solution": str(ROOT / "tests/data/getfem_natural_n32_H2h.csv"), "--mesh": "own.msh"},
    "infsup": SIZES | {"--polygon": "square"},
}
IN_PLACE = {"--mesh": "--h", "--cells": "--H"}
"""Options, and those in whose place they are given."""
OF_ACCURACY = ("--accuracy", "--norm", "--max-unknowns", "--max-seconds", "--max-memory")


def type_command(command, param, text):
    """The arguments with which a command would run, but for this text as one of them."""
    arguments = [*ARGUMENTS.get(command, [])]
    options = dict(OPTIONS.get(command, {}))
    if isinstance(param, click.Argument):
        position = 1 if param.name == "solutions" else 0
        arguments[position : position + 1] = [text]
    else:
        name = max(param.opts, key=len)
        if name in OF_ACCURACY:
            options = {"--accuracy": "1/2"}
        options.pop(IN_PLACE.get(name), None)
        options[name] = text
    return [command, *arguments, *(item for pair in options.items() for item in pair)]


PARAMS = [
    (name, param)
    for name, command in application.commands.items()
    for param in command.params
    if not getattr(param, "is_flag", False)
]


@pytest.mark.parametrize(("command", "param"), PARAMS, ids=[f"{name} {param.name}" for name, param in PARAMS])
def test_a_long_argument_is_refused(refusal, tmp_path, monkeypatch, command, param):
    monkeypatch.chdir(tmp_path)
    for text in LONG.values():
        refusal(*type_command(command, param, text))
    assert not list(tmp_path.iterdir())


def test_a_number_with_as_many_digits_as_are_read_is_no_long_one(run):
    """Control: 18 digits are a number of unknowns."""
    assert run("solve", "natural", "--accuracy", "1/2", "--max-unknowns", "9" * 18)[0] == 0
