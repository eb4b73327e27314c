"""`make` begins with this. It undoes what a killed run left: Snakemake's lock, and files half written.

`python workflow/resume.py snakemake -j2` then becomes that command, which holds a lock as long as it lives.
So of two that are started together the second one ends here, before Snakemake has its own lock.
"""

import fcntl
import os
import shutil
import sys
from pathlib import Path

from unilateral.system.files import HIDDEN

LOCKS = Path(".snakemake/locks")
WRITTEN = ["results/**/", "figures/", "docs/", ""]
"""The folders that rules write to; at the top these are documents only."""
AT_WORK = "Another run of the study is at work in this folder; wait until it has ended, or end it."


def main(command=()):
    """Undo what a killed run left; then become the command, if there is one."""
    if command:
        _be_the_only_one()
    _undo()
    if command:
        os.execvp(command[0], command)


def _be_the_only_one():
    """Hold a lock on this file until this process has ended, whatever program it is by then."""
    own = os.open(__file__, os.O_RDONLY)
    os.set_inheritable(own, True)
    try:
        fcntl.flock(own, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        sys.exit(AT_WORK)
    except OSError:  # some shared file systems have no locks
        os.close(own)


def _undo():
    locks = list(LOCKS.glob("*"))
    with open("Snakefile", encoding="utf-8") as snakefile:
        try:
            fcntl.flock(snakefile, fcntl.LOCK_EX | fcntl.LOCK_NB)  # every run holds it, as the Snakefile says
        except BlockingIOError:
            if locks:
                sys.exit(AT_WORK)
            return
        except OSError:
            return  # some shared file systems have no locks: nobody knows whether another run lives
        for lock in locks:
            lock.unlink()
        for folder in WRITTEN:
            for left in Path().glob(f"{folder}.*{'' if folder else '.md'}.*{HIDDEN}"):
                shutil.rmtree(left)


if __name__ == "__main__":
    main(sys.argv[1:])
