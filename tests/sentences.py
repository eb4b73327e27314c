"""The words of messages: all in sentences.yaml, which `pytest --rewrite-sentences` writes anew.

A test says which kind of error there has to be, and what the message has to name:

    with sentences.raises(InputError, "points.csv", "line 3"):

The whole sentence has to be the one that sentences.yaml has for this test. A rewrite shows up in `git diff`.
A temporary folder is written <tmp>, the project's folder <project>.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path

import pytest
import yaml

PROJECT = Path(__file__).parents[1]
FILE = Path(__file__).with_name("sentences.yaml")
LONG_NUMBER = re.compile(r"\d+\.\d{5,}(e[+-]\d+)?")
"""Its last digits depend on the processor: four are compared."""


def function_name(test: str) -> str:
    """The name of a test without its parameters."""
    return test.partition("[")[0]


def has_test(file: Path, function: str) -> bool:
    return file.exists() and f"def {function}(" in file.read_text(encoding="utf-8")


class Recorder:
    """Compares what the running test says with what is stored, sentence by sentence."""

    def __init__(self):
        self.rewriting = False
        self.temporary = ""
        """The folder of all temporary folders of this run."""
        self.rewritten: set[tuple[str, str]] = set()
        """Files and functions of which sentences are stored anew."""

    @cached_property
    def sentences(self) -> dict[str, dict[str, list[str]]]:
        """The sentences of each test of each file."""
        return yaml.load(FILE.read_text(encoding="utf-8"), yaml.CSafeLoader)

    def begin(self, nodeid: str) -> None:
        """A test starts; when rewriting, all old sentences of its function are dropped."""
        self.file, _, self.test = nodeid.partition("::")
        self.count = 0
        function = function_name(self.test)
        if self.rewriting and (self.file, function) not in self.rewritten:
            self.rewritten.add((self.file, function))
            tests = self.sentences.pop(self.file, {})
            self.sentences[self.file] = {
                test: tests[test] for test in tests if function_name(test) != function
            }

    def check(self, text: str) -> None:
        """The next sentence of the running test is the stored one; when rewriting, it is stored."""
        text = re.sub(rf"{re.escape(self.temporary)}/[^/\s'\"]+", "<tmp>", text)
        text = text.replace(str(PROJECT), "<project>")
        text = LONG_NUMBER.sub(lambda number: f"{float(number[0]):.4g}", text)
        if self.rewriting:
            self.sentences.setdefault(self.file, {}).setdefault(self.test, []).append(text)
            return
        sentences = self.sentences.get(self.file, {}).get(self.test, [])
        stored = sentences[self.count] if self.count < len(sentences) else None
        self.count += 1
        assert text == stored, f"tests/sentences.yaml has another sentence here: {stored}\nbut now: {text}"

    def list_unused_sentences(self) -> list[str]:
        """The stored sentences that the running test, which has ended, did not come to."""
        return self.sentences.get(self.file, {}).get(self.test, [])[self.count :]

    def list_orphans(self) -> list[tuple[str, str]]:
        """The files and names of stored tests that are no longer there."""
        return [
            (file, test)
            for file, tests in self.sentences.items()
            for test in tests
            if not has_test(PROJECT / file, function_name(test))
        ]

    def write(self) -> None:
        """Sentences of tests that are no longer there are dropped."""
        files = {
            file: {test: tests[test] for test in sorted(tests)}
            for file, tests in sorted(self.sentences.items())
            if tests
        }
        for file, test in self.list_orphans():
            del files[file][test]
        text = yaml.safe_dump(files, width=110, allow_unicode=True, sort_keys=False)
        FILE.write_text(text, encoding="utf-8")


recorder = Recorder()


@contextmanager
def raises(error: type[BaseException], *names: str) -> Iterator[pytest.ExceptionInfo]:
    """An error of this kind is raised, its message contains these names, and is the stored one."""
    with pytest.raises(error) as caught:
        yield caught
    message = str(caught.value)
    for name in names:
        assert name in message
    recorder.check(message)
