"""What holds the words of messages: tests/sentences.py."""

import pytest
import sentences

from unilateral.errors import InputError, StorageError


def test_each_stored_sentence_is_of_a_test_that_is_there():
    assert sentences.recorder.list_orphans() == []


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
    recorder.sentences = stored
    recorder.begin("a.py::test")
    with pytest.raises((AssertionError, InputError)), sentences.raises(error, *names):
        raise InputError(message)
    recorder.begin("a.py::test")
    with sentences.raises(InputError, "mesh.csv"):
        raise InputError("mesh.csv, line 2: 'x' is no number")


def test_a_stored_sentence_that_a_test_does_not_come_to_is_noticed():
    recorder = sentences.Recorder()
    recorder.sentences = {"a.py": {"test": ["one", "two"]}}
    recorder.begin("a.py::test")
    recorder.check("one")
    assert recorder.list_unused_sentences() == ["two"]
    recorder.check("two")
    assert recorder.list_unused_sentences() == []


def test_a_rewrite_stores_what_the_tests_say_now(tmp_path, monkeypatch):
    """Of the functions that run; others keep theirs, and those that are gone lose them.

    Folders, and digits that depend on the processor, are left out.
    """
    monkeypatch.setattr(sentences, "FILE", tmp_path / "sentences.yaml")
    monkeypatch.setattr(sentences, "PROJECT", tmp_path / "project")
    (tmp_path / "project").mkdir()
    (tmp_path / "project/a.py").write_text("def test_1(): ...\ndef test_2(): ...\n")
    recorder = sentences.Recorder()
    recorder.sentences = {
        "a.py": {"test_1[x]": ["old"], "test_1[y]": ["old"], "test_2": ["kept"], "test_3": ["lost"]}
    }
    recorder.rewriting = True
    recorder.temporary = str(tmp_path / "run")
    assert recorder.list_orphans() == [("a.py", "test_3")]
    recorder.begin("a.py::test_1[x]")
    recorder.check(f"{tmp_path}/run/test_0/u.csv: 0.123456789 at {tmp_path}/project/src")
    recorder.write()
    again = sentences.Recorder()
    assert again.sentences == {
        "a.py": {"test_1[x]": ["<tmp>/u.csv: 0.1235 at <project>/src"], "test_2": ["kept"]}
    }
