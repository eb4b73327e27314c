"""Copies, pickles and files of solutions: all numbers are the same, and no bound is believed."""

import copy
import hashlib
import json
import pickle
import re
import warnings
from functools import cache

import meshio
import netCDF4
import numpy as np
import pytest
import xarray as xr
from conftest import ROOT

import unilateral as ul
from unilateral.discrete.base import DiscreteSolution
from unilateral.solution import stored
from unilateral.solvers.stop import Stop

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
SIZES = {"h": 1 / 16, "H": 1 / 8}
ARRAYS = ("u", "multiplier", "gap")
OF_MESH = ("points", "triangles", "boundary", "s", "opposite_edges")


def source(x, y):
    return np.cos(5 * x) - 2


def obstacle(x, y):
    return -x * y / 2


PROBLEMS = {
    "case": lambda: ul.solve("natural", **SIZES),
    "case on another polygon": lambda: ul.solve(ul.case("thirds", "lshape", 1), h=1 / 8, H=1 / 4),
    "multigrid": lambda: ul.solve("natural", h=1 / 160, H=1 / 80),
    "gmsh": lambda: ul.solve(ul.load(ROOT / "examples/shelter.yaml"), h=1 / 7, H=1 / 3),
    "accuracy": lambda: ul.solve(ul.load(ROOT / "examples/cog.yaml"), accuracy=0.1),
    "sharp accuracy": lambda: ul.solve(ul.load(ROOT / "examples/step.yaml"), accuracy=0.3, norm="hm12"),
    "units": lambda: ul.solve(ul.load(ROOT / "examples/plate.yaml"), h=5e-5, H=1e-4),
    "accuracy in units": lambda: ul.solve(ul.load(ROOT / "examples/plate.yaml"), accuracy=0.1),
    "flux": lambda: ul.solve(
        ul.Problem(SQUARE, f="1/3", g=["-x", -1, None, 0], free_sides=[2], q="x", k="1/3", name="a/b 1.5"),
        **SIZES,
    ),
    "idle sides": lambda: ul.solve(
        ul.Problem(SQUARE, f=1, g=["-3*x", -3, None, "2*y"], free_sides=[2], q="1 + x").without_idle_sides(),
        **SIZES,
    ),
    "functions": lambda: ul.solve(
        ul.Problem(SQUARE, f=source, g=[obstacle, "-y/2", "-x/2", 0], k=2), **SIZES
    ),
    "arrays": lambda: _of_arrays(k=1),
    "arrays in units": lambda: _of_arrays(k="1/3"),
    "functions and arrays": lambda: _of_arrays(k=1, g=obstacle),
    "solver": lambda: ul.Solver("natural", **SIZES)(f="x - 2", g="-x*y/3"),
    "not unique": lambda: _quiet("natural", h=1 / 4, H=1 / 8),
    "not converged": lambda: _quiet("natural", **SIZES, stop=Stop(algorithm="uzawa", max_steps=3)),
    "missed": lambda: _quiet("natural", accuracy=1e-3, max_unknowns=100),
}


def _of_arrays(k, g=None):
    """f, g on two sides and q on another as arrays at the nodes of a mesh that was halved."""
    mesh = ul.mesh([(0, 0), (1, 0), (1, 1), (0, 1), (0.4, 0.6)], [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)])
    mesh = ul.mesh(mesh, halvings=3)
    x, y = mesh.points.T
    on_sides = [g or -x * y, g or -x * y / 2 - y / 2, None, 0]
    problem = ul.Problem(mesh, f=x - 2, g=on_sides, free_sides=[2], q=[None, None, x - 1, None], k=k)
    return ul.solve(problem, H=1 / 4)


def _quiet(*arguments, **named):
    with warnings.catch_warnings(action="ignore", category=ul.SolutionWarning):
        return ul.solve(*arguments, **named)


@cache
def solved(name):
    """Each of the problems, solved once."""
    return PROBLEMS[name]()


OF_SIZE = "certified", "ended", "hm12_relative_bound"
"""Fields of a certificate that rest on the norm of lambda, which no file keeps."""


