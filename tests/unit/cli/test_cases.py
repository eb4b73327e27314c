"""`unilateral cases`: the list for programs, and one case with its formulas, as text and as modules."""

import json
import re
import sys
import types

import numpy as np
import pytest
from conftest import CANTOR, ROOT, home, load

from unilateral.exchange.case_formulas import render_case_module
from unilateral.geometry.mesh import make_unstructured_mesh
from unilateral.problems import case as cases

pytestmark = pytest.mark.usefixtures("shared_cases")
CLOSED = [name for name in cases.case_names() if name not in CANTOR]
SHELTER = str(ROOT / "examples/shelter.yaml")


def load_at_home(name):
    return load(name, home(name).name)


def test_cases_lists_the_catalogue_with_its_certificates(run):
    code, out, err = run("cases")
    assert (code, err) == (0, "")
    for name in cases.case_names():
        declaration = cases.read_case_declaration(name)[0]
        rows = [line.split() for line in out.splitlines() if line.startswith(f"{name} ")]
        subset = (
            ["square", "lshape", "hexagon"] if declaration["polygons"] == "any" else declaration["polygons"]
        )
        assert [row[-1] for row in rows] == subset
        hypotheses = ["yes" if value else "no" for value in declaration["hypotheses"].values()]
        assert all(row[1:4] == hypotheses for row in rows)
        assert declaration["title"] in out
    assert re.search(r"natural .* 0: 0\.5-1; sides 1, 2, 3 +square", out)


def test_json_has_every_case_on_every_polygon(run):
    """natural: contact on half of side 0 and on the others; lambda of singular is not bounded."""
    code, out, err = run("cases", "--json")
    assert (code, err, out.count("\n")) == (0, "", 1)
    case_records = {case["name"]: case for case in json.loads(out)["cases"]}
    assert list(case_records) == cases.case_names()
    (natural,) = case_records["natural"]["polygons"]
    assert natural["hypotheses"] == {"j": True, "jj": True, "jjj": True}
    assert natural["g_regular"] is True
    assert natural["contact"][0] == {"side": 0, "start": 0.5, "end": 1.0}
    assert [polygon["polygon"] for polygon in case_records["thirds"]["polygons"]] == [
        "square",
        "lshape",
        "hexagon",
    ]
    assert case_records["singular"]["polygons"][0]["lambda_max"] is None


def test_the_text_of_a_case_has_its_formulas_and_proved_rates(run):
    """By hand from manufactured/natural.yaml: f = u - 16, for -lap 4 |z|^2 = -16 and the rest is harmonic."""
    code, out, err = run("cases", "natural")
    assert (code, err) == (0, "")
    u, f = [line.split(" = ")[1] for line in out.splitlines() if line.startswith(("  u = ", "  f = "))]
    assert f == f"{u} - 16"
    assert "  side 0, (0, 0) to (1, 0), contact 0.5 to 1\n    g = u - (2*pos(1/2 - x, 3/2)*x)\n" in out
    assert "(jjj) holds" in out
    assert "u - g in H^(3/2) on every side: yes\n" in out
    assert "  u is like r^(3/2) at (0.5, 0)" in out
    assert "proved rates: 1 of u in H1 by (4.11), 1 of lambda in H^(-1/2) by (4.12), 0.5 of" in out
    out = run("cases", "singular")[1]
    assert "(j) does not hold" in out
    assert "u - g in H^(3/2) on every side: no\n" in out
    assert "regularity: not u in H2, not u Lipschitz on the sides, lambda in L2, not lambda bounded" in out
    assert "proved rates: none" in out
    elsewhere = cases.read_case_declaration("singular")[0]["gap"]["elsewhere"]
    assert f"contact none\n    g = u - ({elsewhere})\n    lambda = 0\n" in out


def test_the_json_of_a_case_has_its_polygons_rates_and_powers(run):
    document = json.loads(run("cases", "thirds", "--json")[1])
    assert [polygon["polygon"] for polygon in document["polygons"]] == ["square", "lshape", "hexagon"]
    assert document["proved_rates"] == {"h1": 1.0, "hm12": 1.0, "l2": 0.5}
    assert document["polygons"][0]["powers"] == [{"x": pytest.approx(1 / 3), "y": 0.0, "exponent": "3/2"}]
    assert [len(polygon["lambda"]) for polygon in document["polygons"]] == [4, 6, 6]
    assert json.loads(run("cases", "thirds", "--format", "json")[1]) == document


