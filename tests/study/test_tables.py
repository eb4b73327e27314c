"""Tables as files: described, byte-identical, never half written."""

import hashlib
import json
import re
import shutil
import subprocess
import sys

import netCDF4
import numpy as np
import pandas as pd
import pytest
import sentences
import xarray as xr
from conftest import ROOT

import unilateral
from study import table_origin, tables
from unilateral.errors import InputError, StorageError

SCRIPTS = ROOT / "workflow/scripts"
RUN = ("case", "mesh", "partition")


def level(h, case="made_up", error=0.25, expected=(0.5, 0.25)):
    """What a sweep gives for one mesh, in small."""
    return xr.Dataset(
        {
            "h1_error": (RUN, np.array([[[error, np.nan]]])),
            "algorithm": (RUN, np.array([[["uzawa", ""]]], dtype=object)),
            "projection_error": (("case", "partition"), np.array([expected])),
        },
        coords={"case": [case], "h": ("mesh", [h]), "H": ("partition", [0.5, 0.25])},
    )


@pytest.fixture
def table_file(tmp_path):
    tables.save_table(level(0.5), tmp_path / "errors.nc", "scene")
    return tmp_path / "errors.nc"


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_table_comes_back_as_it_was_with_its_description(tmp_path):
    written = level(0.125)
    tables.save_table(written, tmp_path / "errors.nc", "made_up_scene")
    read = tables.load_table(tmp_path / "errors.nc")
    xr.testing.assert_equal(read, written)
    assert read.attrs["scene"] == "made_up_scene"
    assert read.attrs["unilateral"] == unilateral.__version__
    assert read.attrs["python"] == ".".join(map(str, sys.version_info[:3]))
    assert read.attrs["source"] == tables.SOURCE
    assert [entry.split()[0] for entry in read.attrs["libraries"].split(", ")] == list(
        tables.STAMPED_LIBRARIES
    )
    for name in read.variables:
        described = [read[name].attrs.get(key) for key in ("long_name", "units", "equation")]
        assert described == (tables.VARIABLES[name] if name != "case" else [None] * 3)


def test_a_table_tells_its_parameters_in_one_order(tmp_path):
    """As JSON, whatever the order in which they are given; without any it says so."""
    data = [{"scene": {"h": "1/8", "judged": True}, "stop": 0.01}, None]
    data.append({"stop": 0.01, "scene": {"judged": True, "h": "1/8"}})
    report = []
    sums = []
    for parameters in data:
        tables.save_table(level(0.5), tmp_path / "errors.nc", "scene", parameters)
        report.append(json.loads(tables.load_table(tmp_path / "errors.nc").attrs["parameters"]))
        sums.append(digest(tmp_path / "errors.nc"))
    assert report == [data[0], {}, data[0]]
    assert sums[0] == sums[2] != sums[1]


def test_tables_keep_to_the_conventions_for_climate_and_forecast(tmp_path):
    """CF-1.11: 2.6.1 and 2.6.2 name three attributes, 2.5.1 no missing coordinates, 3.1 units of UDUNITS."""
    full = level(0.125).assign(unknowns=("mesh", [9])).assign_coords(mesh=[0])
    tables.save_table(full, tmp_path / "errors.nc", "scene")
    with netCDF4.Dataset(tmp_path / "errors.nc") as file:
        assert file.Conventions == "CF-1.11"
        assert (file.title, file.history) == (
            "unilateral problems, verified: scene",
            f"made by unilateral {tables.__version__}",
        )
        assert file["unknowns"].dtype == file["mesh"].dtype == np.int32
        assert not any(hasattr(file[name], "_FillValue") for name in ("h", "H", "mesh"))
        assert np.isnan(file["h1_error"]._FillValue)  # control: other variables have one
    expected = {"1", "s", "1/s", "byte/s", "degree", "1048576 byte"}
    assert {units for _, units, _ in tables.VARIABLES.values()} <= expected


def test_saving_leaves_the_table_as_it_is(tmp_path):
    table = level(0.125)
    tables.save_table(table, tmp_path / "errors.nc", "scene")
    assert table.attrs == {}
    assert table["h"].attrs == table["h1_error"].attrs == {}


def test_two_files_of_one_table_are_byte_identical(tmp_path):
    """In one place of two folders of results; one bit of a value makes another file."""
    files = [tmp_path / study / "scene/errors.nc" for study in ("one", "two", "other")]
    for file, error in zip(files, (0.25, 0.25, np.nextafter(0.25, 1)), strict=True):
        file.parent.mkdir(parents=True)
        tables.save_table(level(0.125, error=error), file, "scene")
    assert digest(files[0]) == digest(files[1]) != digest(files[2])


def test_a_table_that_is_not_there_is_refused():
    with sentences.raises(InputError):
        tables.load_table("results/none.nc")