def assert_same(one, other, rtol=0.0, without=()):
    """All that users see, but for some fields `without` which a certificate is; bounds only up to `rtol`."""
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for name in OF_MESH:
        np.testing.assert_array_equal(getattr(one.mesh, name), getattr(other.mesh, name))
    assert one.mesh.adapted == one.solved.discrete.mesh.adapted == other.mesh.adapted
    np.testing.assert_array_equal(one.partition.points, other.partition.points)
    assert one.contact.intervals == other.contact.intervals
    flags = {"certified", "unique", "converged", "iterations"} - {*without}
    assert repr([getattr(one, name) for name in flags]) == repr([getattr(other, name) for name in flags])
    points = np.random.default_rng(1).uniform(*np.array(one.polygon.vertices)[[0, 2]], (20, 2))
    for at in ("u_at", "grad_at"):
        np.testing.assert_array_equal(getattr(one, at)(points), getattr(other, at)(points))
    assert repr(one.problem) == repr(other.problem)
    known, found = one.certificate(), other.certificate()
    assert known.keys() == found.keys()
    for name, value in known.items():
        if name in without:
            continue
        if rtol and "bound" in name and isinstance(value, float):
            assert found[name] == pytest.approx(value, rel=rtol)
        elif name not in ("enclosure", "levels") or not rtol:
            assert repr(found[name]) == repr(value), name
    np.testing.assert_allclose(other.forces().whole, one.forces().whole, rtol=rtol)


@pytest.mark.parametrize("name", PROBLEMS)
def test_copies_and_pickles_are_the_same(name):
    """Bounds included; a copy of a copy, too."""
    s = solved(name)
    once = pickle.loads(pickle.dumps(s))
    for other in (copy.copy(s), copy.deepcopy(s), once, pickle.loads(pickle.dumps(once))):
        assert_same(s, other)


@pytest.mark.parametrize("name", PROBLEMS)
def test_an_opened_file_is_the_same(name, tmp_path):
    """For given sizes bit for bit; after an accuracy f is enclosed in another order, which is rounding."""
    s, file = solved(name), tmp_path / "s.nc"
    s.save(file)
    again = ul.open(file)
    rtol = 1e-8 if s.search else 0.0
    assert_same(s, again, rtol, OF_SIZE if name == "sharp accuracy" else OF_SIZE[2:])
    assert (s.bounds is None) == (again.bounds is None)
    if s.errors and s.unique:
        assert again.errors == s.errors
    again.save(tmp_path / "again.nc")
    assert_same(again, ul.open(tmp_path / "again.nc"))


def test_what_is_opened_can_be_saved_drawn_and_solved_again(tmp_path):
    s, file = solved("accuracy"), tmp_path / "s.nc"
    s.save(file)
    again = ul.open(str(file))
    for ending in ("vtu", "csv", "svg"):
        for name, of in (("one", s), ("other", again)):
            of.save(tmp_path / f"{name}.{ending}")
    for ending in ("csv", "svg"):
        assert (tmp_path / f"one.{ending}").read_bytes() == (tmp_path / f"other.{ending}").read_bytes()
    one, other = (meshio.read(tmp_path / f"{name}.vtu") for name in ("one", "other"))
    shares = [of.cell_data.pop("error_share")[0] for of in (one, other)]
    np.testing.assert_allclose(*shares, rtol=0, atol=1e-9 * shares[0].max())  # of bounds computed again
    for name in ("points", "cells_dict", "point_data", "cell_data"):
        np.testing.assert_equal(getattr(one, name), getattr(other, name))
    np.testing.assert_array_equal(ul.solve(again.problem, **SIZES).u, ul.solve(s.problem, **SIZES).u)
    with pytest.raises(ul.InputError, match="is not iterated on; solve its problem again"):
        again.solved.discrete.solved(Stop())


@pytest.mark.parametrize("name", ["arrays", "arrays in units"])
def test_an_opened_problem_of_arrays_is_solved_on_its_mesh(name, tmp_path):
    """In units the mesh is scaled to and fro, which is rounding."""
    s = solved(name)
    s.save(tmp_path / "s.nc")
    again = ul.solve(ul.open(tmp_path / "s.nc").problem, H=1 / 4)
    np.testing.assert_allclose(again.u, s.u, rtol=0, atol=1e-10 if "units" in name else 0.0)


def test_bounds_that_are_withdrawn_stay_so(tmp_path, monkeypatch):
    """Of a solution none of whose levels is believed."""
    monkeypatch.setattr("unilateral.accuracy.search.standing", lambda done: [])
    s = _quiet("natural", accuracy=0.3)
    monkeypatch.undo()
    s.save(tmp_path / "s.nc")
    for other in (ul.open(tmp_path / "s.nc"), copy.deepcopy(s)):
        assert other.bounds is None
        assert not other.certified


