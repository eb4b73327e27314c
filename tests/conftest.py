"""What several test files share: discrete problems, built once."""

import ctypes
import gc
import shutil
import signal
from functools import cache
from pathlib import Path

import chromium
import clarabel
import numpy as np
import pytest
import scipy.sparse as sp
import yaml
from sentences import recorder

from study import tables
from study.ledger import claims
from unilateral.cli import main
from unilateral.discrete.condensed import discretise_case
from unilateral.exchange.score import solve_reference
from unilateral.fem.condense import condense
from unilateral.fem.spaces import mixed_spaces
from unilateral.geometry import partition as partitions
from unilateral.geometry.polygon import find_polygon
from unilateral.geometry.polygon import polygon_names as polygon_names
from unilateral.geometry.structured import make_structured_mesh
from unilateral.norms.exact_errors import CaseProjections, cell_means
from unilateral.norms.ritz import ritz_projection
from unilateral.problems import case as cases
from unilateral.problems import problem_file
from unilateral.problems.case import load_solution as load_case
from unilateral.problems.case_certificate import certify_case

# Tests interrupt themselves and processes that they start, but a shell lets what it runs in the background
# ignore interrupts.
signal.signal(signal.SIGINT, signal.default_int_handler)

ROOT = Path(__file__).parents[1]
DATA = ROOT / "tests/data"
RESULTS = ROOT / "results"
LIBC = ctypes.CDLL(None)
CANTOR = ("cantor_1.5", "cantor_2", "violates_jj_jjj", "violates_jjj")
"""The cases with transitions at a Cantor set; all have the same u."""
NEED_RESULTS = (
    "test_claims.py",
    "test_code_blocks.py",
    "test_documents.py",
    "test_manifest.py",
    "test_report.py",
    "test_surveys.py",
    "test_workflow.py",
)
OTHERS = ("conftest", "study", "unilateral")
"""What a file of tests imports, and did not build for itself."""


def pytest_addoption(parser):
    parser.addoption(
        "--rewrite-sentences",
        action="store_true",
        help="write tests/sentences.yaml anew, for the tests that run",
    )


def pytest_configure(config):
    recorder.rewriting = config.getoption("rewrite_sentences")
    if recorder.rewriting and config.getoption("numprocesses", None):
        raise pytest.UsageError("--rewrite-sentences needs one process: leave out -n")


def pytest_sessionfinish():
    if recorder.rewriting:
        recorder.write()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    report = yield
    item.passed = call.when == "call" and report.passed
    return report


@pytest.fixture(autouse=True)
def sentences_of_a_test(request, tmp_path_factory):
    """A test that passes has said all sentences that are stored for it."""
    recorder.temporary = str(tmp_path_factory.getbasetemp())
    recorder.begin(request.node.nodeid)
    yield
    if request.node.passed and not recorder.rewriting:
        assert recorder.list_unused_sentences() == []


def pytest_collection():
    """While tests are collected nothing becomes garbage, and looking for it takes a third of that time."""
    gc.disable()


def pytest_collection_finish():
    gc.enable()
    gc.freeze()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """What opens pages in a browser is nightly. Without the results that it judges a run ends at once."""
    for test in items:
        if "browser" in test.fixturenames:
            test.add_marker("nightly")
    if any(_needs_results(test.path.name) for test in items) and not any(RESULTS.glob("*/rates.nc")):
        pytest.exit("The tests judge the study's results, and there are none: run 'make' first.", 1)


def _needs_results(name):
    return name.startswith("test_results") or name in NEED_RESULTS


def config(name):
    """A file of the study's configuration."""
    return yaml.safe_load((ROOT / f"workflow/config/{name}.yaml").read_text())


@cache
def read_stored_table(name):
    """A table of the study's results."""
    return tables.load_table(RESULTS / f"{name}.nc")


@cache
def load(name, polygon="square", side=0):
    return load_case(name, find_polygon(polygon), side)


