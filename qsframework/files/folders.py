"""A folder of files out: all of them or none, and an earlier folder whole until the new one takes its place."""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path

from qsframework.errors import InputError, Problem
from qsframework.files.output import part_name, remove_stale, write_bytes

_HERE, _EXCHANGE = -100, 2
"""AT_FDCWD and RENAME_EXCHANGE of renameat2."""


def write_folder(
    folder: str | Path,
    contents: Mapping[str, str] | Mapping[Path, str | bytes],
    check: Callable[[Path], object] | None = None,
) -> tuple[Path, ...]:
    """Write files, by their names inside the folder, beside their place; check them there; then move them in.

    What stood at the folder's place goes. InputError where it cannot be written; what `check` raises leaves everything
    as it was.
    """
    folder = Path(folder)
    target = folder.resolve()
    made = target.parent / part_name(target.name)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        remove_stale(target)
        made.mkdir()
        for name, content in contents.items():
            write_bytes(made / name, content.encode("utf-8") if isinstance(content, str) else content)
        if check is not None:
            check(made)
        _swap(made, target)
    except OSError as error:
        raise InputError(Problem(f"cannot be written: {error.strerror}", file=str(folder))) from error
    finally:
        _gone(made)
    return tuple(folder / name for name in contents)


def _gone(made: Path) -> None:
    """Remove what is left beside the target, even where a signal comes meanwhile."""
    try:
        shutil.rmtree(made, ignore_errors=True)
    except BaseException:
        shutil.rmtree(made, ignore_errors=True)
        raise


def _swap(made: Path, target: Path) -> None:
    """The made folder takes the place of the target, which takes the place of the made one, in one step if it can."""
    if not target.exists():
        os.replace(made, target)
        return
    if _exchanged(made, target):
        return
    old = target.parent / part_name(target.name)
    os.replace(target, old)
    try:
        os.replace(made, target)
    except BaseException:
        os.replace(old, target)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _exchanged(one: Path, two: Path) -> bool:
    """Whether the system could exchange the two; old file systems cannot."""
    with contextlib.suppress(OSError, AttributeError):
        exchange = ctypes.CDLL(None, use_errno=True).renameat2
        return exchange(_HERE, os.fsencode(one), _HERE, os.fsencode(two), _EXCHANGE) == 0
    return False
