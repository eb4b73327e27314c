"""How a script runs as a job of its rule: what it is given, where it speaks, and how it ends."""

import os
import sys
import traceback
from time import perf_counter

from unilateral.errors import InputError
from unilateral.memory import peak_mb


def run(main, job):
    """Call `main` with the named input, output and params of its rule; `job` is Snakemake's object.

    What is said goes to the job's log. A failure is told on the terminal, too, in one sentence: an InputError
    in its own, with its exit code, any other error by its name, with a traceback in the log.
    """
    terminal, start = _speak_into(job.log[0]), perf_counter()
    try:
        main(**dict(job.input.items()), **dict(job.output.items()), **dict(job.params.items()))
    except InputError as error:
        said, code = str(error), error.exit_code
    except Exception as error:
        name = traceback.format_exception_only(error)[-1].strip()
        said, code = f"{name}; the traceback is in {job.log[0]}", 1
        traceback.print_exc()
    else:
        print(f"done in {perf_counter() - start:.1f} s, with at most {peak_mb():.0f} MB")
        return
    for place in (terminal, sys.stderr):
        print(f"unilateral: {said}", file=place, flush=True)
    sys.exit(code)


def _speak_into(log):
    """Let all that this process writes, its libraries too, go to a file; where it was written to before."""
    terminal = os.fdopen(os.dup(sys.stderr.fileno()), "w", encoding="utf-8")
    with open(log, "w", encoding="utf-8") as file:
        for stream in (sys.stdout, sys.stderr):
            os.dup2(file.fileno(), stream.fileno())
            stream.reconfigure(line_buffering=True)
    return terminal
