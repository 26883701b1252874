"""A file that a long job writes its results to as they come, and goes on from after it was stopped.

The first line says which job it is; each further line is one result, with the hash of what it says. A line that a kill
or a full disk cut short does not match its hash, and is not read.
"""

from __future__ import annotations

import json
import os
import time
import zlib
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from qsframework.errors import InputError, Problem
from qsframework.files import write_text
from qsframework.files.plain import is_mapping
from qsframework.work.encode import decode, encode

FORMAT = "qsframework checkpoint 1"
_SYNC = 1.0
"""s between two times that the records are sent to the disk itself; a kill of the process loses none of them."""


class Checkpoint:
    """An open checkpoint: results by stage and number of the task. Use it with `with`.

    job: what the results depend on, each part by its name; InputError, naming the parts that differ, where the file
    is another job's, and where another process is writing it.
    """

    def __init__(self, path: str | Path, job: Mapping[str, str]):
        self.path = Path(path)
        self.job = dict(job)
        self.loaded = 0
        """Results that were there at the start."""
        self._results: dict[tuple[str, int], Any] = {}
        self._synced = time.monotonic()
        if not self.path.exists() or not self.path.stat().st_size:
            write_text(self.path, _sealed({"format": FORMAT, "job": self.job}))
        try:
            self._stream = self.path.open("r+b", buffering=0)
        except OSError as error:
            raise InputError(Problem(f"cannot be written: {error.strerror}", file=str(self.path))) from error
        try:
            self._lock()
            self._read()
        except BaseException:
            self._stream.close()
            raise

    def _lock(self) -> None:
        import fcntl

        try:
            fcntl.flock(self._stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            hint = "Wait for the other run, or give another file."
            raise InputError(Problem("this checkpoint is in use", file=str(self.path), hint=hint)) from error

    def _read(self) -> None:
        """Take what is whole, and cut off an end that is not."""
        lines = self._stream.readlines()
        self._check(_opened(lines[0]) if lines else None)
        for line in lines[1:]:
            record = _opened(line)
            if record is None:
                continue
            try:
                self._results[str(record["stage"]), int(record["task"])] = decode(record["result"])
            except (KeyError, TypeError, ValueError):
                continue
        self.loaded = len(self._results)
        torn = len(lines[-1]) if not lines[-1].endswith(b"\n") else 0
        self._stream.seek(-torn, os.SEEK_END)
        self._stream.truncate()

    def _check(self, head: dict[str, Any] | None) -> None:
        if head is None or head.get("format") != FORMAT or not isinstance(head.get("job"), dict):
            hint = "Give another file: nothing is overwritten."
            raise InputError(Problem("this is no checkpoint of qsframework", file=str(self.path), hint=hint))
        theirs = head["job"]
        differ = [
            f"{name}: {_short(theirs.get(name))} there, {_short(self.job.get(name))} here"
            for name in dict.fromkeys([*self.job, *theirs])
            if theirs.get(name) != self.job.get(name)
        ]
        if differ:
            hint = "Give another file, or delete this one to start anew."
            words = f"this checkpoint is of another job ({'; '.join(differ)})"
            raise InputError(Problem(words, file=str(self.path), hint=hint))

    def has(self, stage: str, task: int) -> bool:
        """Whether the result of a task is there."""
        return (stage, task) in self._results

    def result(self, stage: str, task: int) -> Any:
        """The result of a task."""
        return self._results[stage, task]

    def add(self, stage: str, task: int, result: Any) -> None:
        """Append a result; InputError where the disk takes no more, with all earlier results kept."""
        line = _sealed({"stage": stage, "task": task, "result": encode(result)}).encode("utf-8")
        try:
            written = 0
            while written < len(line):
                written += self._stream.write(line[written:]) or 0
            if time.monotonic() - self._synced > _SYNC:
                os.fsync(self._stream.fileno())
                self._synced = time.monotonic()
        except OSError as error:
            hint = "What it holds is kept: make room and run the same command again."
            raise InputError(Problem(f"cannot be written: {error.strerror}", file=str(self.path), hint=hint)) from error
        self._results[stage, task] = result

    def close(self) -> None:
        """Let go of the file, which stays: the same command finds its results there."""
        self._stream.close()

    def __enter__(self) -> Checkpoint:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _sealed(record: dict[str, Any]) -> str:
    text = json.dumps(record, sort_keys=True)
    return f"{zlib.crc32(text.encode('utf-8')):08x} {text}\n"


def _opened(line: bytes) -> dict[str, Any] | None:
    """The record of a line, or None where the line is not as it was written."""
    seal, _, text = line.removesuffix(b"\n").partition(b" ")
    if not line.endswith(b"\n") or seal != b"%08x" % zlib.crc32(text):
        return None
    try:
        record = json.loads(text)
    except ValueError:
        return None
    return record if is_mapping(record) else None


def _short(value: Any) -> str:
    if value is None:
        return "nothing"
    return str(value) if len(str(value)) <= 40 else f"{str(value)[:12]}..."
