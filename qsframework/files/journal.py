"""A file of records that grows record by record, and stays whole whatever ends the process that writes it.

The first line is a header that says whose records these are, with its `format`. Each line is JSON with a checksum
before it. No pickle: a journal is a file that somebody else may have written, and reading it runs nothing.
"""

from __future__ import annotations

import json
import os
import re
import time
import zlib
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, suppress
from pathlib import Path
from typing import Any

from qsframework.errors import InputError, Problem
from qsframework.files.output import sync_folder
from qsframework.files.plain import is_mapping


class Journal(AbstractContextManager["Journal"]):
    """An open journal, which nobody else can open meanwhile. Use it with `with`; the file stays.

    records: those that were there and those that were appended, in their order; spoilt: numbers of the lines that are
    not as they were written, which stay in the file and are no records. A last line that a kill cut short is cut off.
    wait: s to wait for another process; other: what to do where the file is another's. InputError where the file has
    another header, is in use, or cannot be written.
    """

    def __init__(self, path: str | Path, header: Mapping[str, Any], wait: float = 0.0, *, other: str | None = None):
        self.path, self.records, self.spoilt = Path(path), list[dict[str, Any]](), list[int]()
        if self.path.exists() and not self.path.is_file():
            raise self._refusal("cannot be written: this is no ordinary file")
        with ExitStack() as stack:
            try:
                handle = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o666)
                self._stream = stack.enter_context(os.fdopen(handle, "r+b", buffering=0))
                _lock(handle, time.monotonic() + wait)
            except BlockingIOError as error:
                hint = "Wait until the other process is done with it."
                raise self._refusal("another process is writing this file", hint) from error
            except OSError as error:
                raise self._refusal(f"cannot be written: {error.strerror}") from error
            self._read(header, other or "Give another file: nothing is overwritten.")
            stack.pop_all()

    def _refusal(self, words: str, hint: str | None = None) -> InputError:
        return InputError(Problem(words, file=str(self.path), hint=hint))

    def _read(self, header: Mapping[str, Any], other: str) -> None:
        """Take the records that are whole, and cut off an end that is not. An empty file gets its header."""
        content, first = self._stream.read(), _sealed(header)
        lines = [list(_records(line)) for line in content.split(b"\n")]
        every, wanted = [record for line in lines for record in line], _opened(first)
        if not every and not first.startswith(content):
            raise self._refusal("this is no journal of qsframework", other)
        if every and "format" in every[0] and every[0] != wanted:
            raise self._refusal(f"this is a journal of {_words(every[0])}, not of {_words(header)}", other)
        self.records = [record for record in every if record != wanted]
        self.spoilt = [number for number, line in enumerate(lines[:-1], start=1) if not line]
        if lines[-1]:  # whole but for its end of line
            self._write(b"\n")
        elif not content.endswith(b"\n"):
            self._cut(content.rfind(b"\n") + 1)
        if not every:
            self._write(first)
            sync_folder(self.path.parent)

    def append(self, record: Mapping[str, Any]) -> None:
        """Add a record, which is on the disk when this returns. TypeError where it is no data; InputError where the
        disk takes no more, with all earlier records kept and nothing of this one."""
        line = _sealed(record)
        self._write(line)
        self.records.append(_opened(line) or {})

    def _write(self, line: bytes) -> None:
        end = self._stream.seek(0, os.SEEK_END)
        try:
            left = line
            while left:
                left = left[self._stream.write(left) or 0 :]
            os.fsync(self._stream.fileno())
        except OSError as error:
            self._cut(end)
            hint = "All earlier records are kept: make room and try again."
            raise self._refusal(f"cannot be written: {error.strerror}", hint) from error

    def _cut(self, size: int) -> None:
        with suppress(OSError):  # what stays is cut off when the file is opened again
            self._stream.truncate(size)

    def __exit__(self, *_: object) -> None:
        """Let go of the file."""
        self._stream.close()


_SEAL = re.compile(rb"(?<=.)(?=[0-9a-f]{8} \{)")
"""Where a record begins within a line."""


def _sealed(record: Mapping[str, Any]) -> bytes:
    """The line of a record. TypeError where it is no data."""
    text = json.dumps(dict(record), sort_keys=True).encode("utf-8")
    return b"%08x %s\n" % (zlib.crc32(text), text)


def _lock(handle: int, end: float) -> None:
    """Lock a file. BlockingIOError where another process has not let go of it until then."""
    import fcntl

    while True:
        try:
            return fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() >= end:
                raise
            time.sleep(0.005)


def _records(line: bytes) -> Iterator[dict[str, Any]]:
    """The record of a line, or those on both sides of an end of line that was spoilt."""
    for part in _SEAL.split(line):
        found = [record for text in (part.rstrip(), part[:-1]) if (record := _opened(text)) is not None]
        yield from found[:1]


def _opened(line: bytes) -> dict[str, Any] | None:
    """The record of a line; None where the line is not as it was written."""
    seal, _, text = line.removesuffix(b"\n").partition(b" ")
    if seal == b"%08x" % zlib.crc32(text):
        with suppress(ValueError, RecursionError):
            record = json.loads(text)
            return record if is_mapping(record) else None
    return None


def _words(header: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {value}" for name, value in header.items()) or "nothing"