def test_a_case_is_shown_and_solved_on_a_polygon_of_one_s_own(run):
    """On side 1 of shelter.yaml, of length 1 from (2, 0): contact from 1/3 to 7/12 of it."""
    code, out, err = run("cases", "thirds", "--polygon", SHELTER, "--side", "1")
    assert (code, err) == (0, "")
    assert "  side 1, (2, 0) to (2, 1), contact 0.333333 to 0.583333\n" in out
    assert "  u is like r^(3/2) at (2, 0.333333)" in out
    sizes = ["--h", "1/16", "--H", "1/8"]
    _, out, _ = run("solve", "thirds", "--polygon", SHELTER, "--side", "1", *sizes, "--json")
    document = json.loads(out)
    assert 0 < document["h1_error"] <= document["h1_bound"]


NUMPY_AS_UFL = {"as_ufl": lambda a: a, "as_vector": lambda a: a, "atan2": np.arctan2, "ln": np.log}
NUMPY_AS_UFL |= {"conditional": np.where, "gt": np.greater, "lt": np.less, "pi": np.pi}
NUMPY_AS_UFL |= {name: getattr(np, name) for name in ["cos", "cosh", "exp", "sin", "sinh", "sqrt", "tanh"]}


def stub_ufl(monkeypatch, **names):
    stub = types.ModuleType("ufl")
    stub.__dict__.update(names)
    monkeypatch.setitem(sys.modules, "ufl", stub)


def functions(kind, case):
    """u, f, grad_u, g and lambda_ of the module, all as functions of points (k, 2), the last two by side."""
    space = {}
    exec(render_case_module(case, kind), space)

    def call_functions(name, *side):
        return lambda points: space[name](*side, *((points.T,) if kind == "ufl" else points.T))

    sides = range(case.polygon.n_sides)
    return {name: call_functions(name) for name in ("u", "f", "grad_u")} | {
        name: [call_functions(name, side) for side in sides] for name in ("g", "lambda_")
    }


@pytest.mark.parametrize("kind", ["python", "ufl"])
@pytest.mark.parametrize("name", CLOSED)
def test_the_modules_are_the_case(monkeypatch, name, kind):
    """By the case's own evaluation from atoms; UFL's operators by those of numpy that they are named after.

    A sign, a branch of the angle or a coordinate that is another one would show by far more than rounding.
    """
    stub_ufl(monkeypatch, **NUMPY_AS_UFL)
    case = load_at_home(name)
    module_functions = functions(kind, load_at_home(name))
    mesh = make_unstructured_mesh(case.polygon, 1 / 5)
    inside = mesh.points[mesh.triangles].mean(axis=1)
    u, gradient = case.value_and_gradient(inside)
    f = case.source(inside)
    size = np.abs(gradient).max()
    np.testing.assert_allclose(module_functions["u"](inside), u, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(module_functions["f"](inside), f, rtol=1e-12, atol=1e-12 * np.abs(f).max())
    np.testing.assert_allclose(
        np.transpose(module_functions["grad_u"](inside)), gradient, rtol=0, atol=1e-12 * size
    )
    for i, length in enumerate(case.polygon.lengths):
        side = np.full(20, i)
        s = (np.arange(20) + 0.43) / 20 * length
        (u, flux, gap) = case.trace_flux_and_gap(side, s)
        points = case.polygon.at(side, s)
        np.testing.assert_allclose(module_functions["g"][i](points), u - gap, rtol=0, atol=1e-12)
        np.testing.assert_allclose(module_functions["lambda_"][i](points), flux, rtol=1e-9, atol=1e-12)


def test_older_versions_of_ufl_have_atan_2(monkeypatch):
    """Such as 2022.2 of Debian 12."""
    names = {name: ufl_name for name, ufl_name in NUMPY_AS_UFL.items() if name != "atan2"}
    stub_ufl(monkeypatch, **names, atan_2=np.arctan2)
    point = np.array([[0.25, 0.5]])
    u = load("natural").value_and_gradient(point)[0]
    assert functions("ufl", load("natural"))["u"](point) == pytest.approx(u, rel=1e-12)


def test_python_that_is_printed_runs_as_it_is(run):
    """Constants, too, have the shape of the points: g - u of no_contact is -1 everywhere."""
    space = {}
    exec(run("cases", "no_contact", "--format", "python")[1], space)
    x = np.array([[0.0, 0.25], [0.5, 1.0]])
    y = np.zeros((2, 2))
    np.testing.assert_allclose(space["g"](0, x, y) - space["u"](x, y), -np.ones((2, 2)), rtol=1e-15)
    assert space["vertices"] == [[0, 0], [1, 0], [1, 1], [0, 1]]


def test_what_has_no_formulas_says_so(run):
    """A Cantor family; what is known without formulas is shown."""
    code, out, err = run("cases", "violates_jjj")
    assert (code, err) == (0, "")
    assert (
        out.count("there are no closed formulas, because u is a sum over the intervals of a Cantor set") == 3
    )
    assert "contact on 85 intervals" in out  # 1 + 4 + 16 + 64 of four odd generations