@pytest.mark.parametrize("content", [b"", b"h\n1\n", b"\x89HDF\r\n\x1a\n"], ids=["empty", "text", "cut"])
def test_a_file_that_is_no_table_is_refused(tmp_path, content):
    path = tmp_path / "errors.nc"
    path.write_bytes(content)
    with sentences.raises(StorageError):
        tables.load_table(path)
    with sentences.raises(StorageError):
        tables.load_table(tmp_path)


def test_a_table_of_another_hand_is_refused(tmp_path):
    """Control: what is wrong with it is the missing checksum alone."""
    level(0.5).to_netcdf(tmp_path / "errors.nc", engine="netcdf4")
    with sentences.raises(StorageError):
        tables.load_table(tmp_path / "errors.nc")


def test_other_readers_pass_over_the_checksum(table_file):
    """The last line, as `sha256sum` gives it for all before it."""
    content, _, seal = table_file.read_bytes()[:-1].rpartition(b"\n")
    assert seal == b"sha256 " + hashlib.sha256(content).hexdigest().encode()
    xr.testing.assert_identical(xr.load_dataset(table_file), tables.load_table(table_file))
    with netCDF4.Dataset(table_file) as other_table:
        assert other_table["h1_error"][0, 0, 0] == 0.25


def test_no_flipped_bit_and_no_cut_goes_unnoticed(table_file):
    """200 bits drawn from all of the file, each bit of its last line, and 50 lengths."""
    full_bytes = table_file.read_bytes()
    rng = np.random.default_rng(1)
    bits = [
        *rng.integers(8 * len(full_bytes), size=200),
        *range(8 * (len(full_bytes) - tables.SEAL_BYTES), 8 * len(full_bytes)),
    ]
    for bit in bits:
        damaged = bytearray(full_bytes)
        damaged[bit // 8] ^= 1 << bit % 8
        table_file.write_bytes(damaged)
        with pytest.raises(StorageError, match="is damaged"):
            tables.load_table(table_file)
    for length in [*rng.integers(len(full_bytes), size=49), len(full_bytes) - 1]:
        table_file.write_bytes(full_bytes[:length])
        with pytest.raises(StorageError, match="is damaged"):
            tables.load_table(table_file)
    table_file.write_bytes(full_bytes)
    assert tables.load_table(table_file)["h1_error"][0, 0, 0] == 0.25


def test_a_flipped_bit_changes_a_value_where_nothing_checks(table_file):
    """Control."""
    full_bytes = table_file.read_bytes()
    right = xr.load_dataset(table_file)
    place = full_bytes.index(np.array([0.25, np.nan]).tobytes())
    table_file.write_bytes(
        full_bytes[: place + 6] + bytes([full_bytes[place + 6] ^ 16]) + full_bytes[place + 7 :]
    )
    assert not xr.load_dataset(table_file).equals(right)


@pytest.mark.parametrize("size", [0, 4000])
def test_a_full_disk_ends_in_one_sentence(tmp_path, size):
    """A limit on the size of files stands for the disk; netCDF says "Permission denied" or "HDF error"."""
    code = (
        f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))\n"
        f"import sys, types, xarray; sys.path.append({str(SCRIPTS)!r}); from job import run\n"
        "from study import tables\n"
        "with run(types.SimpleNamespace(input=[], rule='', config={}, log=['/dev/null'])):\n"
        f"    tables.save_table(xarray.Dataset({{'x': [1.0]}}), {str(tmp_path / 'errors.nc')!r}, 'scene')"
    )
    command = [sys.executable, "-c", code]
    process = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert re.fullmatch(r"unilateral: .*errors\.nc cannot be written: File too large\n", process.stderr)
    assert process.returncode == 4
    assert list(tmp_path.iterdir()) == []


PLACES = ("square/errors", "square/rates", "lshape/errors", "cost/errors", "runs/0", "runs/0_timings")


@pytest.fixture(scope="module")
def moved_results(tmp_path_factory):
    """A folder of results that was moved, with a table in each place."""
    results = tmp_path_factory.mktemp("study") / "results"
    for name in PLACES:
        path = results / f"{name}.nc"
        path.parent.mkdir(parents=True, exist_ok=True)
        tables.save_table(level(0.5), path, "scene")
    return results.rename(results.with_name("old"))


@pytest.mark.parametrize("name", PLACES)
def test_a_table_is_read_in_its_own_place_also_if_that_moved(moved_results, name):
    """Control of the next test."""
    table = tables.load_table(moved_results / f"{name}.nc")
    assert (table.attrs["table"], table["h"]) == (name, 0.5)


@pytest.mark.parametrize(("first", "second"), [(a, b) for a in PLACES for b in PLACES if a != b])
def test_a_table_in_the_place_of_another_is_refused(moved_results, tmp_path, first, second):
    """Of a scene, a rule or an experiment."""
    path = tmp_path / f"{second}.nc"
    path.parent.mkdir()
    shutil.copy(moved_results / f"{first}.nc", path)
    text = (
        f"{path} is the table '{first}', and '{second}' is expected; 'snakemake -j2 -f {path}' makes it anew"
    )
    with pytest.raises(StorageError, match=re.escape(text)):
        tables.load_table(path)


