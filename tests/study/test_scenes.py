"""A scene's coarsest mesh as a file, of which what is damaged is noticed; and its sizes."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest
import sentences

from study import scenes
from unilateral.errors import InputError, StorageError
from unilateral.geometry import files
from unilateral.geometry.mesh import Mesh

SCENE = {"polygon": "square", "mesh": {"kind": "unstructured", "h": "1/4"}}


@pytest.fixture
def mesh_file(tmp_path: Path) -> Path:
    files.write_mesh(scenes.coarsest_mesh(SCENE), tmp_path / "mesh.vtu")
    return tmp_path / "mesh.vtu"


def same(mesh: Mesh, other_mesh: Mesh) -> bool:
    return all(
        np.array_equal(getattr(mesh, name), getattr(other_mesh, name))
        for name in ("points", "triangles", "s")
    )


def read_with(path: Path, content: bytes) -> Mesh | None:
    """The mesh of a file with this content, or None if it is refused."""
    path.write_bytes(content)
    try:
        return scenes.read_coarsest_mesh(str(path), SCENE)
    except StorageError:
        return None


def test_cases_with_different_forms_are_no_scene() -> None:
    scene = {"polygon": "square", "side": 0, "cases": ["natural", "clamped"]}
    with sentences.raises(InputError):
        scenes.load_cases(scene)
    assert [case.name for case in scenes.load_cases(scene | {"cases": ["clamped"]})] == ["clamped"]


def test_no_flipped_bit_and_no_cut_changes_the_mesh(mesh_file: Path) -> None:
    """300 bits and 50 lengths: zlib has a checksum of what it compresses, Adler-32; the rest is XML."""
    full_bytes = mesh_file.read_bytes()
    rng = np.random.default_rng(1)
    refused = 0
    for bit in rng.integers(8 * len(full_bytes), size=300):
        damaged = bytearray(full_bytes)
        damaged[bit // 8] ^= 1 << bit % 8
        damaged_mesh = read_with(mesh_file, bytes(damaged))
        refused += damaged_mesh is None
        assert damaged_mesh is None or same(damaged_mesh, scenes.coarsest_mesh(SCENE))
    assert refused > 200
    for length in rng.integers(len(full_bytes) - len("</VTKFile>"), size=50):
        assert read_with(mesh_file, full_bytes[:length]) is None


def test_a_flipped_bit_changes_the_mesh_where_nothing_is_compressed(mesh_file: Path) -> None:
    """Control: one of the digits of a node inside."""
    meshio.read(mesh_file).write(mesh_file, binary=False)
    right = scenes.read_coarsest_mesh(str(mesh_file), SCENE)
    content = mesh_file.read_text(encoding="utf-8")
    inside = next(x for x in right.points[:, 0] if 0.1 < x < 0.9 and x not in (0.25, 0.5, 0.75))
    place = content.index(f"{inside:.15e}"[:8]) + 7
    damaged = bytearray(content.encode())
    damaged[place] ^= 1
    damaged_mesh = read_with(mesh_file, bytes(damaged))
    assert damaged_mesh is not None
    assert not same(damaged_mesh, right)


@pytest.mark.parametrize(
    ("H", "h", "levels", "limits", "expected"),
    [
        (["1/4", "1/8", "1/16", "1/32"], "1/8", 3, {"min": "1/2"}, [0, 1, 2]),
        (["1/4", "1/8", "1/16"], "1/8", 3, {"min": 2, "max": 1}, [1, 2]),
        ([2.2, 2.1, 0.7], 0.7, 1, {"max": 3}, [1]),
        (["1/8"], "1/8", 1, {}, []),
    ],
)
def test_lambda_has_a_norm_on_partitions_coarser_than_the_finest_mesh_and_within_the_limit(
    H: list, h: str | float, levels: int, limits: dict, expected: list[int]
) -> None:
    """2.1 is no more than 3 times 0.7, but it is in floating point."""
    scene = {"H": H, "mesh": {"h": h, "levels": levels}, "H_over_h": limits}
    assert scenes.dual_norm_partitions(scene) == expected