def signed(file, record):
    """The file with another record and the SHA-256 that belongs to it."""
    with xr.load_dataset(file, group=stored.GROUP, decode_cf=False) as group:
        arrays = {str(name): of.to_numpy() for name, of in group.variables.items()}
    with xr.load_dataset(file, decode_cf=False) as root:
        arrays = {name: root[name].to_numpy() for name in stored.FACE} | arrays
    text = json.dumps(record)
    with netCDF4.Dataset(file, "a") as table:
        table[stored.GROUP].record = text
        table[stored.GROUP].sha256 = stored._digest(text, arrays)


def record_of(file):
    with netCDF4.Dataset(file) as table:
        return json.loads(table[stored.GROUP].record)


def changed(file, name, at, value):
    """The file with another number, and the SHA-256 that belongs to it."""
    with netCDF4.Dataset(file, "a") as table:
        table[name][at] = value
    signed(file, record_of(file))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("x", 7.0, "s.nc: triangle .* is degenerate; it needs an area"),
        ("y", np.nan, "s.nc: the variable y is nan at 40; it has to be finite"),
        ("u", np.inf, "s.nc: the variable u is inf at 40; it has to be finite"),
        ("multiplier", np.nan, "s.nc: the variable multiplier is nan at"),
    ],
)
def test_numbers_that_are_no_solution_are_refused(name, value, message, tmp_path):
    """An inner node that is moved turns triangles over. Control: the file is opened before."""
    s, file = solved("case"), tmp_path / "s.nc"
    s.save(file)
    signed(file, record_of(file))
    assert ul.open(file).bounds.u == s.bounds.u
    assert 40 not in s.mesh.boundary
    changed(file, name, 40 if name != "multiplier" else 3, value)
    with pytest.raises(ul.InputError, match=message):
        ul.open(file)


def test_a_bound_does_not_rest_on_what_the_file_says(tmp_path):
    """Who changes u and signs it gets the bound of what is there, which is far above; no bound is read."""
    s, file = solved("case"), tmp_path / "s.nc"
    s.save(file)
    with netCDF4.Dataset(file, "a") as table:
        table["u"][:] = table["u"][:] + np.where(np.arange(len(s.u)) % 2, 0.1, -0.1)
        table.h1_bound = 1e-9
    signed(file, record_of(file))
    again = ul.open(file)
    assert again.errors.h1 > 5 * s.errors.h1
    assert again.bounds.u >= again.errors.h1


@pytest.mark.parametrize("name", ["accuracy", "sharp accuracy"])
@pytest.mark.parametrize("absolute", [True, False])
def test_what_is_certified_does_not_rest_on_what_the_file_says(name, absolute, tmp_path):
    """Even if it says that lambda is large, that nothing is left to iterate, and that 1e-9 was wanted."""
    s, file = solved(name), tmp_path / "s.nc"
    s.save(file)
    record = record_of(file)
    goal = record["search"]["goal"] | {"accuracy": 1e-9, "absolute": absolute}
    facts = record["facts"] | {"lambda_norm": 1e15, "beta": 1e9}
    result = record["result"] | {"bound": 0.0, "converged": True}
    search = record["search"] | {"goal": goal, "ended": ""}
    signed(file, record | {"facts": facts, "result": result, "search": search, "believed": True})
    again = ul.open(file)
    assert not again.certified
    assert not again.certificate()["certified"]
    assert np.isnan(again.bounds.relative_multiplier)
    assert "guaranteed" in repr(again)
    assert "%" not in repr(again).partition("error of lambda")[2].partition("\n")[0]


def test_an_accuracy_that_was_reached_is_still_certified_where_it_can_be_computed(tmp_path):
    """The control: that of u, whose norm is computed from the numbers in the file."""
    for name, certified in (("accuracy", True), ("sharp accuracy", False)):
        assert solved(name).certified
        solved(name).save(tmp_path / "s.nc")
        assert ul.open(tmp_path / "s.nc").certified == certified


@pytest.mark.parametrize("where", ["u", "x", "triangles", "multiplier", "solved/g_means", "solved/record"])
def test_a_file_that_was_changed_is_refused(where, tmp_path):
    s, file = solved("case"), tmp_path / "s.nc"
    s.save(file)
    with netCDF4.Dataset(file, "a") as table:
        if where.endswith("record"):
            table["solved"].record = table["solved"].record.replace("true", "false", 1)
        else:
            table[where][:] = np.roll(table[where][:], 1, axis=0)
    with pytest.raises(ul.InputError, match=r"s\.nc is damaged or was changed, for it has another SHA-256"):
        ul.open(file)


