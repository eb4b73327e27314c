"""A paper or a page in Markdown as HTML, by pandoc, and as PDF, by typst (extra `study`)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import pypandoc
import typst

from study.documents import marks
from unilateral.errors import InputError
from unilateral.system.files import replacing

PDF_STANDARD: Final = "a-2b"
"""The PDF/A standard of the paper; under it typst refuses a letter that its fonts do not have."""
PANDOC_NOISE = re.compile(r"Pandoc died .*?: |\[WARNING\] |Failing because.*|stack traceback.*", re.DOTALL)
DIAGNOSTIC_SOURCE = re.compile(r"^\s*\d+ │ (.*)$", re.MULTILINE)


def typeset_paper(
    paper: str | Path,
    numbers: str | Path,
    page_template: str | Path,
    print_template: str | Path,
    html: str | Path,
    pdf: str | Path,
) -> None:
    """Write the paper as one HTML file and as PDF, both or none; the same paper gives the same bytes.

    `numbers` is a Lua filter; pictures and bibliography are sought from the paper's folder. Raises InputError
    for what pandoc or typst complain of: an unknown citation or link, a picture, a formula or a letter that
    they cannot set, a formula wider than the text.
    """
    text = Path(paper).read_text(encoding="utf-8")
    page = convert_to_page(text, paper, numbers, page_template)
    printed = _compile_pdf(paper, _convert_markdown(text, paper, "typst", numbers, print_template))
    with replacing(html) as new_html, replacing(pdf) as new_pdf:
        new_html.write_text(page, encoding="utf-8")
        new_pdf.write_bytes(printed)


def convert_to_page(text: str, paper: str | Path, numbers: str | Path, template: str | Path) -> str:
    """A text in Markdown as one HTML page with its contents at the top; `paper` is the file of the text."""
    return _convert_markdown(
        text, paper, "html", numbers, template, "--mathml", "--embed-resources", "--toc", "--toc-depth=2"
    )


def convert_to_restructured_text(text: str) -> str:
    """A text in Markdown with marks as reStructuredText, for the first page of Snakemake's report."""
    converted: str = pypandoc.convert_text(
        marks.remove_marks(text), "rst", format="markdown", extra_args=["--wrap=none"]
    )
    return converted


def _convert_markdown(
    text: str, paper: str | Path, target_format: str, numbers: str | Path, template: str | Path, *options: str
) -> str:
    arguments = [
        "--standalone",
        f"--template={template}",
        f"--lua-filter={numbers}",
        "--citeproc",
        "--metadata=link-citations",
        "--metadata=reference-section-title:References",
        f"--resource-path={Path(paper).parent}",
        "--syntax-highlighting=none",
        "--columns=10000",  # as wide as any table: the widths of columns are the filter's business
        "--fail-if-warnings",
        *options,
    ]
    try:
        return pypandoc.convert_text(
            marks.remove_marks(text), target_format, format="markdown", extra_args=arguments
        )
    except RuntimeError as error:
        complaint = " ".join(PANDOC_NOISE.sub("", str(error)).split())
        raise InputError(f"{paper} was not typeset: pandoc says {complaint}") from error


def _compile_pdf(paper: str | Path, source: str) -> bytes:
    complaints: list[typst.TypstWarning | typst.TypstError] = []
    try:
        printed, warnings = typst.compile_with_warnings(  # type: ignore[type-var]  # its stubs forbid two types
            source.encode(), root=Path(paper).parent, ignore_system_fonts=True, pdf_standards=[PDF_STANDARD]
        )
        complaints += warnings
    except typst.TypstError as error:
        complaints.append(error)
    if complaints:
        place = DIAGNOSTIC_SOURCE.search(complaints[0].diagnostic)
        where = f" in: {place[1].strip()}" if place else ""
        raise InputError(f"{paper} was not typeset: typst says {complaints[0].message}{where}")
    return printed
