"""The study's tables, read when they are asked for."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import xarray as xr

from unilateral.study.tables import load


class Results(dict[str, xr.Dataset]):
    """The tables below a folder by name, such as "square/errors", read when they are asked for."""

    def __init__(self, folder: str | Path, tables: Mapping[str, xr.Dataset] | None = None) -> None:
        super().__init__(tables or {})
        self.folder = Path(folder)

    def __missing__(self, name: str) -> xr.Dataset:
        self[name] = load(self.folder / f"{name}.nc")
        return self[name]
