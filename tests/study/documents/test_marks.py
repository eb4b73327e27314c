"""Marks in documents: what is filled in, what is kept, and what is refused in one sentence."""

import pytest
import sentences

from study import formats
from study.documents import marks
from unilateral.errors import InputError

BEGIN = "<!-- rates: begin -->"
END = "<!-- rates: end -->"
OTHER = "<!-- cost: begin -->\nb\n<!-- cost: end -->\n"
NUMBERS = {
    "beta.worst": 0.1874,
    "cost.h": 0.0625,
    "label": "worst found",
    "broken": float("nan"),
    "zero": 0.0,
}
BLOCKS = {"rates": "new", "cost": "c"}
CLAIMS = {"S.local": True, "5.K": False}


@pytest.fixture
def page(tmp_path):
    """Fills a page with that text and returns what it then holds; doing so twice changes nothing."""

    def fill(text, blocks=BLOCKS):
        file = tmp_path / "page.md"
        file.write_text(text, encoding="utf-8")
        marks.fill_document(file, NUMBERS, blocks, CLAIMS)
        once = file.read_text(encoding="utf-8")
        marks.fill_document(file, NUMBERS, blocks, CLAIMS)
        assert file.read_text(encoding="utf-8") == once
        assert list(tmp_path.iterdir()) == [file]
        return once

    return fill


def test_only_what_stands_between_the_marks_of_a_block_is_replaced(page):
    text = f"above\n\n{BEGIN}\nold\nlines\n{END}\n\nbelow `{BEGIN}` λ\n{OTHER}"
    second = OTHER.replace("\nb\n", "\nc\nd\n")
    expected = f"above\n\n{BEGIN}\nnew \\1\n{END}\n\nbelow `{BEGIN}` λ\n{second}"
    assert page(text, {"rates": r"new \1", "cost": "c\nd", "unused": "e"}) == expected


def test_a_number_is_set_in_its_format_and_its_marks_stay(page):
    filled = page(
        "It is <!--=beta.worst:.2g-->9<!--/-->, h = <!--=cost.h:1/n--><!--/-->, <!--=label-->?<!--/-->.\n"
    )
    assert filled == (
        "It is <!--=beta.worst:.2g-->0.19<!--/-->, h = <!--=cost.h:1/n-->1/16<!--/-->, "
        "<!--=label-->worst found<!--/-->.\n"
    )
    assert marks.remove_marks(filled) == "It is 0.19, h = 1/16, worst found.\n"


def test_an_edit_is_told_from_what_is_filled_in(page, tmp_path):
    """By the digest of what people wrote, of which a block and a number between their marks are no part."""
    data = f"β = <!--=beta.worst:.2g-->9<!--/-->\n{BEGIN}\nold\n{END}\n"
    edits = [data.replace("β", "γ"), data.replace("worst", "best"), data.replace(".2g", ".3g"), ""]
    filled = page(data)
    assert filled != data
    digests = []
    for text in (data, filled, *edits):
        (tmp_path / "page.md").write_text(text, encoding="utf-8")
        digests.append(marks.digest_prose(tmp_path / "page.md"))
    assert digests[0] == digests[1]
    assert len(set(digests)) == 5


def test_a_sentence_whose_claim_holds_is_kept_with_the_numbers_in_it(page):
    filled = page(
        "If <!--?S.local-->edges are short,\nβ ≥ <!--=beta.worst:down.2f-->?<!--/-->.<!--/--> So.\n"
    )
    assert (
        filled
        == "If <!--?S.local-->edges are short,\nβ ≥ <!--=beta.worst:down.2f-->0.18<!--/-->.<!--/--> So.\n"
    )


def test_other_comments_and_text_are_kept(page):
    text = "<!-- a note -->\n\n* a <b>c</b> $x<y$ {#id}\n"
    assert page(text) == text