@pytest.fixture
def shared_cases(monkeypatch):
    """Cases of the catalogue are loaded, enclosed and certified once, whoever asks for them."""

    def load_shared_case(case, polygon, side=0):
        catalogue = str(case) in cases.case_names() and polygon.name in polygon_names()
        if catalogue and np.array_equal(polygon.vertices, find_polygon(polygon.name).vertices):
            return load(str(case), polygon.name, side)
        return load_case(case, polygon, side)

    monkeypatch.setattr(cases, "load_solution", load_shared_case)
    monkeypatch.setattr("unilateral.cli.cases.certify_case", certificate)


@pytest.fixture(scope="module")
def own_solutions():
    return {}


@pytest.fixture
def levels_solved_once(monkeypatch, own_solutions):
    """This project's solution of a case on a level is the same for all files that are scored beside it."""

    def solve_once(case, level):
        mesh = level.mesh
        arrays = mesh.polygon.vertices, mesh.points, mesh.triangles, level.partition.points
        key = case.name, case.known_solution().side, case.free_sides, *(array.tobytes() for array in arrays)
        if key not in own_solutions:
            own_solutions[key] = solve_reference(case, level)
        return own_solutions[key]

    monkeypatch.setattr("unilateral.exchange.score.solve_reference", solve_once)


def home(name):
    """The first polygon that a case is for."""
    polygons = cases.read_case_declaration(name)[0]["polygons"]
    return find_polygon("square" if polygons == "any" else polygons[0])


@cache
def certificate(case):
    return certify_case(case)


def load_certificate(name, polygon="square", side=0):
    return certificate(load(name, polygon, side))


@cache
def condense_structured_mesh(polygon, n):
    """A structured mesh with h = 1/n, factorised."""
    return condense(make_structured_mesh(find_polygon(polygon), 1 / n))


@cache
def couple_structured_mesh(polygon, n, m):
    return mixed_spaces(
        condense_structured_mesh(polygon, n), partitions.make_uniform_partition(find_polygon(polygon), 1 / m)
    )


@cache
def discrete(name, n, m, polygon="square", degree=None):
    """The case on its first side, h = 1/n, H = 1/m, and its exact solution."""
    case = load(name, polygon)
    spaces = couple_structured_mesh(polygon, n, m)
    ritz = ritz_projection(case, spaces.condensed, degree)
    return discretise_case(spaces, CaseProjections(ritz, cell_means(case, spaces.partition)))


def exact_errors(discrete, solution):
    """The true errors of a solution of a problem whose exact one is known on its spaces."""
    return discrete.exact.errors(discrete.spaces, solution.result.lambda_H)


def bound_arguments(solved):
    """What `local_bound` and `sharp_bound` take, of a discrete solution."""
    return solved.data, solved.partition, solved.u_h, solved.lambda_H, solved.form


def interior_point(operator, offset):
    """half lambda_H by clarabel, which is u_h - A^{-1} f on the boundary in the norm of A_3.

    From the primal problem, min |y|^2 / 2 subject to half^T y + H_i F(0) >= 0, strictly convex whatever the
    rank of D.
    """
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-13
    nb, m = operator.D_factor.shape
    rows = sp.csc_matrix(-operator.D_factor.T)
    right_side = operator.H_i * offset
    quadratic = sp.identity(nb, format="csc")
    cone = [clarabel.NonnegativeConeT(m)]
    solver = clarabel.DefaultSolver(quadratic, np.zeros(nb), rows, right_side, cone, settings)
    return np.asarray(solver.solve().x)


@pytest.fixture(autouse=True)
def handlers():
    """A test that left another handler of a signal would let a later one, which sends it, end the process."""
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGALRM)
    before = [signal.getsignal(number) for number in numbers]
    yield
    assert [signal.getsignal(number) for number in numbers] == before


