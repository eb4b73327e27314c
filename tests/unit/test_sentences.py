"""What holds the words of messages: tests/sentences.py."""

import pytest
import sentences
from conftest import ROOT

from unilateral.errors import InputError, StorageError


def test_each_stored_sentence_is_of_a_test_that_is_there():
    """Of those that are gone `pytest --rewrite-sentences` knows nothing."""
    gone = []
    for file, tests in sentences.recorder.stored.items():
        text = (ROOT / file).read_text(encoding="utf-8") if (ROOT / file).exists() else ""
        gone += [f"{file}::{test}" for test in tests if f"def {test.partition('[')[0]}(" not in text]
    assert gone == []


@pytest.mark.parametrize(
    ("error", "names", "message"),
    [
        (InputError, (), "mesh.csv, line 2: 'x' is no numbers"),
        (InputError, ("points.csv",), "mesh.csv, line 2: 'x' is no number"),
        (StorageError, (), "mesh.csv, line 2: 'x' is no number"),
    ],
    ids=["other words", "another name", "another kind"],
)
def test_another_sentence_name_or_kind_fails(error, names, message, monkeypatch):
    """Control: with the first of these sentences, and one more, the test passes."""
    stored = {"a.py": {"test": ["mesh.csv, line 2: 'x' is no number"]}}
    monkeypatch.setattr(sentences, "recorder", recorder := sentences.Recorder())
    recorder.stored = stored
    recorder.begin("a.py::test")
    with pytest.raises((AssertionError, InputError)), sentences.raises(error, *names):
        raise InputError(message)
    recorder.begin("a.py::test")
    with sentences.raises(InputError, "mesh.csv"):
        raise InputError("mesh.csv, line 2: 'x' is no number")


def test_a_rewrite_stores_what_the_tests_say_now(tmp_path, monkeypatch):
    """Of the tests that run, and of no other; folders and digits that depend on the processor go."""
    monkeypatch.setattr(sentences, "FILE", tmp_path / "sentences.yaml")
    recorder = sentences.Recorder()
    recorder.stored = {"a.py": {"test_1": ["old"], "test_2": ["kept"]}}
    recorder.rewriting, recorder.temporary = True, str(tmp_path)
    recorder.begin("a.py::test_1")
    recorder.check(f"{tmp_path}/test_0/u.csv: 0.123456789 at {ROOT}/src")
    recorder.write()
    again = sentences.Recorder()
    assert again.stored == {"a.py": {"test_1": ["<tmp>/u.csv: 0.1235 at <project>/src"], "test_2": ["kept"]}}