def test_a_table_that_does_not_tell_its_place_is_refused(tmp_path, monkeypatch):
    """As the first versions of this project wrote it."""
    monkeypatch.setattr(tables.table_origin, "origin_attributes", lambda *_: {"parameters": "{}"})
    tables.save_table(level(0.5), tmp_path / "errors.nc", "scene")
    with sentences.raises(StorageError):
        tables.load_table(tmp_path / "errors.nc")


STUDY = {"scenes": {"square": {"H": ["1/8", "1/16"]}, "lshape": {}}}


@pytest.fixture
def made_table(tmp_path):
    """A table that is made by a rule with the fields of a scene."""
    with table_origin.stamp_rule("solve"):
        tables.save_table(
            level(0.5), tmp_path / "errors.nc", "square", {"scenes.square": STUDY["scenes"]["square"]}
        )
    return tmp_path / "errors.nc"


@pytest.mark.parametrize("second", [{}, {"scenes": {**STUDY["scenes"], "lshape": {"H": ["1/8"]}}}])
def test_a_table_that_was_made_with_what_there_is_now_is_read(made_table, second):
    """Control of the next tests. Fields of another scene do not matter."""
    assert tables.load_table(made_table, STUDY | second)["h"] == 0.5


OLDER = {
    "value": {"H": ["1/8", "1/32"]},
    "more": {"H": ["1/8", "1/16"], "h": 1},
    "fewer": {"H": ["1/8"]},
    "none": None,
}


@pytest.mark.parametrize("change", OLDER)
def test_a_table_that_was_made_with_other_parameters_is_refused(made_table, change):
    with sentences.raises(StorageError, str(made_table)):
        tables.load_table(made_table, {"scenes": {"square": OLDER[change]}})


def test_levels_are_put_along_mesh():
    """What has no mesh dimension is kept once."""
    table = tables.join_levels([level(0.5), level(0.25, error=0.125)])
    assert table.sizes == {"case": 1, "mesh": 2, "partition": 2}
    assert table["h"].values.tolist() == [0.5, 0.25]
    assert table["h1_error"].values[0, :, 0].tolist() == [0.25, 0.125]
    assert np.isnan(table["h1_error"].values[0, :, 1]).all()
    assert table["projection_error"].dims == ("case", "partition")
    assert table["H"].values.tolist() == [0.5, 0.25]


def test_what_no_mesh_changes_is_that_of_the_first_level_that_has_it():
    nan = np.nan
    table = tables.join_levels([level(0.5, expected=(nan, nan)), level(0.25, expected=(nan, 2)), level(0.1)])
    assert table["projection_error"].values.tolist() == [[0.5, 2]]
    assert table["h"].values.tolist() == [0.5, 0.25, 0.1]


def test_levels_of_different_cases_are_refused():
    with pytest.raises(ValueError, match="case"):
        tables.join_levels([level(0.5), level(0.25, case="another")])


def written_csv(path, **columns):
    tables.save_csv(pd.DataFrame(columns), path / "table.csv")
    return [line.split(",") for line in (path / "table.csv").read_text().splitlines()]


def test_numbers_are_rounded_to_four_digits(tmp_path):
    rows = written_csv(tmp_path, x=[1.23456789, -0.000123456789, 123456.0, 2.0])
    assert rows == [["x"], ["1.235"], ["-0.0001235"], ["1.235e+05"], ["2"]]


def test_what_is_negligible_in_its_column_is_0(tmp_path):
    """Below 1e-12 of the column's largest value, a sign included; above it is kept."""
    rows = written_csv(tmp_path, x=[1e3, 1.1e-9, 0.9e-9, -0.9e-9], y=[1e-20, 1e-21, 0.0, -0.0])
    assert [row[0] for row in rows[1:]] == ["1000", "1.1e-09", "0", "0"]
    assert [row[1] for row in rows[1:]] == ["1e-20", "1e-21", "0", "0"]


def test_another_machine_s_last_bit_does_not_show(tmp_path):
    value = np.pi
    assert written_csv(tmp_path, x=[value]) == written_csv(tmp_path, x=[np.nextafter(value, 4)])
    assert written_csv(tmp_path, x=[value]) != written_csv(tmp_path, x=[value * 1.001])


def test_nan_is_empty_and_integers_and_strings_are_untouched(tmp_path):
    rows = written_csv(tmp_path, x=[np.nan, 1.5], n=[1234567, 0], name=["thirds", "0.123456"])
    assert rows == [["x", "n", "name"], ["", "1234567", "thirds"], ["1.5", "0", "0.123456"]]


def test_a_column_of_nothing_but_nan_is_empty(tmp_path):
    assert written_csv(tmp_path, x=[np.nan, np.nan], n=[1, 2])[1:] == [["", "1"], ["", "2"]]
