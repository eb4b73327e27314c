"""Certificates of this project's solutions, checked by the checkers: their bounds are those of the project.

Both are by the same theorem. They differ by the polynomials that take the place of f and g, and by rounding.
"""

import gzip
import importlib.util
import json
import shutil
import subprocess
import sys
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from conftest import ROOT
from known_certificates import checker
from test_exact_mesh import FAR, OTHERS

import unilateral as ul
from unilateral.certificates.statement import has_formulas
from unilateral.geometry.polygon import square
from unilateral.geometry.structured import make_structured_mesh

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
PENTAGON = [(0, 0), (2, 0), (2, 1), (1, 1.5), (-1 / 3, 0.8)]
KITE = [(0, 0), (2, 0), (7 / 3, 1), (1, 1.5)]


def load_checkers():
    """check.py and check_formulas.py as modules; the latter finds the former in its folder."""
    path = ROOT / "certificate/check_formulas.py"
    specification = importlib.util.spec_from_file_location("check_formulas", path)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return importlib.import_module("check"), module


check, check_formulas = load_checkers()


def example(name, **sizes):
    return ul.solve(ul.load(ROOT / f"examples/{name}.yaml"), **sizes)


def pose_on_moved_mesh():
    """Nodes inside are moved at random by at most a quarter of h."""
    mesh = make_structured_mesh(square(), 1 / 8)
    points = mesh.points.copy()
    inside = np.setdiff1d(np.arange(mesh.n_nodes), mesh.boundary)
    points[inside] += np.random.default_rng(3).uniform(-1 / 32, 1 / 32, (len(inside), 2))
    problem = ul.Problem(SQUARE, f="3*x - 2*y - 1", g="x*y/4")
    return ul.solve(problem, mesh=ul.mesh(points, mesh.triangles), H=1 / 4)


def pose_on_shuffled_mesh():
    """The nodes are numbered at random, and sides are slanted."""
    mesh = ul.solve(ul.Problem(KITE, f=-1, g=0), h=0.1, H=0.2, mesh="unstructured").mesh
    number = np.random.default_rng(4).permutation(mesh.n_nodes)
    points = np.empty_like(mesh.points)
    points[number] = mesh.points
    original = ul.mesh(points, number[mesh.triangles])
    return ul.solve(ul.Problem(original.polygon, f="3*x - 5", g="(x - 1)*(2 - x)/8"), mesh=original, H=0.2)


def pose_with_flux():
    """k and c are not 1, and a flux is given on a slanted side."""
    fields = {"free_sides": [1], "q": [None, "x - 2*y", None, None], "k": 2.5, "c": "1/7"}
    return ul.solve(ul.Problem(KITE, f="x**2 - 4", g="(x - 1)*(2 - x)/8", **fields), accuracy=0.05)


def pose_without_reaction():
    """u is given on a slanted side, and k is not 1."""
    fields = {"u": {1: "x*y/5 + 1"}, "k": 3, "c": 0}
    return ul.solve(ul.Problem(KITE, f="x - 30", g="-x/9 - 1/10", **fields), h=1 / 32, H=1 / 16)


def clamped_above_the_obstacle():
    """c = 0, and the given u is above g at both ends of its side."""
    problem = ul.Problem(SQUARE, f="-4*x", g=["x - 1", 0, 0, None], u={3: "y - 1/2"}, c=0)
    return ul.solve(problem, h=1 / 16, H=1 / 8)


def coefficients(k, c, scale, h):
    return ul.solve(ul.Problem(SQUARE, f=f"{scale}*(x - 3*y)", g=0, k=k, c=c), h=h, H=2 * h)


