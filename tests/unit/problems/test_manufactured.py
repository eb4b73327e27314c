"""manufactured/README.md: its example is a case, and what it quotes is what the tool says."""

import pytest
from documents import blocks

from unilateral import cli

EXAMPLE, QUOTED = [block.text for block in blocks("manufactured/README.md")]
SLIPS = [
    ("+ pos(t - 4/5, 2)", "- pos(t - 4/5, 2)"),
    ("elsewhere: 1/25", "elsewhere: 1/20"),
    ("{ j: true", "{ j: false"),
    ("alpha:", "alfa:"),
    ("pos(a - t, 2)", "pos(a - y, 2)"),
]
"""One for each line that is quoted."""


def run_check(capsys, folder, declaration):
    (folder / "my_case.yaml").write_text(declaration)
    code = cli.main(["solve", "my_case.yaml", "--h", "1/8", "--H", "1/4"])
    return code, capsys.readouterr().err


def test_the_example_is_a_case(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run_check(capsys, tmp_path, EXAMPLE) == (0, "")


@pytest.mark.parametrize(("slip", "line"), list(zip(SLIPS, QUOTED.splitlines(), strict=True)))
def test_what_is_quoted_is_what_is_said_of_a_slip_in_the_example(capsys, tmp_path, monkeypatch, slip, line):
    monkeypatch.chdir(tmp_path)
    assert EXAMPLE.count(slip[0]) == 1
    assert run_check(capsys, tmp_path, EXAMPLE.replace(*slip)) == (2, f"unilateral: {line}\n")
