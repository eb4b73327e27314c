"""How a script runs as a job of its rule: what it is given, where it speaks, and how it ends."""

import re
import subprocess
import sys

import pytest
from conftest import ROOT

from study import tables

SCRIPTS = ROOT / "workflow/scripts"


def run_job(statements, folder, data=(), config=None):
    """How a job ends that runs these statements, and its log.

    Its rule is named `made`; its input is `given`, and the configuration is `config`.
    """
    log = folder / "job.log"
    files = [str(file) for file in data]
    code = f"import os, signal, sys, warnings; sys.path.append({str(SCRIPTS)!r})\n"
    code += "from types import SimpleNamespace; from job import run; from unilateral import errors\n"
    code += f"snakemake = SimpleNamespace(input={files}, log=[{str(log)!r}])\n"
    code += f"snakemake.rule, snakemake.config = 'made', {config or {}}\n"
    code += f"with run(snakemake):\n    {statements}\n"
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert process.stdout == ""
    return process, log.read_text()


@pytest.mark.parametrize(
    ("fault", "code", "message"),
    [
        ("errors.InputError('case x: u < g')", 2, "unilateral: case x: u < g\n"),
        ("errors.StorageError('x.nc is damaged')", 4, "unilateral: x.nc is damaged\n"),
    ],
)
def test_bad_input_and_bad_files_end_a_script_in_one_sentence(tmp_path, fault, code, message):
    """On the terminal, and as the last line of the log, where what was said before stands, too."""
    exit_code, log = run_job(f"print('a table'); raise {fault}", tmp_path)
    assert (exit_code.returncode, exit_code.stderr) == (code, message)
    assert log == f"a table\n{message}"


def test_any_other_error_leaves_its_traceback_in_the_log(tmp_path):
    exit_code, log = run_job("raise KeyError('x')", tmp_path)
    text = f"unilateral: KeyError: 'x'; the traceback is in {tmp_path / 'job.log'}\n"
    assert (exit_code.returncode, exit_code.stderr) == (1, text)
    assert log.startswith("Traceback")
    assert log.endswith(f"\nKeyError: 'x'\n{text}")


def test_all_that_a_job_says_is_in_its_log_in_order(tmp_path):
    """Lines, warnings, and what a library writes past Python; on the terminal there is nothing."""
    exit_code, log = run_job("print('a'); warnings.warn('b'); os.system('echo c'); print('d')", tmp_path)
    assert (exit_code.returncode, exit_code.stderr) == (0, "")
    cost = r"[\d.]+ s, [\d.]+ s of the processor, with at most \d+ MB"
    assert re.fullmatch(rf"a\n.*UserWarning: b\nc\nd\ndone in {cost}\n", log)


def test_cases_of_a_scene_are_certified(tmp_path):
    """A case whose gap is negative next to its transition does not get into the study."""
    text = (ROOT / "manufactured/thirds.yaml").read_text().replace("pos(1/3 - t, 3/2)", "pos(1/2 - t, 3/2)")
    (tmp_path / "broken.yaml").write_text(text)
    scene = {"polygon": "square", "side": 0, "cases": [str(tmp_path / "broken.yaml")]}
    exit_code, _ = run_job(f"from study import scenes; scenes.load_cases({scene!r})", tmp_path)
    assert re.fullmatch(r"unilateral: case 'broken' .*lambda \(u - g\) is not 0.*\n", exit_code.stderr)


def test_a_damaged_mesh_says_how_it_is_made_anew(tmp_path):
    """An emptied one, as `bound_totals` reads it."""
    (tmp_path / "mesh.vtu").write_text("")
    read = f"scenes.read_coarsest_mesh({str(tmp_path / 'mesh.vtu')!r}, {{'polygon': 'square'}})"
    exit_code, _ = run_job(f"from study import scenes; {read}", tmp_path)
    text = r"unilateral: .*mesh\.vtu: the file is empty.*; 'snakemake -j2 -f .*mesh\.vtu' makes it anew\n"
    assert re.fullmatch(text, exit_code.stderr)
    assert exit_code.returncode == 4


def test_a_job_stamps_its_tables_and_refuses_those_of_another_configuration(tmp_path):
    """It refuses before its function begins. Control: it takes the table with the configuration as it was."""
    table = tmp_path / "square/errors.nc"
    table.parent.mkdir()
    save = "from study import tables; import xarray; "
    save += f"tables.save_table(xarray.Dataset(), {str(table)!r}, 'square', {{'stop.tolerance': 1}})"
    assert run_job(save, tmp_path)[0].returncode == 0
    attrs = tables.load_table(table).attrs
    assert (attrs["table"], attrs["rule"], attrs["scene"]) == ("square/errors", "made", "square")
    exit_code, log = run_job("print('read')", tmp_path, [table], {"stop": {"tolerance": 2}})
    text = f"unilateral: {table} was made with stop.tolerance: 1, and the configuration has 2; "
    assert (exit_code.returncode, exit_code.stderr) == (
        4,
        f"{text}'snakemake -j2 -f {table}' makes it anew\n",
    )
    assert log == exit_code.stderr
    assert run_job("print('read')", tmp_path, [table], {"stop": {"tolerance": 1}})[1].startswith("read\n")


def test_a_job_that_is_ended_leaves_nothing_half_written(tmp_path):
    """By SIGTERM, in the midst of writing."""
    code = "from unilateral.system.files import replacing\n"
    code += f"    with replacing({str(tmp_path / 'a.txt')!r}): os.kill(os.getpid(), signal.SIGTERM)"
    exit_code, _ = run_job(code, tmp_path)
    assert exit_code.returncode == 143
    assert [file.name for file in tmp_path.iterdir()] == ["job.log"]