SOLUTIONS = {
    "README": lambda: example("arch", accuracy=0.1),
    "cog": lambda: example("cog", accuracy=0.1),
    "plate": lambda: example("plate", h=1e-3 / 16, H=1e-3 / 8),
    "seal": lambda: example("seal", h=1 / 50, H=1 / 25),
    "shelf": lambda: example("shelf", h=1 / 16, H=1 / 8),
    "shelter": lambda: example("shelter", h=1 / 16, H=1 / 8),
    "step": lambda: example("step", accuracy=0.1),
    "slanted": lambda: ul.solve(ul.Problem(PENTAGON, f="3*x - 4", g="x*y/4"), h=1 / 16, H=1 / 8),
    "clamped": clamped_above_the_obstacle,
    "small k": lambda: coefficients("1/1000", 1, 1, 1 / 32),
    "large k": lambda: coefficients(10**5, 1000, 10**5, 1 / 16),
    "own mesh": pose_on_moved_mesh,
    "mesh without order": pose_on_shuffled_mesh,
    "flux": pose_with_flux,
    "without reaction": pose_without_reaction,
}


def quadratic(kind, ratio, k=1.0):
    """u is quadratic: given on all sides, touching g on all, or half of each; c/k is `ratio`."""
    u, laplacian = ("x*y + x**2", 2) if kind != "contact" else ("2*x**2 + 2*y**2 - 2*x - 2*y + x*y/4", 8)
    problem = {"f": f"{k * ratio!r}*({u}) - {k!r}*{laplacian}", "k": repr(k), "c": repr(k * ratio)}
    if kind == "clamped":
        problem |= {"u": dict.fromkeys(range(4), u)}
    elif kind == "mixed":
        problem |= {"g": [None, u, u, None], "u": {0: u, 3: u}}
    else:
        problem |= {"g": u}
    return ul.solve(ul.Problem(SQUARE, **problem), h=1 / 16, H=1 / 8)


def time_step():
    """f = c u_0; u_0 is below g at x = 1, so that there is a layer in space, too."""
    problem = ul.Problem(
        SQUARE, f="1e8*(x - x**2/2)", g=[None, "3/5", None, None], u={3: 0}, free_sides=[0, 2], c="1e8"
    )
    return ul.solve(problem, h=1 / 16, H=1 / 8)


def slanted_with_layers():
    return ul.solve(ul.Problem(PENTAGON, f="1e6*(3*x - 4)", g="x*y/4", c="1e6"), h=1 / 16, H=1 / 8)


def flux_into_a_layer():
    """f - c u_h is small, and a linear p cannot carry the flux to where it ends, near its side."""
    fields = {"free_sides": [1], "q": [None, "1000*(2 - y)", None, None], "k": 2.5, "c": "1e6"}
    return ul.solve(ul.Problem(KITE, f="1e6*(x - 4)", g="x - 9/2", **fields), h=1 / 16, H=1 / 8)


def pose_with_formula(ratio):
    """u = g = 2 x^2 + 2 y^2 - 2 x - 2 y + sin(x) y/3, so f is no polynomial."""
    u = "2*x**2 + 2*y**2 - 2*x - 2*y + sin(x)*y/3"
    problem = ul.Problem(SQUARE, f=f"{ratio!r}*({u}) - 8 + sin(x)*y/3", g=u, c=repr(ratio))
    return ul.solve(problem, h=1 / 16, H=1 / 8)


