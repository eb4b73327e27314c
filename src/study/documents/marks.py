"""Documents that people write: numbers and tables are filled in between marks, all else is kept.

- `<!--=NAME:FORMAT-->0.19<!--/-->` holds the number of that name, see `formats`;
- `<!--?CLAIM-->a sentence.<!--/-->` guards what is true only while a claim of the ledger holds, or all of
  several, separated by commas;
- a block, a table, stands between the lines `<!-- NAME: begin -->` and `<!-- NAME: end -->`.

A line must not begin with one of the first two, since Markdown would take all of it for HTML.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from hashlib import sha256
from pathlib import Path

from study import formats
from study.documents import verdicts
from study.ledger import records
from unilateral.errors import InputError, quote_input
from unilateral.system.files import replacing

NUMBER_MARK = re.compile(r"<!--=(?P<name>[\w.]+)(?::(?P<spec>[^\n>]*?))?-->[^<\n]*<!--/-->")
CLAIM_MARK = re.compile(r"<!--\?(?P<name>[^\s>]+)-->(?P<sentence>(?:(?!<!--).)+)<!--/-->", re.DOTALL)
ANY_MARK = re.compile(r"<!--[=?/].*?(?:-->|$)", re.MULTILINE)
LINE_START_MARK = re.compile(r"^[ \t]*(?:(?:[-*+>]|\d+[.)])[ \t]+)?(<!--[=?/])", re.MULTILINE)
BLOCK_MARK = re.compile(r"^<!-- ([\w-]+): (begin|end) -->$", re.MULTILINE)
BLOCK_WITH_MARKS = re.compile(
    r"^(<!-- ([\w-]+): begin -->\n).*?^(<!-- \2: end -->)$", re.DOTALL | re.MULTILINE
)


def fill_documents(numbers: str, blocks: str, claims: str, documents: Sequence[str]) -> None:
    """Fill in all documents, from the files of numbers, of blocks and of claims."""
    holding = verdicts.holds_by_claim(records.read_records(claims))
    for document in documents:
        fill_document(document, records.read_records(numbers), records.read_records(blocks), holding)


def fill_document(
    path: str | Path,
    numbers: Mapping[str, formats.Value],
    blocks: Mapping[str, str],
    claims: Mapping[str, bool],
) -> None:
    """Fill in a document, in place. Raises InputError as `fill_text` does, and leaves the file as it is."""
    text = fill_text(path, numbers, blocks, claims)
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def fill_text(
    path: str | Path,
    numbers: Mapping[str, formats.Value],
    blocks: Mapping[str, str],
    claims: Mapping[str, bool],
) -> str:
    """The text of a document, filled in; `claims` says of each claim whether it holds.

    Raises InputError for a mark that is not closed, or at the start of a line; for an unknown name; for a
    format that does not fit; and for a sentence whose claim does not hold.
    """
    try:
        source = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as fault:
        raise InputError(f"{path} is listed as a document, and is no text in UTF-8 ({fault})") from None
    text = _fill_numbers(str(path), source, numbers)
    _check_marks(str(path), text, claims)
    return _fill_blocks(str(path), text, blocks)


def digest_prose(path: str | Path) -> str:
    """The SHA-256 of what people wrote in a document, without what is filled in. Empty if it is no text."""
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""
    prose = NUMBER_MARK.sub(lambda mark: mark[0].partition("-->")[0], BLOCK_WITH_MARKS.sub(r"\1\3", text))
    return sha256(prose.encode()).hexdigest()


def remove_marks(text: str) -> str:
    """The text that readers see."""
    return ANY_MARK.sub("", BLOCK_MARK.sub("", text))


def _fill_blocks(path: str, text: str, blocks: Mapping[str, str]) -> str:
    marks = BLOCK_MARK.findall(text)
    names = [name for name, _ in marks[::2]]
    if marks != [(name, edge) for name in dict.fromkeys(names) for edge in ("begin", "end")]:
        listed = ", ".join(f"{name}: {edge}" for name, edge in marks)
        raise InputError(f"{path}: each block needs one begin mark and then one end mark, not {listed}")
    for name in names:
        _require_name(f"{path}, block '{name}'", "block", name, blocks)
    return BLOCK_WITH_MARKS.sub(lambda mark: f"{mark[1]}{blocks[mark[2]]}\n{mark[3]}", text)


def _fill_numbers(path: str, text: str, numbers: Mapping[str, formats.Value]) -> str:
    def fill_mark(mark: re.Match[str]) -> str:
        """The mark with its number in the format that it asks for."""
        name = mark["name"]
        spec = mark["spec"] or ""
        where = f"{_locate_mark(path, text, mark.start())}, mark '{mark[0].partition('-->')[0][4:]}'"
        _require_name(where, "number", name, numbers)
        try:
            value = formats.format_value(numbers[name], spec)
        except ValueError as fault:
            raise InputError(
                f"{where}: {numbers[name]!r} cannot be shown so ({fault}); use a format of Python's such as "
                f".2g, or one of {', '.join(formats.OWN_FORMATS)}, down.2f, up.3g, up.short, .2g%"
            ) from None
        return f"{mark[0].partition('-->')[0]}-->{value}<!--/-->"

    return NUMBER_MARK.sub(fill_mark, text)


def _check_marks(path: str, text: str, claims: Mapping[str, bool]) -> None:
    if early := LINE_START_MARK.search(text):
        where = _locate_mark(path, text, early.start(1))
        raise InputError(
            f"{where}: a line begins with a mark, and Markdown takes all of it for HTML; put a word before it"
        )
    sentences = NUMBER_MARK.sub(lambda mark: remove_marks(mark[0]), text)
    for mark in CLAIM_MARK.finditer(sentences):
        sentence = quote_input(" ".join(mark["sentence"].split()))
        where = f"{_locate_mark(path, sentences, mark.start())}, '{sentence}'"
        for name in mark["name"].split(","):
            _require_name(where, "claim", name, claims)
            if not claims[name]:
                raise InputError(
                    f"{where}: claim {name}, on which this sentence rests, does not hold; rewrite it"
                )
    unguarded = CLAIM_MARK.sub(lambda mark: mark["sentence"], sentences)
    if stray := ANY_MARK.search(unguarded):
        where = _locate_mark(path, unguarded, stray.start())
        raise InputError(
            f"{where}, mark '{quote_input(stray[0])}': it is in no pair; "
            "right is <!--=NAME:FORMAT-->0.19<!--/--> on one line, or <!--?CLAIM-->a sentence.<!--/-->"
        )


def _require_name(where: str, kind: str, name: str, valid_names: Iterable[str]) -> None:
    names = list(valid_names)
    if name not in names:
        close = difflib.get_close_matches(name, names, n=3, cutoff=0) or ["none"]
        raise InputError(f"{where}: there is no {kind} '{name}'; the most similar are {', '.join(close)}")


def _locate_mark(path: str, text: str, position: int) -> str:
    return f"{path}, line {text.count(chr(10), 0, position) + 1}"
