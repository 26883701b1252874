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
    """The robot.yaml of a path or a name: in the folder `beside` (by default the current one), else on the search path,
    else in the current folder.

    InputError offers the nearest name and says how to add a robot.
    """
    near = Path() if beside is None else beside
    places = (_in_folder(near / name), on_search_path(str(name)), _in_folder(Path(name)))
    if (place := next(filter(None, places), None)) is not None:
        return place
    names = robot_names()
    hint = " ".join(part for part in (nearest(str(name), names), _HOW_TO_ADD) if part)
    raise InputError(Problem(f"unknown robot {str(name)[:80]!r}", allowed=", ".join(names) or "none found", hint=hint))


def _in_folder(path: Path) -> Path | None:
    """The robot.yaml of a folder, or the file itself."""
    if is_file(path / "robot.yaml"):
        return path / "robot.yaml"
    return path if path.suffix in (".yaml", ".yml") and is_file(path) else None


def on_search_path(name: str) -> Path | None:
    """The robot.yaml of a name on the search path."""
    paths = (folder / name / "robot.yaml" for folder in search_path() if ROBOT_NAME.fullmatch(name))
    return next(filter(is_file, paths), None)


def shadows(folder: Path) -> str:
    """What to say of a robot's folder that is read in place of one of its name on the search path; else nothing."""
    other = on_search_path(folder.resolve().name)
    if other is None or other.parent.resolve() == folder.resolve():
        return ""
    return f"the folder {folder} is read, not the robot {folder.resolve().name} of {other.parent.parent}"


def is_file(path: Path) -> bool:
    """Whether there is such a file; no name is too long to ask."""
    try:
        return path.is_file()
    except OSError:
        return False


def robot_titles() -> dict[str, str]:
    """Name and title of every robot on the search path. InputError where a robot.yaml has no title for a terminal."""
    found = ((name, on_search_path(name)) for name in robot_names())
    documents = {name: read_yaml(path) for name, path in found if path is not None}
    problems = [
        document.problem("title must be one line of text", "title")
        for document in documents.values()
        if not (isinstance(title := document.data.get("title"), str) and title.isprintable())
    ]
    if problems:
        raise InputError(problems)
    return {name: document.data["title"] for name, document in documents.items()}
