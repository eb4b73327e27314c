"""The study's tables, read when they are asked for."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import xarray as xr

from study.ledger import records
from study.tables import load_table


class Results(dict[str, xr.Dataset]):
    """The tables below a folder by name, such as "square/errors", read when they are asked for.

    A file that is in `listed_digests` has to have the SHA-256 that is listed there.
    """

    def __init__(
        self,
        folder: str | Path,
        tables: Mapping[str, xr.Dataset] | None = None,
        listed_digests: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(tables or {})
        self.folder = Path(folder)
        self.listed_digests = listed_digests or {}

    def __missing__(self, name: str) -> xr.Dataset:
        table = load_table(self.folder / f"{name}.nc")
        records.check_listed_digest(self.folder, f"{name}.nc", self.listed_digests)
        self[name] = table
        return table


def open_finished_results(folder: str | Path) -> Results:
    """The tables of a study that has ended, as its manifest lists them, if there is one."""
    return Results(folder, listed_digests=records.read_listed_digests(folder))
