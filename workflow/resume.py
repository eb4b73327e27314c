"""`make` begins with this. It undoes what a killed run left: Snakemake's lock, and files half written.

`python workflow/resume.py snakemake -j2` then becomes that command, which holds a lock as long as it lives.
So of two that are started together the second one ends here, before Snakemake has its own lock.
"""

import fcntl
import os
import shutil
import sys
from pathlib import Path

from unilateral.system.files import HIDDEN_SUFFIX

LOCKS = Path(".snakemake/locks")
WRITTEN_FOLDERS = ["results/**/", "figures/", "docs/", ""]
"""The folders that rules write to; at the top these are documents only."""
OTHER_RUN_MESSAGE = "Another run of the study is at work in this folder; wait until it has ended, or end it."


def main(command=()):
    """Undo what a killed run left; then become the command, if there is one."""
    if command:
        _hold_run_lock()
    _remove_leftovers()
    if command:
        os.execvp(command[0], command)


def _hold_run_lock():
    """Hold a lock on this file until this process has ended, whatever program it is by then."""
    descriptor = os.open(__file__, os.O_RDONLY)
    os.set_inheritable(descriptor, True)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        sys.exit(OTHER_RUN_MESSAGE)
    except OSError:  # some shared file systems have no locks
        os.close(descriptor)


def _remove_leftovers():
    locks = list(LOCKS.glob("*"))
    with open("Snakefile", encoding="utf-8") as snakefile:
        try:
            fcntl.flock(snakefile, fcntl.LOCK_EX | fcntl.LOCK_NB)  # every run holds it, as the Snakefile says
        except BlockingIOError:
            if locks:
                sys.exit(OTHER_RUN_MESSAGE)
            return
        except OSError:
            return  # some shared file systems have no locks: nobody knows whether another run lives
        for lock in locks:
            lock.unlink()
        for folder in WRITTEN_FOLDERS:
            for leftover in Path().glob(f"{folder}.*{'' if folder else '.md'}.*{HIDDEN_SUFFIX}"):
                shutil.rmtree(leftover)


if __name__ == "__main__":
    main(sys.argv[1:])