EXTREMES = {
    "clamped, 1e-30": lambda: quadratic("clamped", 1e-30),
    "clamped, 1e4": lambda: quadratic("clamped", 1e4, k=1e-8),
    "clamped, 1e16": lambda: quadratic("clamped", 1e16),
    "contact, 1e-2": lambda: quadratic("contact", 1e-2, k=1e5),
    "contact, 1e6": lambda: quadratic("contact", 1e6),
    "contact, 1e12": lambda: quadratic("contact", 1e12, k=1e-3),
    "mixed, 1e-30": lambda: quadratic("mixed", 1e-30, k=8.0),
    "mixed, 1e2": lambda: quadratic("mixed", 1e2),
    "mixed, 1e8": lambda: quadratic("mixed", 1e8, k=1e8),
    "time step": time_step,
    "slanted": slanted_with_layers,
    "flux": flux_into_a_layer,
    "formula, 1e-2": lambda: pose_with_formula(1e-2),
    "formula, 1e8": lambda: pose_with_formula(1e8),
}
"""Problems with c/k from 1e-30 to 1e16, and their solutions."""
REST_OF_FORMULA = {
    name: 2 * (1 / 16) ** 3 / 100 * (c + 1) / c**0.5
    for name, c in [("formula, 1e-2", 1e-2), ("formula, 1e8", 1e8)]
}
"""What a quadratic function in place of f adds to S: to M, and once more as its norm, times c^(-1/2).

The third derivatives of f are at most (c + 1)/3. So Taylor's coefficients f_30 and f_21 along the legs of
triangles are at most h^3 (c + 1) times 1/18 and 1/6. The root mean squares of u^3 and u^2 v are below 0.04.
"""
POLYGONS = FAR | OTHERS
CELLS_CUT_EDGES = {"slanted", "mesh without order"}
"""The multiplier's cells are no whole edges there, so that p.n, which is judged, is not lambda_H."""
PROVED = ["README", "cog", "seal", "shelf", "step", "slanted", "clamped", "large k", "own mesh"]
"""f and g are such that the checker's bounds are the project's, so that it proves the project's numbers."""


class Checked(NamedTuple):
    """A solution, its certificate, and the bounds that the check has proved."""

    solution: ul.Solution
    stated: dict
    u: Fraction
    multiplier: Fraction


@pytest.fixture(scope="module")
def check_certificate(tmp_path_factory):
    folder = tmp_path_factory.mktemp("certificates")

    @cache
    def check_certificate(name):
        solution = (SOLUTIONS | EXTREMES)[name]()
        path = folder / f"{name}.json.gz"
        solution.save_certificate(path)
        stated = json.loads(gzip.decompress(path.read_bytes()))
        return Checked(solution, stated, *bounds_of(stated))

    return check_certificate


def bounds_of(stated):
    """The bounds that check.py proves or, if there are formulas, check_formulas.py."""
    function = check_formulas.Formula if has_formulas(stated["problem"]) else check.Polynomial
    return check.Certificate(stated, function).bounds()


@pytest.mark.parametrize("name", SOLUTIONS)
def test_the_bounds_are_those_of_the_project(name, check_certificate):
    """At most 3 % apart, for these problems have little oscillation."""
    proved = check_certificate(name)
    bounds = check_certificate(name).solution.bounds
    assert float(proved.u) == pytest.approx(bounds.u, rel=0.03)
    assert proved.multiplier <= 1.03 * bounds.multiplier
    assert proved.multiplier >= 0.97 * bounds.multiplier or name in CELLS_CUT_EDGES


def test_a_problem_without_contact_has_a_certificate(tmp_path):
    """All sides are clamped; there is no multiplier to compare."""
    problem = ul.Problem(SQUARE, f="x", u=dict.fromkeys(range(4), "x*y"))
    solution = ul.solve(problem, h=1 / 8, H=1 / 4)
    path = tmp_path / "linear.json"
    solution.save_certificate(path)
    u, _ = bounds_of(json.loads(path.read_text(encoding="utf-8")))
    assert float(u) == pytest.approx(solution.bounds.u, rel=0.03)


@pytest.mark.parametrize("name", PROVED)
def test_the_check_proves_the_numbers_of_the_project(name, check_certificate):
    """Up to 1e-4 of them, which leaves room for other polynomials in the place of f and g."""
    proved = check_certificate(name)
    bounds = check_certificate(name).solution.bounds
    assert proved.u <= 1.0001 * bounds.u
    assert proved.multiplier <= 1.0001 * bounds.multiplier


