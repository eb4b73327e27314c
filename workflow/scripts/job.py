"""What all jobs have in common: a log, tables that are checked, and one sentence if they fail."""

import os
import sys
import traceback
from contextlib import contextmanager, suppress
from time import perf_counter

from study.table_origin import stamp_rule
from unilateral.errors import InputError
from unilateral.system.memory import peak_mb
from unilateral.system.signals import cleaning_up


@contextmanager
def run(snakemake):
    """Within this context the work of a job is done, which is Snakemake's object.

    Tables among the input have to be those of their places, made with the present configuration.
    What is said goes to the job's log. A failure is told on the terminal, too, in one sentence: an InputError
    in its own, with its exit code, any other error by its name, with a traceback in the log.
    """
    log = snakemake.log[0]
    terminal = _redirect_output(log)
    start = perf_counter()
    try:
        with cleaning_up(), stamp_rule(snakemake.rule):
            _check_inputs([file for file in snakemake.input if file.endswith(".nc")], snakemake.config)
            yield
        seconds = perf_counter() - start
        # user and system, of this process and of those that it started
        processor_seconds = sum(os.times()[:4])
        cost = f"{seconds:.1f} s, {processor_seconds:.1f} s of the processor, with at most {peak_mb():.0f} MB"
        print(f"done in {cost}")
        return
    except InputError as error:
        message = str(error)
        code = error.exit_code
    except Exception as error:
        name = traceback.format_exception_only(error)[-1].strip()
        message = f"{name}; the traceback is in {log}"
        code = 1
        with suppress(OSError):  # on a full disk
            traceback.print_exc()
    for stream in (terminal, sys.stderr):
        with suppress(OSError):
            print(f"unilateral: {message}", file=stream, flush=True)
    sys.exit(code)


def _check_inputs(files, config):
    if files:
        from study import tables  # which takes long to import

        for file in files:
            tables.load_table(file, config)


def _redirect_output(log):
    """Let all that this process writes, its libraries too, go to a file; where it was written to before."""
    terminal = os.fdopen(os.dup(sys.stderr.fileno()), "w", encoding="utf-8")
    with open(log, "w", encoding="utf-8") as file:
        for stream in (sys.stdout, sys.stderr):
            os.dup2(file.fileno(), stream.fileno())
            stream.reconfigure(line_buffering=True)
    return terminal
