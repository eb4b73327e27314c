"""The study's tables, read when they are asked for."""

from __future__ import annotations

from collections.abc import Mapping
from hashlib import sha256
from pathlib import Path

import xarray as xr

from unilateral.errors import StorageError
from unilateral.study.ledger import records
from unilateral.study.tables import load

MANIFEST = "manifest.json"


class Results(dict[str, xr.Dataset]):
    """The tables below a folder by name, such as "square/errors", read when they are asked for.

    A file that is `listed` has to have the SHA-256 that is listed.
    """

    def __init__(
        self,
        folder: str | Path,
        tables: Mapping[str, xr.Dataset] | None = None,
        listed: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(tables or {})
        self.folder, self.listed = Path(folder), listed or {}

    def __missing__(self, name: str) -> xr.Dataset:
        path = self.folder / f"{name}.nc"
        table = load(path)
        found = sha256(path.read_bytes()).hexdigest()
        if (wanted := self.listed.get(f"{name}.nc", found)) != found:
            raise StorageError(
                f"{path} is another version than the study ended with: its SHA-256 is {found[:16]}..., and "
                f"{self.folder / MANIFEST} has {wanted[:16]}...; 'snakemake -j2 -f {path}' makes it anew"
            )
        self[name] = table
        return table


def finished(folder: str | Path) -> Results:
    """The tables of a study that has ended, as its manifest lists them, if there is one."""
    manifest = Path(folder, MANIFEST)
    if not manifest.is_file():
        return Results(folder)
    found = records.read(manifest)
    try:
        return Results(folder, listed={of["path"].partition("/")[2]: of["sha256"] for of in found["files"]})
    except (KeyError, TypeError, AttributeError) as error:
        raise StorageError(
            f"{manifest} is not the manifest of a study; 'snakemake -j2 -f {manifest}' makes it anew"
        ) from error
