"""Reads text files of two columns of numbers, such as CSV, and names the line of what is wrong."""

from __future__ import annotations

import re
from os import PathLike

import numpy as np

from unilateral.arrays import Array
from unilateral.errors import InputError, quote_input

NUMBER_PATTERN = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]{1,3})?")
NUMBER_START_PATTERN = re.compile(r"[-+.]?[0-9]")
DECIMAL_COMMA_PATTERNS = (
    re.compile(r"[-+0-9]+,[0-9]+\s*[;\s]\s*[-+0-9]+(,[0-9]+)?"),
    re.compile(r"[-+0-9]+\s*[;\t]\s*[-+0-9]+,[0-9]+"),
    re.compile(r"[-+0-9]+,[0-9]+,\s*[-+0-9]+,[0-9]+"),
)
"""Rows of two numbers of which one has a decimal comma, by what separates them."""
SEPARATORS = (";", "\t", ",")
"""The first of these that is in a line is what separates its columns; else blanks do."""
MAX_COLUMN_ROWS = 10_000
MAX_COLUMN_BYTES = 2_000_000
"""No file is read that has more rows or bytes; a row of the most digits has 50."""


def read_columns(path: str | PathLike[str], where: str, names: str) -> tuple[Array, list[int]]:
    """The numbers (n, 2) in the rows of a file, and their lines (n,); a heading is left out.

    Messages tell the `names` of the two columns. Empty lines and those that begin with # are left out, too.
    Raises InputError, beginning with the file and the line, for a row that is not two numbers with decimal
    points, and, beginning with `where`, for a file that cannot be read.
    """
    try:
        with open(path, "rb") as stream:
            content = stream.read(MAX_COLUMN_BYTES + 1)
        lines = content.decode("utf-8-sig").splitlines()
    except OSError as error:
        raise InputError(f"{where}: {path} cannot be read: {error.strerror or error}") from None
    except ValueError:
        raise InputError(f"{where}: {path} is no text file in UTF-8; save it as CSV") from None
    if len(content) > MAX_COLUMN_BYTES:
        raise InputError(f"{where}: {path} has more than {MAX_COLUMN_BYTES} bytes, which no such file needs")
    rows: list[tuple[float, ...]] = []
    row_lines: list[int] = []
    has_heading = False
    for number, line in enumerate(lines, start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        cells = _split_line(line)
        if not rows and not has_heading and not any(map(NUMBER_START_PATTERN.match, cells)):
            has_heading = True
            continue
        if len(cells) != 2 or not all(map(NUMBER_PATTERN.fullmatch, cells)):
            raise InputError(f"{path}, line {number}: {_explain_row(line, names)}")
        rows.append(tuple(map(float, cells)))
        row_lines.append(number)
    if len(rows) > MAX_COLUMN_ROWS:
        raise InputError(f"{path}: it has {len(rows)} rows; at most {MAX_COLUMN_ROWS} are read")
    return np.array(rows).reshape(-1, 2), row_lines


def _split_line(line: str) -> list[str]:
    separator = next((separator for separator in SEPARATORS if separator in line), None)
    return [cell.strip() for cell in line.split(separator)]


def _explain_row(line: str, names: str) -> str:
    """Words on a row that is not two numbers; decimal commas are hinted at."""
    quoted = quote_input(line.strip())
    if any(pattern.fullmatch(line.strip()) for pattern in DECIMAL_COMMA_PATTERNS):
        return f"'{quoted}' seems to have decimal commas; write decimal points, as in 0.5, 1.25"
    return f"'{quoted}' is not two numbers, {names}; write them as in 0.5, 1.25"
