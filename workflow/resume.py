"""`make` begins with this. It undoes what a killed run left: Snakemake's lock, and files half written."""

import fcntl
import shutil
import sys
from pathlib import Path

from unilateral.system.files import HIDDEN

LOCKS = Path(".snakemake/locks")
WRITTEN = ["results/**/", "figures/", "docs/", ""]
"""The folders that rules write to; at the top these are documents only."""


def main():
    locks = list(LOCKS.glob("*"))
    with open("Snakefile", encoding="utf-8") as snakefile:
        try:
            fcntl.flock(snakefile, fcntl.LOCK_EX | fcntl.LOCK_NB)  # every run holds it, as the Snakefile says
        except BlockingIOError:
            if locks:
                sys.exit(
                    "Another run of the study is at work in this folder; wait until it has ended, or end it."
                )
            return
        except OSError:
            return  # some shared file systems have no locks: nobody knows whether another run lives
        for lock in locks:
            lock.unlink()
        for folder in WRITTEN:
            for left in Path().glob(f"{folder}.*{'' if folder else '.md'}.*{HIDDEN}"):
                shutil.rmtree(left)


if __name__ == "__main__":
    main()
