"""How files are written: whole or not at all, with the permissions that the umask leaves."""

import ctypes
import os
import resource
import shutil
import signal
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory

import pandas as pd
import pytest
import sentences
import xarray as xr

from study import tables
from study.documents import marks
from study.style import open_figure
from unilateral.errors import InputError, StorageError
from unilateral.geometry.files import write_mesh
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh
from unilateral.system import signals
from unilateral.system.files import replacing, write_netcdf


def figure(path):
    with open_figure(path, 5):
        pass


UNFILLED = "<!-- a: begin -->\n<!-- a: end -->\n"


def document(path):
    if not path.exists():
        path.write_text(UNFILLED)
    marks.fill_document(path, {}, {"a": "1"}, {})


WRITERS = {
    "mesh.vtu": lambda path: write_mesh(make_structured_mesh(square(), 1), path),
    "errors.nc": lambda path: tables.save_table(xr.Dataset({"x": [1.0]}), path, "scene"),
    "rates.csv": lambda path: tables.save_csv(pd.DataFrame({"x": [1.0]}), path),
    "rates.svg": figure,
    "paper.md": document,
}


@pytest.fixture
def umask(request):
    old = os.umask(request.param)
    yield request.param
    os.umask(old)


@pytest.mark.parametrize("umask", [0o077, 0o027, 0o022, 0o002, 0o000], indirect=True, ids=oct)
@pytest.mark.parametrize("name", WRITERS)
def test_a_file_has_the_permissions_of_any_new_file_and_nothing_beside_it(tmp_path, umask, name):
    """POSIX: a new file that asks for 0666 gets 0666 less the umask."""
    WRITERS[name](tmp_path / name)
    assert [file.name for file in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).stat().st_mode & 0o777 == 0o666 & ~umask


@pytest.mark.parametrize("name", WRITERS)
def test_a_writer_that_fails_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, name):
    """At its last step, where all of the new file is written."""

    def full(*_):
        raise OSError("no space left")

    path = tmp_path / name
    path.write_text(UNFILLED)
    monkeypatch.setattr(os, "replace", full)
    with sentences.raises(StorageError, name) as error:
        WRITERS[name](path)
    assert error.value.exit_code == 4
    assert (path.read_text(), list(tmp_path.iterdir())) == (UNFILLED, [path])


def test_what_fails_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(TypeError), replacing(path) as temporary:
        temporary.write_bytes("no bytes")
    assert (path.read_text(), list(tmp_path.iterdir())) == ("old", [path])


def test_files_beside_the_named_one_come_with_it(tmp_path):
    """As of a mesh format that keeps its numbers in a second file."""
    with replacing(tmp_path / "mesh.xdmf") as temporary:
        temporary.write_text("1")
        temporary.with_suffix(".h5").write_text("2")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["mesh.h5", "mesh.xdmf"]


@pytest.mark.parametrize("name", [name for name in WRITERS if name != "paper.md"])
def test_a_folder_that_is_not_there_is_refused(tmp_path, name):
    with sentences.raises(InputError, name) as error:
        WRITERS[name](tmp_path / "missing" / name)
    assert error.value.exit_code == 2
    assert not list(tmp_path.iterdir())


def test_a_folder_in_the_place_of_a_file_is_refused(tmp_path):
    """Its name is taken by no file."""
    with sentences.raises(InputError, "a.nc") as error:
        written_beside_a_folder(tmp_path / "a.nc")
    assert error.value.exit_code == 2


def written_beside_a_folder(path):
    with replacing(path) as temporary:
        path.mkdir()
        temporary.write_text("new")


UNCLOSED = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
"""A file that is open when its writer is ended is closed with a warning."""


class Ending:
    """Raises what the handler of SIGTERM raises, at one of the moments at which Python calls handlers.

    These are the entry of a function and the return from one that is written in C; the profiler is called
    there, too. The moments are counted from 0. For `moment=None` nothing is raised.
    """

    def __init__(self, moment=None):
        self.moment = moment
        self.n_moments = 0

    def __call__(self, frame, event, argument):
        if event in ("call", "c_return"):
            self.n_moments += 1
            if self.n_moments - 1 == self.moment:
                raise SystemExit(signals.EXIT_TERMINATED)


def write_and_end(folder, context, ending):
    """Writes a file under the profiler, and returns whether that was ended."""
    try:
        sys.setprofile(ending)
        with context(folder / "a.txt") as temporary:
            temporary.write_text("new")
        sys.setprofile(None)
    except (SystemExit, OSError):  # which the standard library makes of it at some moments
        return True
    finally:
        sys.setprofile(None)
    return False


def end_at_each_moment(folder, context):
    """How many moments there are to end writing at, at how many of them it ends, and leaves something."""
    counting = Ending()
    write_and_end(folder, context, counting)
    ended = left_behind = 0
    for moment in range(counting.n_moments):
        ended += write_and_end(folder, context, Ending(moment))
        remains = [file for file in folder.iterdir() if file.name != "a.txt"]
        left_behind += bool(remains)
        for file in remains:
            shutil.rmtree(file)
    return counting.n_moments, ended, left_behind


