"""Where robots lie, found by name or path: nothing of them is read but their titles."""

from __future__ import annotations

import os
import re
from pathlib import Path

from qsframework.errors import InputError, Problem, nearest
from qsframework.files.documents import read_yaml

ROBOT_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
_HOW_TO_ADD = (
    "A robot is a folder with a robot.yaml and its URDF: give its path, or put it in a folder named by $QSF_ROBOTS."
)


def search_path() -> tuple[Path, ...]:
    """Folders that hold robots: those of $QSF_ROBOTS, the repository's `robots`, the installed ones."""
    package = Path(__file__).resolve().parents[1]
    own = [Path(p) for p in os.environ.get("QSF_ROBOTS", "").split(os.pathsep) if p]
    return (*own, package.parent / "robots", package / "_robots")


def robot_names() -> tuple[str, ...]:
    """Names of all robots on the search path."""
    return tuple(sorted({f.parent.name for folder in search_path() for f in folder.glob("*/robot.yaml")}))


def find_robot(name: str | Path, beside: Path | None = None) -> Path:
    """The robot.yaml of a name on the search path, or of a path (also relative to the folder `beside`).

    InputError offers the nearest name and says how to add a robot.
    """
    if ROBOT_NAME.fullmatch(str(name)):
        for folder in search_path():
            if is_file(folder / str(name) / "robot.yaml"):
                return folder / str(name) / "robot.yaml"
    for base in (beside, Path()):
        path = None if base is None else base / name
        if path is not None and is_file(path / "robot.yaml"):
            return path / "robot.yaml"
        if path is not None and path.suffix in (".yaml", ".yml") and is_file(path):
            return path
    names = robot_names()
    hint = " ".join(part for part in (nearest(str(name), names), _HOW_TO_ADD) if part)
    raise InputError(Problem(f"unknown robot {str(name)[:80]!r}", allowed=", ".join(names) or "none found", hint=hint))


def is_file(path: Path) -> bool:
    """Whether there is such a file; no name is too long to ask."""
    try:
        return path.is_file()
    except OSError:
        return False


def robot_titles() -> dict[str, str]:
    """Name and title of every robot on the search path. InputError where a robot.yaml has no title for a terminal."""
    documents = {name: read_yaml(find_robot(name)) for name in robot_names()}
    problems = [
        document.problem("title must be one line of text", "title")
        for document in documents.values()
        if not (isinstance(title := document.data.get("title"), str) and title.isprintable())
    ]
    if problems:
        raise InputError(problems)
    return {name: document.data["title"] for name, document in documents.items()}
