"""The catalogue fits the project; and what `make mutants` says and leaves, on a project of one function."""

import pytest
import yaml

from tests.mutants.__main__ import CATALOGUE, ROOT, main, read, stale

FUNCTION = "def bound(x):\n    return 2 * abs(x)  # of |x| + |x|\n"
TEST = "from small import bound\n\n\ndef test_bound():\n    assert bound(-1) {} 2\n"
MUTANT = {
    "name": "half",
    "file": "src/small.py",
    "text": "return 2 * abs",
    "instead": "return abs",
    "why": "The sum has two terms.",
    "tests": ["test_small.py::test_bound"],
}


@pytest.fixture
def try_mutants(tmp_path, capsys, monkeypatch):
    """The exit code and what is said, for such mutants and a test with that comparison."""
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # pytest starts in less than half of the time
    (tmp_path / "src").mkdir()

    def run(*mutants, comparison=">=", only=()):
        (tmp_path / "src/small.py").write_text(FUNCTION)
        (tmp_path / "test_small.py").write_text(TEST.format(comparison))
        (tmp_path / "catalogue.yaml").write_text(yaml.safe_dump([MUTANT | mutant for mutant in mutants]))
        before = files(tmp_path)
        code = main([*only, "--jobs", "1"], tmp_path / "catalogue.yaml", tmp_path)
        assert files(tmp_path) == before
        return code, capsys.readouterr().out

    return run


def files(folder):
    """All of them but compiled ones, with their contents."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file() and path.suffix != ".pyc"}


def test_the_catalogue_fits_the_project():
    assert stale(read(CATALOGUE), ROOT) == []


def test_a_mutant_that_no_test_sees_is_told(try_mutants):
    """Twice as large a bound is seen by no test; the one that is too small is."""
    code, output = try_mutants({}, {"name": "twice", "instead": "return 4 * abs"})
    assert code == 1
    assert "half: killed by test_small.py::test_bound" in output
    assert "twice: SURVIVED, no test failed: The sum has two terms." in output
    assert output.endswith("survivors: twice\n")


def test_all_that_are_asked_for_are_killed(try_mutants):
    code, output = try_mutants({}, {"name": "twice", "instead": "return 4 * abs"}, only=["half"])
    assert code == 0
    assert output.endswith("all 1 mutants were killed\n")


def test_tests_have_to_pass_without_a_mutant(try_mutants):
    code, output = try_mutants({}, comparison=">")
    assert code == 1
    assert output == "without a mutant: test_small.py::test_bound\n"


def test_a_mutant_that_is_no_python_is_not_killed(try_mutants):
    code, output = try_mutants({"instead": "return return"})
    assert code == 1
    assert "half: SURVIVED, the tests do not run" in output


@pytest.mark.parametrize(
    ("changed", "fault"),
    [
        ({"text": "return 3"}, "half: its text occurs 0 times in src/small.py, not once"),
        ({"text": "x"}, "half: its text occurs 4 times in src/small.py, not once"),
        ({"tests": ["test_small.py::test_boun"]}, "half: there is no test test_small.py::test_boun"),
        ({"tests": ["test_large.py"]}, "half: there is no test test_large.py"),
        ({"file": "src/large.py"}, "half: its text occurs 0 times in src/large.py, not once"),
    ],
)
def test_what_no_longer_fits_is_refused(try_mutants, changed, fault):
    """Before any test is run."""
    assert try_mutants(changed) == (1, f"{fault}\n")


def test_an_unknown_name_is_refused(try_mutants):
    with pytest.raises(SystemExit) as ended:
        try_mutants({}, only=["third"])
    assert ended.value.code == 2
