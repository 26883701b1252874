"""Where the packages are that a robot's files name: `$(find NAME)`, `package://NAME/...`.

Sought are the packages that the user named and those beside them, the folder of the file with what is in it, and, for a
file that somebody else wrote, the package that holds the file and the packages beside it. That is the nearest folder
with a package.xml, three levels up at most; where there is none, the folder above one that is called as packages call
that of their robots. Nothing above these is looked at.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path

from qsframework.errors import InputError
from qsframework.files import read_text

_NAME = re.compile(r"\w[\w.-]*")
_TITLE = re.compile(r"<name>\s*([^<\s]+)\s*</name>")
_FILE = "package.xml"
_WITHIN = ("urdf", "xacro", "robots", "model", "models", "description")
"""Folders of a package in which its robots are."""
_UP, _DOWN, _MOST = 3, 3, 500
"""Levels from a file to its package, levels and folders below one that are looked into."""
_MANIFEST = 100_000


@dataclass(frozen=True)
class Sources:
    """What a robot of somebody else's asks for besides its own folder: packages and $(arg NAME).

    nearby: packages are also sought in the package that holds the file, and beside it. Files are read from the robot's
    folder, from the package that holds it and from packages that were asked for, and from nowhere else.
    """

    packages: Mapping[str, Path] = field(default_factory=dict[str, Path])
    arguments: Mapping[str, str] = field(default_factory=dict[str, str])
    nearby: bool = False

    @property
    def argument(self) -> tuple[str, str] | None:
        """What says where a package is, for a problem; None for a robot of one's own, which has only its folder."""
        return ("package", "NAME=FOLDER") if self.nearby else None

    def find(self, package: str, folder: Path) -> Path | None:
        """The folder of a package that is asked for by a file in `folder`; None where there is none, or no name."""
        if _NAME.fullmatch(package) is None:
            return None
        if package in self.packages:
            return self.packages[package]
        home = self.home(folder)
        if package in (home.name, _title(home)):
            return home
        if (folder / package).is_dir():
            return folder / package
        below = (found for found in islice(_below(home), _MOST) if package in (found.name, _title(found)))
        return next(chain(below, self._beside(package, home)), None)

    def home(self, folder: Path) -> Path:
        """The package that holds a folder: the folder itself for a robot of one's own, and where there is none."""
        around = [folder.resolve(), *folder.resolve().parents][: _UP + 1] if self.nearby else []
        stripped = around[1] if around and around[0].name in _WITHIN else folder
        return next((here for here in around if (here / _FILE).is_file()), stripped)

    def _beside(self, package: str, home: Path) -> Iterator[Path]:
        """Packages beside the one that holds the file, and beside those that were named."""
        around = _folders(home.parent) if self.nearby and (home / _FILE).is_file() else []
        own = (found for found in around if (found / _FILE).is_file())
        named = (found for one in self.packages.values() for found in _folders(one.resolve().parent))
        yield from (found for found in chain(own, named) if package in (found.name, _title(found)))


def inside(path: Path, folder: Path) -> bool:
    """Whether a path, links followed, stays in the folder."""
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, ValueError, RuntimeError):  # no path at all, or links in a circle
        return False


def _title(folder: Path) -> str | None:
    """The name that a folder's package.xml states."""
    try:
        found = _TITLE.search(read_text(folder / _FILE, _MANIFEST)) if (folder / _FILE).is_file() else None
    except InputError:
        return None
    return found.group(1) if found else None


def _below(folder: Path) -> Iterator[Path]:
    """The folders in a folder, the nearest first."""
    level = [folder]
    for _ in range(_DOWN):
        level = [below for upper in level for below in _folders(upper)]
        yield from level


def _folders(folder: Path) -> list[Path]:
    try:
        return sorted(p for p in folder.iterdir() if not p.name.startswith(".") and p.is_dir() and not p.is_symlink())
    except OSError:
        return []
