"""docs/command-line.md: every command, option, exit code and JSON field is there, and nothing else."""

import json
import re

import click
import pytest
from conftest import ROOT, load, load_certificate

from study.evidence import Unjudged
from study.ledger import claims
from study.ledger.claims import Judgement
from study.ledger.results import Results
from unilateral.cli import main
from unilateral.cli.application import EXIT_CODES, application
from unilateral.cli.cases import make_polygon_record

TEXT = (ROOT / "docs/command-line.md").read_text(encoding="utf-8")
CONTEXT = click.Context(application)
SECTIONS = dict(re.findall(r"^## (.*?)\n(.*?)(?=^## |\Z)", TEXT, re.MULTILINE | re.DOTALL))


def tables(text, head):
    """The rows of all tables whose first column has that head."""
    matches = re.findall(rf"^\| {head}.*? \|.*\n\|---.*\n((?:\|.*\n)+)", text, re.MULTILINE)
    return [
        tuple(cell.replace(r"\|", "|").strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1])
        for table in matches
        for row in table.splitlines()
    ]


def fields(name):
    """Those of --json of a command, as documented."""
    return [field for row in tables(SECTIONS[name], "field") for field in re.findall(r"`(\w+)`", row[0])]


def test_there_is_a_section_for_every_command():
    assert {*SECTIONS} == {*application.commands, "Completion", "The study"}
    assert {row[0] for row in tables(TEXT, "command")} == {
        f"[`{name}`](#{name})" for name in application.commands
    }


@pytest.mark.parametrize("name", application.commands)
def test_every_option_is_listed_and_no_other(name):
    """With its placeholder, as in help, which leaves out options of former versions."""
    documented = [row[0] for row in tables(SECTIONS[name], "option")]
    records = [param.get_help_record(CONTEXT) for param in application.commands[name].params]
    assert documented == [f"`{record[0]}`" for record in records if record]


def test_no_option_is_spoken_of_that_does_not_exist():
    expected = {
        opt
        for name in application.commands
        for param in application.commands[name].params
        for opt in param.opts
    }
    assert set(re.findall(r"(?<![\w-])--[A-Za-z][\w-]*", TEXT)) <= expected | {"--help", "--version"}


def test_the_exit_codes_are_those_of_help():
    in_help = re.findall(r"^ +(\d+) ", EXIT_CODES, re.MULTILINE)
    assert [row[0] for row in tables(TEXT, "exit code")] == in_help
    for codes in re.findall(r"^Exit codes: (.*)\.$", TEXT, re.MULTILINE):
        assert {"0", "2", "4", "130", "143"} <= {*codes.split(", ")} <= {*in_help}


def read_printed_json(capsys, *arguments):
    assert main([*arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_page_lists_the_fields_of_solve(capsys):
    assert fields("solve") == list(
        read_printed_json(capsys, "solve", "full_contact", "--h", "1/4", "--H", "1/2")
    )
    plan = read_printed_json(capsys, "solve", "natural", "--accuracy", "0.1", "--dry-run")
    (message,) = re.findall(
        r"With `--dry-run` there are (.*?)\.$", SECTIONS["solve"], re.MULTILINE | re.DOTALL
    )
    assert re.findall(r"`(\w+)`", message) == list(plan)


def test_the_page_lists_the_fields_of_cases(capsys):
    output = read_printed_json(capsys, "cases", "natural")
    assert set(fields("cases")) == set(output) | set(output["polygons"][0])
    (message,) = re.findall(r"^In the list of all cases polygons have .*$", TEXT, re.MULTILINE)
    listed = re.findall(r"`(\w+)`", message)
    assert listed == list(make_polygon_record(load("natural"), load_certificate("natural")))


def test_the_page_lists_the_fields_of_infsup(capsys):
    output = read_printed_json(capsys, "infsup", "--polygon", "square", "--h", "1/4", "--H", "1/2")
    assert set(fields("infsup")) == set(output)


def test_the_page_lists_the_fields_of_claims():
    """Of a claim that is not judged; the fields are the same as of others."""
    record = Judgement(claims.find_claim("4.12"), Results(""), Unjudged("no results")).record()
    first, *claim_fields = fields("claims")
    assert first == "claims"
    assert set(claim_fields) == {*record, "required", "holds"}
