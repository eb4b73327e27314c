"""How files are written: whole or not at all, with the permissions that the umask leaves."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from unilateral.errors import InputError, StorageError, quote_input
from unilateral.system.optional import require

if TYPE_CHECKING:
    from xarray import Dataset

HIDDEN_SUFFIX = ".tmp"
"""The end of the names of folders in which files are written; git ignores them."""
WRITE_PERMISSIONS = 0o222
"""The permissions to write; a file that has none of them is kept, even from those who may write any file."""
NETCDF_OVERHEAD_BYTES = 2**20
"""netCDF takes fewer bytes than this beside the values."""
BAD_PLACE_ERRNOS = (
    *(errno.EACCES, errno.EPERM, errno.EROFS),
    *(errno.EEXIST, errno.EISDIR, errno.ENOTDIR, errno.ENAMETOOLONG, errno.ELOOP),
)
"""Reasons of the system that another place helps against: what is forbidden, and what is no possible name."""


def check_path(value: object, example: str) -> Path:
    """The path that is given as a text or a path; raises InputError, with an example, for anything else."""
    name = os.fspath(value) if isinstance(value, os.PathLike) else value
    if not isinstance(name, str) or not name or "\0" in name:
        raise InputError(f"{quote_input(repr(value))} is no name; give a text such as '{example}', or a Path")
    return Path(name)


def check_target(path: str | os.PathLike[str], endings: Mapping[str, Sequence[str]]) -> None:
    """Raises InputError for another ending, a folder that is not there, and a folder of that name.

    It is raised, too, where one of the optional packages is missing that stand beside the ending.
    """
    path = check_path(path, f"name{min(endings)}")
    if path.suffix not in endings:
        *first_endings, last = endings
        raise InputError(f"{path}: the ending must be {', '.join(first_endings)} or {last}")
    require(f"files that end in {path.suffix} need", *endings[path.suffix])
    check_writable(path)


def check_writable(path: Path) -> Path:
    """The file that is written: that of the path, or the one that it links to.

    Raises InputError unless its folder is there and may be written, and for what is there but is no file that
    may be written.
    """
    target = Path(os.path.realpath(path)) if path.is_symlink() else path
    if not target.parent.is_dir():
        raise InputError(f"{path} cannot be written: there is no folder {target.parent}")
    if not os.access(target.parent, os.W_OK):
        raise InputError(f"{path} cannot be written: nothing may be written in {target.parent}")
    if target.exists():
        if not target.is_file():
            raise InputError(
                f"{path} cannot be written: it is {'a folder' if target.is_dir() else 'no file'}"
            )
        mode = target.stat().st_mode
        if not mode & WRITE_PERMISSIONS or not os.access(target, os.W_OK):
            raise InputError(
                f"{path} cannot be written: it is write-protected; take another name, or allow it by "
                f"chmod u+w {target}"
            )
    return target


def make_write_error(path: Path, error: OSError) -> InputError:
    """The error to raise where a file cannot be written: StorageError, or InputError for a bad place."""
    kind = InputError if error.errno in BAD_PLACE_ERRNOS else StorageError
    return kind(f"{path} cannot be written: {error.strerror or error}")


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A path of the same name in a folder of its own; files there take their places if the block succeeds.

    A link stays one: the file that it links to is replaced. Raises InputError as `check_writable`, and
    StorageError for a full disk.
    """
    path = Path(path)
    target = check_writable(path)
    try:
        with make_hidden_folder(target) as folder:
            yield folder / path.name
            for file in sorted(folder.iterdir()):
                os.replace(file, target if file.name == path.name else target.parent / file.name)
    except OSError as error:
        raise make_write_error(path, error) from error


@contextmanager
def make_hidden_folder(path: Path) -> Iterator[Path]:
    """A new folder beside a path, which is removed at the end, after an interrupt too.

    Its name is known before it is there, and removing it begins again if an interrupt comes in between.
    """
    folder = path.parent / f".{path.name}.{os.urandom(8).hex()}{HIDDEN_SUFFIX}"
    try:
        folder.mkdir(mode=0o700)
        yield folder
    finally:
        try:
            _remove_folder(folder)
        finally:
            _remove_folder(folder)


def _remove_folder(folder: Path) -> None:
    """A folder with all in it, if it is there; `shutil.rmtree` makes an OSError of an interrupt."""
    for inner, _, files in os.walk(folder, topdown=False):
        for file in files:
            Path(inner, file).unlink(missing_ok=True)
        Path(inner).rmdir()


def write_netcdf(table: Dataset, path: Path, **options: Any) -> None:
    """Writes a netCDF-4 file. Raises OSError with the system's reason.

    On a full disk netCDF says "Permission denied" or "HDF error". Writing a plain file as large then raises
    an error that tells the reason.
    """
    try:
        table.to_netcdf(path, engine="netcdf4", **options)
    except (OSError, RuntimeError):
        path.write_bytes(bytes(table.nbytes + NETCDF_OVERHEAD_BYTES))
        raise


def format_file_size(*files: str | os.PathLike[str]) -> str:
    """The size of files together, such as 12 kB."""
    size = float(sum(os.path.getsize(file) for file in files))
    for unit in ("B", "kB", "MB"):
        if size < 999.5:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:.3g} GB"