@UNCLOSED
def test_no_moment_to_be_ended_leaves_a_hidden_folder(tmp_path):
    n_moments, ended, left_behind = end_at_each_moment(tmp_path, replacing)
    assert ended == n_moments > 50
    assert left_behind == 0


@UNCLOSED
def test_a_folder_whose_name_comes_too_late_is_left_at_some_moments(tmp_path):
    """Control: the standard library's, between making and remembering it, and while removing it."""

    @contextmanager
    def plain(path):
        with TemporaryDirectory(dir=path.parent, prefix=".") as folder:
            yield Path(folder) / path.name

    _, ended, left_behind = end_at_each_moment(tmp_path, plain)
    assert ended > 50
    assert left_behind > 0


def test_handlers_are_as_before_afterwards_and_what_is_ignored_stays_so():
    """As SIGINT is of a command in the background."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN), signal.getsignal(signal.SIGTERM)
    with signals.cleaning_up():
        inside = signal.getsignal(signal.SIGINT)
        with pytest.raises(SystemExit) as error:
            os.kill(os.getpid(), signal.SIGTERM)
    after = signal.signal(signal.SIGINT, before[0]), signal.getsignal(signal.SIGTERM)
    assert (inside, error.value.code, after) == (signal.SIG_IGN, 143, (signal.SIG_IGN, before[1]))


def caught():
    """The signals that have a handler, as the system knows it; see proc(5)."""
    (line,) = [line for line in Path("/proc/self/status").read_text().splitlines() if "SigCgt" in line]
    mask = int(line.split()[1], 16)
    return {number for number in signal.valid_signals() if mask >> (number - 1) & 1}


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="/proc tells the system's handlers")
@pytest.mark.parametrize("retained", [True, False], ids=["kept", "control"])
def test_handlers_that_a_library_written_in_c_resets_are_set_again(retained):
    """As the system knows them: Python is not told of it. Control: they are gone without that."""
    sent = signal.SIGUSR1
    before = signal.signal(sent, lambda *_: None)
    try:
        with signals.keeping_handlers() if retained else nullcontext():
            reset = ctypes.CDLL(None).signal
            reset.argtypes = (ctypes.c_int, ctypes.c_void_p)
            reset.restype = ctypes.c_void_p
            reset(sent, None)  # SIG_DFL
            assert sent not in caught()
        assert (sent in caught()) == retained
    finally:
        signal.signal(sent, before)


def test_in_another_thread_handlers_are_left_alone():
    """Python lets the main thread alone set them; a solve in another one must not fail for that."""

    def work():
        with signals.keeping_handlers():
            return "done"

    with ThreadPoolExecutor() as pool:
        assert pool.submit(work).result() == "done"


@pytest.mark.parametrize("size", [0, 100])
def test_a_full_disk_is_told_as_the_system_tells_it(tmp_path, size):
    """A limit on the size of files stands for the disk; netCDF says other things. Control: no limit."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        with pytest.raises((OSError, RuntimeError)) as plain:
            xr.Dataset({"x": [1.0]}).to_netcdf(tmp_path / "plain.nc", engine="netcdf4")
        with pytest.raises(OSError, match="File too large"):
            write_netcdf(xr.Dataset({"x": [1.0]}), tmp_path / "s.nc")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert "File too large" not in str(plain.value)
    write_netcdf(xr.Dataset({"x": [1.0]}), tmp_path / "other.nc")
    assert xr.load_dataset(tmp_path / "other.nc").x == 1


@pytest.mark.parametrize("name", WRITERS)
def test_a_write_protected_file_is_kept(tmp_path, name):
    """Whoever runs it: the superuser may write any file, and this one was protected for a reason."""
    path = tmp_path / name
    path.write_text(UNFILLED)
    path.chmod(0o444)
    with sentences.raises(InputError, name):
        WRITERS[name](path)
    assert path.read_text() == UNFILLED
    assert [item.name for item in tmp_path.iterdir()] == [name]
    path.chmod(0o644)
    WRITERS[name](path)
    assert path.read_bytes() != UNFILLED.encode()


@pytest.mark.parametrize("name", [name for name in WRITERS if name != "paper.md"])
def test_a_link_stays_and_the_file_behind_it_is_replaced(tmp_path, name):
    """As a shell's redirection does; the file behind it may have another ending, and may not be there yet."""
    (tmp_path / "elsewhere").mkdir()
    behind = tmp_path / "elsewhere" / "data"
    link = tmp_path / name
    link.symlink_to(behind)
    WRITERS[name](link)
    first = behind.read_bytes()
    behind.write_text(UNFILLED)
    WRITERS[name](link)
    assert link.is_symlink()
    assert behind.read_bytes() == first
    assert {path.name for path in tmp_path.rglob("*")} == {"elsewhere", "data", name}
    behind.chmod(0o444)
    with sentences.raises(InputError):
        WRITERS[name](link)
    behind.unlink()
    behind.parent.rmdir()
    with sentences.raises(InputError, name):
        WRITERS[name](link)


def test_what_is_no_file_is_kept(tmp_path):
    os.mkfifo(tmp_path / "pipe.nc")
    with (
        sentences.raises(InputError),
        replacing(tmp_path / "pipe.nc"),
    ):
        pass
    with sentences.raises(InputError), replacing(tmp_path):
        pass
