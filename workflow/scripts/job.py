"""A job of any rule: it calls the function that the parameter `job` names, such as manifest.write_manifest.

The function is one of study. It is given what its rule names: input, output and the other params.
"""

import os
import sys
import traceback
from contextlib import suppress
from importlib import import_module
from time import perf_counter

from study import table_origin
from unilateral.errors import InputError
from unilateral.system.memory import peak_mb
from unilateral.system.signals import cleaning_up


def run(job):
    """Call the function of a job, which is Snakemake's object.

    Tables among the input have to be those of their places, made with the present configuration.
    What is said goes to the job's log. A failure is told on the terminal, too, in one sentence: an InputError
    in its own, with its exit code, any other error by its name, with a traceback in the log.
    """
    terminal, start = _speak_into(job.log[0]), perf_counter()
    try:
        with cleaning_up(), table_origin.made_by(job.rule):
            _check([file for file in job.input if file.endswith(".nc")], job.config)
            names = {**dict(job.input.items()), **dict(job.output.items()), **dict(job.params.items())}
            module, _, function = names.pop("job").rpartition(".")
            getattr(import_module(f"study.{module}"), function)(**names)
        print(f"done in {perf_counter() - start:.1f} s, with at most {peak_mb():.0f} MB")
        return
    except InputError as error:
        said, code = str(error), error.exit_code
    except Exception as error:
        name = traceback.format_exception_only(error)[-1].strip()
        said, code = f"{name}; the traceback is in {job.log[0]}", 1
        with suppress(OSError):  # on a full disk
            traceback.print_exc()
    for place in (terminal, sys.stderr):
        with suppress(OSError):
            print(f"unilateral: {said}", file=place, flush=True)
    sys.exit(code)


def _check(files, config):
    if files:
        from study import tables  # which takes long to import

        for file in files:
            tables.load(file, config)


def _speak_into(log):
    """Let all that this process writes, its libraries too, go to a file; where it was written to before."""
    terminal = os.fdopen(os.dup(sys.stderr.fileno()), "w", encoding="utf-8")
    with open(log, "w", encoding="utf-8") as file:
        for stream in (sys.stdout, sys.stderr):
            os.dup2(file.fileno(), stream.fileno())
            stream.reconfigure(line_buffering=True)
    return terminal


if __name__ == "__main__":
    run(snakemake)