@pytest.mark.parametrize("name", EXTREMES)
def test_the_check_proves_the_numbers_for_all_ratios_of_c_and_k(name, check_certificate):
    """The multiplier of layers is bounded by less than what the project says."""
    proved = check_certificate(name)
    bounds = check_certificate(name).solution.bounds
    extra = REST_OF_FORMULA.get(name, 0)
    assert 0.97 * bounds.u <= proved.u <= 1.0001 * bounds.u + extra
    if not name.startswith("clamped"):
        assert proved.multiplier <= 1.0001 * bounds.multiplier + extra


@pytest.mark.parametrize(
    ("name", "text", "replacement"),
    [
        ("flux", "is_linear and ratio * d2 > 1", "False"),
        ("mixed, 1e-30", "C = min(constants)", "C = constants[0]"),
        ("mixed, 1e-30", "min(pair) if c else", "pair[1] if c else"),
    ],
    ids=["by parts", "C from the field", "S with C"],
)
def test_the_check_needs_each_of_its_bounds(name, text, replacement, check_certificate):
    """Control: a layer needs the bound by parts, and a tiny c the constant of the field."""
    u, _ = checker((text, replacement)).Certificate(check_certificate(name).stated).bounds()
    assert u > 2 * check_certificate(name).solution.bounds.u


@pytest.mark.parametrize("name", POLYGONS)
def test_the_check_proves_the_numbers_where_nodes_are_rounded(name, tmp_path):
    """u = x is linear: the bounds are what rounding may do, and the field for c = 0 has little room."""
    mesh = POLYGONS[name]()
    path = tmp_path / "linear.json"
    problem = ul.Problem(mesh.polygon, f=0, u=dict.fromkeys(range(mesh.polygon.n_sides), "x"), c=0)
    solution = ul.solve(problem, mesh=mesh, H=float(mesh.polygon.lengths.max()))
    solution.save_certificate(path)
    u, _ = bounds_of(json.loads(path.read_text(encoding="utf-8")))
    assert 0 < u <= solution.bounds.u


def test_another_flux_has_another_bound(check_certificate):
    """Control: 3 % are few."""
    stated = check_certificate("own mesh").stated | {
        "flux": [0.9 * z for z in check_certificate("own mesh").stated["flux"]]
    }
    assert bounds_of(stated)[0] > 1.03 * check_certificate("own mesh").solution.bounds.u


def interpreters():
    """This Python and others, installed beside it or on the path: one of each version from 3.9 on."""
    places = [sys.executable, *Path(sys.base_prefix).parent.glob("*/bin/python3")]
    places += filter(None, (shutil.which(f"python3.{minor}") for minor in range(9, 20)))
    versions = {}
    for place in places:
        answer = subprocess.run(
            [place, "-I", "-S", "-c", "import sys; print(sys.version_info[1])"],
            capture_output=True,
            text=True,
            check=False,
        )
        if answer.returncode == 0 and answer.stdout.strip().isdecimal() and int(answer.stdout) >= 9:
            versions.setdefault(int(answer.stdout), place)
    return versions


@pytest.mark.parametrize(("name", "program"), [("shelf", "check.py"), ("shelter", "check_formulas.py")])
def test_a_python_that_has_nothing_installed_proves_the_same(name, program, tmp_path):
    """-I -S leaves out all packages. The output is the same, because the arithmetic is exact."""
    path = tmp_path / "certificate.json"
    example(name, h=1 / 4, H=1 / 2).save_certificate(path)
    u, multiplier = bounds_of(json.loads(path.read_text(encoding="utf-8")))
    command = ["-I", "-S", ROOT / "certificate" / program, path]
    for version, python in interpreters().items():
        answer = subprocess.run([python, *command], cwd=tmp_path, capture_output=True, text=True, check=False)
        assert (answer.returncode, answer.stderr) == (0, ""), version
        last = answer.stdout.splitlines()[-1]
        assert last == (
            f"PROVED: |||u - v||| <= {check.upward(u)}, "
            f"the dual norm of k du/dn - p.n is <= {check.upward(multiplier)}"
        )