NUMBER = "It is <!--=beta.worst:.2g-->9<!--/-->.\n"
REFUSED = {
    "no begin": (f"{END}\n", "each block needs one begin mark"),
    "no end": (f"{BEGIN}\n", "each block needs one begin mark"),
    "reversed": (f"{END}\n{BEGIN}\n", "each block needs one begin mark"),
    "two begins": (f"{BEGIN}\n{BEGIN}\n{END}\n", "each block needs one begin mark"),
    "two ends": (f"{BEGIN}\n{END}\n{END}\n", "each block needs one begin mark"),
    "twice": (f"{BEGIN}\n{END}\n{BEGIN}\n{END}\n", "each block needs one begin mark"),
    "not alone": (f"{BEGIN} \n{END}\n", "each block needs one begin mark"),
    "unknown block": (
        "<!-- rate: begin -->\n<!-- rate: end -->\n",
        "block 'rate': there is no block 'rate'; the most similar are rates",
    ),
    "unknown number": (
        "\nIt is <!--=beta.wrst-->1<!--/-->.\n",
        r"line 2, mark '=beta\.wrst': there is no number 'beta\.wrst'; the most similar are beta\.worst",
    ),
    "format": (
        NUMBER.replace(".2g", "zz"),
        r"line 1, mark '=beta\.worst:zz': 0\.1874 cannot be shown so .*down",
    ),
    "a text's format": ("A <!--=label:.2g-->b<!--/-->\n", "'worst found' cannot be shown so"),
    "not finite": ("A <!--=broken:.2g-->b<!--/-->\n", "nan cannot be shown so .it is not finite."),
    "no power of ten": ("A <!--=zero:10^-->b<!--/-->\n", r"0\.0 cannot be shown so .it is no power of ten."),
    "number not closed": (
        "It is <!--=beta.worst-->9.\n",
        r"line 1, mark '<!--=beta\.worst-->': it is in no pair",
    ),
    "number over lines": ("It is <!--=beta.worst-->9\nand 8<!--/-->.\n", "it is in no pair"),
    "no name": ("It is <!--=-->9<!--/-->.\n", "it is in no pair"),
    "not opened": ("It is\n9<!--/-->.\n", "line 2, mark '<!--/-->': it is in no pair"),
    "not ended": ("It is <!--=beta.worst 9.\n", "it is in no pair"),
    "swallowed": (f"It <!--?S.local-->is <!--=beta.worst-->9.<!--/-->\n{NUMBER}", "it is in no pair"),
    "claim not closed": ("It <!--?S.local-->holds.\n", r"mark '<!--\?S\.local-->': it is in no pair"),
    "claim in claim": ("It <!--?S.local-->a <!--?S.local-->b<!--/--> c<!--/-->\n", "it is in no pair"),
    "unknown claim": (
        "It <!--?S.rule-->holds.<!--/-->\n",
        "line 1, 'holds.': there is no claim 'S.rule'; the most similar are S.local",
    ),
    "claim fails": (
        "On\nall <!--?5.K-->cases\nbut <!--=label-->x<!--/-->.<!--/-->\n",
        r"line 2, 'cases but worst found\.': claim 5\.K, on which this sentence rests, does not hold;",
    ),
    "one of two claims fails": (
        "All <!--?S.local,5.K-->cases.<!--/-->\n",
        r"line 1, 'cases\.': claim 5\.K, on which this sentence rests, does not hold;",
    ),
    "one of two claims unknown": (
        "All <!--?S.local,S.rule-->cases.<!--/-->\n",
        "line 1, 'cases.': there is no claim 'S.rule'; the most similar are S.local",
    ),
    "line's start": (
        "A\n<!--?S.local-->b.<!--/-->\n",
        "line 2: a line begins with a mark, .* put a word before it",
    ),
    "item's start": ("- <!--=beta.worst-->9<!--/-->\n", "line 1: a line begins with a mark"),
}


@pytest.mark.parametrize(("text", "message"), REFUSED.values(), ids=REFUSED)
def test_what_does_not_fit_is_refused_and_the_file_is_kept(tmp_path, text, message):
    file = tmp_path / "page.md"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=rf"^[^\n]*page\.md[^\n]*{message}[^\n]*$"):
        marks.fill_document(file, NUMBERS, BLOCKS, CLAIMS)
    assert file.read_text(encoding="utf-8") == text
    assert list(tmp_path.iterdir()) == [file]


def test_a_document_that_is_not_there_or_no_text_is_refused(tmp_path):
    with sentences.raises(InputError):
        marks.fill_document(tmp_path / "page.md", NUMBERS, BLOCKS, CLAIMS)
    (tmp_path / "page.md").write_bytes(b"\xff")
    with sentences.raises(InputError):
        marks.fill_document(tmp_path / "page.md", NUMBERS, BLOCKS, CLAIMS)


def test_lines_are_counted_in_the_file_as_it_is(tmp_path):
    """A block above grows only when all is right."""
    file = tmp_path / "page.md"
    file.write_text(f"{BEGIN}\n{END}\nIt is <!--=no-->9<!--/-->.\n")
    with sentences.raises(InputError):
        marks.fill_document(file, NUMBERS, {"rates": "a\nb\nc"}, CLAIMS)


@pytest.mark.parametrize(
    ("value", "spec", "displayed"),
    [
        (0.0625, "1/n", "1/16"),
        (1e-3, "10^", "10^(−3)"),
        (1.0, "10^", "1"),
        (1.94e9, "x10^", "1.9·10^9"),
        (9.96e9, "x10^", "1.0·10^10"),
        (0.719, "down.2f", "0.71"),
        (0.711, "up.2f", "0.72"),
        (2.05, "up.0f", "3"),
        (6.811e-6, "up.3g", "6.82e-06"),
        (0.0041, "up.1g%", "0.5 %"),
        (0.0049, "down.1g%", "0.4 %"),
        (6.811e-6, "up.short", "6.82·10^(−6)"),
        (20000, "space", "20 000"),
        (0.0046, ".2g%", "0.46 %"),
        (6.81e-6, "short", "6.81·10^(−6)"),
        (3, "", "3"),
        ("1/8", "", "1/8"),
    ],
)
def test_a_number_is_written_as_its_format_says(value, spec, displayed):
    assert formats.format_value(value, spec) == displayed


@pytest.mark.parametrize(
    ("value", "spec"), [(0.0, "10^"), (2.0, "1/n"), (0.0, "1/n"), (float("inf"), ""), (1.5, "d")]
)
def test_formats_that_do_not_fit_are_refused(value, spec):
    with pytest.raises(ValueError, match=r"Invalid|Unknown|it is"):
        formats.format_value(value, spec)
