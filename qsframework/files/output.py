"""Files out: written whole or not at all."""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import re
import secrets
import stat
from pathlib import Path

from qsframework.errors import InputError, Problem

SUFFIX = ".qsf-part"
"""End of the name of a file that is being written: `.plan.csv.host.1234.5f3a91.qsf-part`, 1234 the process."""
_LONGEST = 100


def write_bytes(path: str | Path, content: bytes, mode: int | None = None) -> Path:
    """Write to a temporary file beside the target, then rename: never half a file, whatever ends the process.

    A file that is there keeps its mode; mode: that of a new one, where it is for its owner alone. What an earlier
    process of this machine left when it was killed is removed.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise InputError(Problem("cannot be written: this is no ordinary file", file=str(path)))
    temporary = path.parent / part_name(path.name)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        remove_stale(path)
        _fill(temporary, content, path.stat().st_mode if path.exists() else mode)
        os.replace(temporary, path)
        sync_folder(path.parent)
    except OSError as error:
        _remove(temporary)
        raise InputError(Problem(f"cannot be written: {error.strerror}", file=str(path))) from error
    except BaseException:
        _remove(temporary)
        raise
    return path


def write_text(path: str | Path, text: str, mode: int | None = None) -> Path:
    """Write UTF-8 text, all or nothing. mode: as of `write_bytes`"""
    return write_bytes(path, text.encode("utf-8"), mode)


def part_name(name: str) -> str:
    """A name beside a file or folder for what is being written; it says whose process writes it."""
    return f".{name[:_LONGEST]}.{_host()}.{os.getpid()}.{secrets.token_hex(3)}{SUFFIX}"


def remove_stale(path: Path) -> None:
    """Remove what processes of this machine that are no more left of a file or folder that they were writing."""
    import shutil

    start = f".{path.name[:_LONGEST]}.{_host()}."
    for entry in os.scandir(path.parent):
        found = _RUNNING.fullmatch(entry.name[len(start) :]) if entry.name.startswith(start) else None
        if found is not None and not _alive(int(found[1])):
            if entry.is_dir(follow_symlinks=False):
                shutil.rmtree(entry.path, ignore_errors=True)
            else:
                _remove(Path(entry.path))


_RUNNING = re.compile(rf"(\d+)\.[0-9a-f]{{6}}{re.escape(SUFFIX)}")


def _host() -> str:
    return re.sub(r"[^A-Za-z0-9-]", "-", platform.node())[:40] or "here"


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def _fill(temporary: Path, content: bytes, mode: int | None) -> None:
    """Write a new file. mode: that of the file whose place it takes, None for what new files have"""
    handle = os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666 if mode is None else 0o600)
    with os.fdopen(handle, "wb") as stream:
        if mode is not None:
            temporary.chmod(stat.S_IMODE(mode))
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())


def sync_folder(folder: Path) -> None:
    """Send the folder's new entry to the disk; some file systems cannot, and need not."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _remove(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink()


def sha256(path: str | Path) -> str:
    """Hash of a file's bytes."""
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