def test_no_flipped_bit_changes_a_number(tmp_path):
    """Each of 40 flipped bits, at random, is noticed or has no effect; control: most are noticed."""
    s, file, rng = solved("multigrid"), tmp_path / "s.nc", np.random.default_rng(7)
    s.save(file)
    whole, refused = file.read_bytes(), 0
    for at, bit in rng.integers((len(whole), 8), size=(40, 2)).tolist():
        spoilt = bytearray(whole)
        spoilt[at] ^= 1 << bit
        file.write_bytes(spoilt)
        try:
            again = ul.open(file)
        except ul.InputError:
            refused += 1
        else:
            for name in ARRAYS:
                np.testing.assert_array_equal(getattr(again, name), getattr(s, name))
            assert again.solved.facts._replace(lambda_norm=0) == s.solved.facts._replace(lambda_norm=0)
    assert refused > 30


def test_what_holds_no_solution_is_refused(tmp_path):
    foreign = {name: tmp_path / name for name in ("empty.nc", "text.nc", "cut.nc", "foreign.nc")}
    foreign["empty.nc"].touch()
    foreign["text.nc"].write_text("CDF and no more")
    solved("case").save(foreign["cut.nc"])
    foreign["cut.nc"].write_bytes(foreign["cut.nc"].read_bytes()[:3000])
    xr.Dataset({"u": ("node", np.zeros(3))}).to_netcdf(foreign["foreign.nc"])
    for name, file in foreign.items():
        with pytest.raises(ul.InputError, match=rf"{re.escape(name)} holds no solution; a file that s\.save"):
            ul.open(file)
    for name, said in (("nothing.nc", "there is no file .*nothing.nc"), ("", "there is no file")):
        with pytest.raises(ul.InputError, match=said):
            ul.open(tmp_path / name)
    for given in (3, None, b"s.nc", ["s.nc"], ""):
        with pytest.raises(ul.InputError, match=r"is no name; give a text such as 'solution\.nc', or a Path"):
            ul.open(given)


def test_a_file_of_another_format_or_way_to_refine_is_refused(tmp_path):
    file = tmp_path / "s.nc"
    solved("case").save(file)
    record = record_of(file)
    signed(file, record | {"format": 3, "version": "9.9"})
    with pytest.raises(
        ul.InputError, match=r"is of format 3, by unilateral 9\.9; this version reads format 2"
    ):
        ul.open(file)
    with netCDF4.Dataset(file, "a") as table:
        halved = table["solved/halved"]
        halved[:] = halved[:][:, ::-1]
    signed(file, record)
    with pytest.raises(ul.InputError, match="refined meshes in another way than this version; open it there"):
        ul.open(file)


def test_the_digest_is_that_of_every_byte():
    """By hand, from the text, names, types, shapes and bytes."""
    text, arrays = "{}", {"b": np.arange(2.0), "a": np.ones((1, 2), dtype=np.int32)}
    parts = [text.encode(), b"a <i4 (1, 2) ", arrays["a"].tobytes(), b"b <f8 (2,) ", arrays["b"].tobytes()]
    assert stored._digest(text, arrays) == hashlib.sha256(b"".join(parts)).hexdigest()


def test_a_pickle_leaves_out_what_is_quickly_made_again():
    """It has less than 100 bytes for each unknown, of which edges alone have 20."""
    s = solved("multigrid")
    assert s.solved.discrete.mesh.opposite_edges.nbytes > 20 * s.mesh.n_nodes
    assert len(pickle.dumps(s)) < 100 * s.mesh.n_nodes
    assert isinstance(s.solved, DiscreteSolution)
    assert type(s.solved.discrete).__name__ == "MultilevelProblem"


def test_a_problem_with_a_clamped_side_is_read_again(tmp_path):
    """With its form: bounds, forces and reactions are the same numbers."""
    problem = ul.Problem(
        [(0, 0), (1, 0), (1, 1), (0, 1)], -1, [None, -1, None, None], [0, 2], c=0, u={3: "y*(1 - y)"}
    )
    s = ul.solve(problem, h=1 / 8, H=1 / 4)
    s.save(tmp_path / "s.nc")
    again = ul.open(tmp_path / "s.nc")
    assert again.bounds[:4] == s.bounds[:4]
    assert again.forces() == s.forces()
    assert again.problem.clamped_sides == (3,)
