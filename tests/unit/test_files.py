"""How files are written: whole or not at all, with the permissions that the umask leaves."""

import os

import pandas as pd
import pytest
import xarray as xr

from unilateral.errors import InputError, StorageError
from unilateral.files import replacing
from unilateral.geometry.mesh_files import write
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import structured
from unilateral.study import tables
from unilateral.study.figures.style import figure_in
from unilateral.study.text import marks


def figure(path):
    with figure_in(path, 5):
        pass


def document(path):
    path.write_text("<!-- a: begin -->\n<!-- a: end -->\n")
    marks.fill(path, {}, {"a": "1"}, {})


WRITERS = {
    "mesh.vtu": lambda path: write(structured(square(), 1), path),
    "errors.nc": lambda path: tables.save(xr.Dataset({"x": [1.0]}), path, "scene"),
    "rates.csv": lambda path: tables.save_csv(pd.DataFrame({"x": [1.0]}), path),
    "rates.svg": figure,
    "paper.md": document,
}


@pytest.fixture
def masked(request):
    old = os.umask(request.param)
    yield request.param
    os.umask(old)


@pytest.mark.parametrize("masked", [0o077, 0o027, 0o022, 0o002, 0o000], indirect=True, ids=oct)
@pytest.mark.parametrize("name", WRITERS)
def test_a_file_has_the_permissions_of_any_new_file_and_nothing_beside_it(tmp_path, masked, name):
    """POSIX: a new file that asks for 0666 gets 0666 less the umask."""
    WRITERS[name](tmp_path / name)
    assert [file.name for file in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).stat().st_mode & 0o777 == 0o666 & ~masked


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


def test_a_folder_that_is_not_there(tmp_path):
    said = r"a\.nc cannot be written: there is no folder .*missing"
    with pytest.raises(InputError, match=said) as found, replacing(tmp_path / "missing" / "a.nc"):
        pass
    assert found.value.exit_code == 2


def test_what_the_disk_refuses(tmp_path):
    """A folder that is in the way: its name is taken by no file."""
    (tmp_path / "a.nc").mkdir()
    said = r"a\.nc cannot be written: Is a directory"
    with pytest.raises(StorageError, match=said) as found, replacing(tmp_path / "a.nc") as temporary:
        temporary.write_text("new")
    assert found.value.exit_code == 4
