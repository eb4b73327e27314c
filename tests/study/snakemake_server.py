"""Snakemake's command in children of one process, which has imported what takes long to import.

`python snakemake_server.py` reads a line of JSON for each command, [folder, argument, ...], and answers by
two: the number of its process, and when that has ended the exit code with what was printed on standard output
and error. A child is forked for every command, so that none sees what another one has left behind. Which
cases fit their polygons, and the digests of the study's scripts, are known before.
"""

import json
import os
import sys
from pathlib import Path
from tempfile import TemporaryFile

import snakemake.cli

from study import code, config
from study.documents import marks  # noqa: F401 - imported for the Snakefile
from study.ledger import claims  # noqa: F401 - imported for the Snakefile

ROOT = Path(__file__).parents[2]


def main():
    os.chdir(ROOT)
    files = sorted(str(file) for file in Path("workflow/config").glob("*.yaml"))
    config.check(*config.read_configuration(files), "workflow/schemas/study.schema.yaml")
    for script in Path("workflow/scripts").glob("*.py"):
        code.digest_program(str(script))
    for line in sys.stdin:
        folder, *arguments = json.loads(line)
        with TemporaryFile("w+") as out, TemporaryFile("w+") as err:
            child = os.fork()
            if child == 0:
                become(folder, arguments, out, err)
                snakemake.cli.main()  # which ends the child
            print(child, flush=True)
            exit_code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
            print(json.dumps([exit_code, text(out), text(err)]), flush=True)


def become(folder, arguments, out, err):
    """The process that was begun in that folder with these arguments and streams, a group of its own."""
    os.setsid()
    os.chdir(folder)
    os.dup2(out.fileno(), 1)
    os.dup2(err.fileno(), 2)
    os.close(0)
    sys.argv[1:] = arguments


def text(file):
    file.seek(0)
    return file.read()


if __name__ == "__main__":
    main()
