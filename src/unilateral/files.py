"""How files are written: whole or not at all, with the permissions that the umask leaves."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from unilateral.errors import InputError, StorageError


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A path of the same name in a folder of its own, whose files take their places if the block succeeds.

    Raises InputError for a folder that is not there, and StorageError for what the disk refuses.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise InputError(f"{path} cannot be written: there is no folder {path.parent}")
    try:
        with TemporaryDirectory(dir=path.parent, prefix=".") as folder:
            yield Path(folder) / path.name
            for file in sorted(Path(folder).iterdir()):
                os.replace(file, path.parent / file.name)
    except OSError as error:
        raise StorageError(f"{path} cannot be written: {error.strerror or error}") from error