@pytest.fixture
def case_like(tmp_path):
    """A case in a file of one's own: as one of the catalogue, with other fields; a field None is left out."""

    def load_changed_case(name, polygon=None, side=0, **changed):
        return cases.load_solution(
            case_file(tmp_path, name, **changed), polygon or find_polygon("square"), side
        )

    return load_changed_case


def case_file(folder, name, **changed):
    fields = cases.read_case_declaration(name)[0] | changed
    file = folder / "mine.yaml"
    file.write_text(yaml.safe_dump({key: value for key, value in fields.items() if value is not None}))
    return file


@pytest.fixture(scope="session")
def browser(tmp_path_factory):
    """Headless Chromium; see chromium.py."""
    if why := chromium.missing():
        pytest.skip(f"Pages cannot be opened in Chromium, {why}")
    with chromium.running(tmp_path_factory.mktemp("chromium")) as started:
        yield started


@pytest.fixture(scope="module", autouse=True)
def forgotten(request):
    """What a file of tests has built for itself is not kept beside what the next ones build."""
    yield
    for function in vars(request.module).values():
        if hasattr(function, "cache_clear") and function.__module__.split(".")[0] not in OTHERS:
            function.cache_clear()
    gc.collect()
    if hasattr(LIBC, "malloc_trim"):  # else glibc keeps what is free between what is not
        LIBC.malloc_trim(0)


@pytest.fixture(scope="module")
def evidence():
    return {}


@pytest.fixture
def measured_once(monkeypatch, evidence):
    """A claim of the ledger measures once, on the same tables, for all tests of a file that ask for this.

    That it looks at no other tables than those that it names is a test of its own.
    """
    original = claims.Claim.measure
    ledger = {id(claim) for claim in claims.load_ledger()}

    def measure(claim, results):
        if id(claim) not in ledger:
            return original(claim, results)
        read = [results[name] for name in claim.reads]
        key = claim.id, *map(id, read)
        if key not in evidence:
            evidence[key] = original(claim, results), read
        return evidence[key][0]

    monkeypatch.setattr(claims.Claim, "measure", measure)


SQUARE = "[[0, 0], [1, 0], [1, 1], [0, 1]]"


@pytest.fixture
def problem_file_of(tmp_path):
    """The name of a problem's file with these fields, on the unit square unless they say otherwise."""

    def written(**fields):
        file = tmp_path / "own.yaml"
        fields_of_file = {"polygon": SQUARE, **fields}
        file.write_text(
            "".join(f"{name}: {text}\n" for name, text in fields_of_file.items() if text is not None)
        )
        return str(file)

    return written


@pytest.fixture
def problem_of(problem_file_of):
    """The problem in such a file."""
    return lambda **fields: problem_file.load_problem(problem_file_of(**fields))


@pytest.fixture
def run(capsys):
    """The exit code of `unilateral` with these arguments, and what it prints on standard output and error."""
    return lambda *arguments: (main([str(argument) for argument in arguments]), *capsys.readouterr())


@pytest.fixture
def refusal(run):
    """What is on standard error when `unilateral` refuses these arguments, with code 2.

    It is a usage error of click, or one line.
    """

    def refusing(*arguments):
        code, out, err = run(*arguments)
        assert (code, out) == (2, "")
        assert "Error: " in err or (err.startswith("unilateral: ") and err.count("\n") == 1)
        return err

    return refusing


def copy_project(folder):
    """The project without results, in a folder of that folder."""
    copied = folder / "project"
    copied.mkdir()
    for name in ("workflow", "src", "benchmarks", "manufactured", "examples", "docs"):
        shutil.copytree(ROOT / name, copied / name, ignore=shutil.ignore_patterns("__pycache__", "runs"))
    for name in ("Snakefile", "README.md", "paper.md", "supplement.md", "paper.bib"):
        shutil.copy(ROOT / name, copied / name)
    (copied / "figures").mkdir()
    return copied
