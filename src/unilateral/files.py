"""How files are written: whole or not at all, with the permissions that the umask leaves."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from unilateral.errors import InputError, StorageError


def check_target(path: str | os.PathLike[str], endings: Collection[str]) -> None:
    """Raises InputError for another ending, a folder that is not there, and a folder of that name."""
    path = Path(path)
    if path.suffix not in endings:
        *others, last = endings
        raise InputError(f"{path}: the ending must be {', '.join(others)} or {last}")
    check_folder(path)
    if path.is_dir():
        raise InputError(f"{path} cannot be written: it is a folder")


def check_folder(path: Path) -> None:
    """Raises InputError unless the folder of a file is there and may be written."""
    if not path.parent.is_dir():
        raise InputError(f"{path} cannot be written: there is no folder {path.parent}")
    if not os.access(path.parent, os.W_OK):
        raise InputError(f"{path} cannot be written: nothing may be written in {path.parent}")


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A path of the same name in a folder of its own, whose files take their places if the block succeeds.

    Raises InputError for a folder that is not there, and StorageError for what the disk refuses.
    """
    path = Path(path)
    check_folder(path)
    try:
        with TemporaryDirectory(dir=path.parent, prefix=".") as folder:
            yield Path(folder) / path.name
            for file in sorted(Path(folder).iterdir()):
                os.replace(file, path.parent / file.name)
    except OSError as error:
        raise StorageError(f"{path} cannot be written: {error.strerror or error}") from error
