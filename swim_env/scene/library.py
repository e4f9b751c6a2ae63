"""Scene files: the shipped ones by name, any other by path.

The shipped scenes are the YAML files in ``configs/scenes``.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from swim_env.errors import SceneError
from swim_env.scene.checks import nearest
from swim_env.scene.yaml import parse_yaml, read_text


def _scene_folder() -> Path | None:
    """Return the folder of the shipped scenes: in the wheel, or beside the package."""
    here = Path(__file__).parents[1]
    for base in (here, here.parent):
        folder = base / "configs" / "scenes"
        if folder.is_dir():
            return folder
    return None


def scene_names() -> tuple[str, ...]:
    """Return the names of the shipped scenes, sorted, planar ones before those in space."""
    folder = _scene_folder()
    files = [] if folder is None else folder.glob("*.yaml")
    return tuple(path.stem for path in sorted(files, key=lambda path: (_is_spatial(path), path)))


def _is_spatial(shipped: Path) -> bool:
    """Whether a shipped scene has dimension 3, which its first line says."""
    with shipped.open(encoding="utf-8") as file:
        return file.readline().startswith("dimension: 3")


def find_scene_file(scene: object) -> tuple[Path, str]:
    """Return the file of a scene that is given by name or path, and what messages call it.

    Raises
    ------
    SceneError
        If it is neither a shipped name nor the path of a file.
    """
    if not isinstance(scene, (str, os.PathLike)):
        raise SceneError(
            "a scene must be given as a name, a path, a Scene or a mapping, got "
            f"{type(scene).__name__}"
        )
    given = os.fspath(scene)
    folder = _scene_folder()
    names = scene_names()
    if isinstance(scene, str) and folder is not None and scene in names:
        return folder / f"{scene}.yaml", f"configs/scenes/{scene}.yaml"
    looks_like_path = Path(given).suffix in (".yaml", ".yml") or len(Path(given).parts) > 1
    if not isinstance(scene, str) or looks_like_path or os.path.isfile(given):
        return Path(given), given
    shipped = f"; shipped scenes: {', '.join(names)}" if names else "; no scenes are shipped"
    raise SceneError(f"unknown scene {scene!r}{nearest(scene, names)}{shipped}")


def read_scene_file(path: str | os.PathLike[str], source: str) -> Any:
    """Return the content of a scene file, which messages call `source`.

    A scene without a name gets the file's.

    Raises
    ------
    SceneError
        If there is no such file, it cannot be read, is not YAML, or is empty.
    """
    file = Path(path)
    if not os.path.exists(file):
        folder = file.parent
        there = [entry.name for entry in folder.glob("*.y*ml")] if folder.is_dir() else []
        hint = nearest(file.name, there) or nearest(file.stem, scene_names())
        shipped = ", ".join(scene_names())
        raise SceneError(f"no such scene file: {source}{hint}; shipped scenes: {shipped}")
    data = parse_yaml(read_text(file, source), source)
    if data is None:
        raise SceneError("the file is empty, must hold the fields of a scene", source)
    return {"name": file.stem, **data} if isinstance(data, dict) else data
