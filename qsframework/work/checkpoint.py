"""A file that a long job writes its results to as they come, and goes on from after it was stopped.

The first line says which job it is; each further line is one result, with the hash of what it says. A line that a kill
or a full disk cut short does not match its hash, and is not read. No pickle: a checkpoint is a file that somebody else
may have written, and reading it runs nothing.
"""

from __future__ import annotations

import base64
import json
import os
import time
import zlib
from collections.abc import Mapping
from contextlib import AbstractContextManager, ExitStack, suppress
from pathlib import Path
from typing import Any, cast

import numpy as np

from qsframework.errors import InputError, Problem
from qsframework.files import write_text
from qsframework.files.plain import is_mapping
from qsframework.work.job import differences

FORMAT = "qsframework checkpoint 2"
_SYNC = 1.0
"""s between two times that the records are sent to the disk itself; a kill of the process loses none of them."""


class Checkpoint(AbstractContextManager["Checkpoint"]):
    """An open checkpoint: results by stage and number of the task. Use it with `with`; the file stays.

    job: what the results depend on, each part by its name; InputError, naming the parts that differ, where the file
    is another job's, and where another process is writing it.
    """

    def __init__(self, path: str | Path, job: Mapping[str, str]):
        import fcntl

        self.path, self.results, self._synced = Path(path), dict[tuple[str, int], Any](), time.monotonic()
        if not self.path.exists() or not self.path.stat().st_size:
            write_text(self.path, sealed({"format": FORMAT, "job": dict(job)}))
        with ExitStack() as stack:
            try:
                self._stream = stack.enter_context(self.path.open("r+b", buffering=0))
                fcntl.flock(self._stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                hint = "Wait for the other run, or give another file."
                raise self._refusal("this checkpoint is in use", hint) from error
            except OSError as error:
                raise self._refusal(f"cannot be written: {error.strerror}") from error
            self._read(job)
            stack.pop_all()
        self.loaded = len(self.results)
        """Results that were there at the start."""

    def _refusal(self, words: str, hint: str | None = None) -> InputError:
        return InputError(Problem(words, file=str(self.path), hint=hint))

    def _read(self, job: Mapping[str, str]) -> None:
        """Take what is whole, and cut off an end that is not."""
        lines = self._stream.readlines()
        head = _opened(lines[0]) if lines else {}
        if head.get("format") != FORMAT or not is_mapping(head.get("job")):
            raise self._refusal("this is no checkpoint of qsframework", "Give another file: nothing is overwritten.")
        if differ := differences(head["job"], job):
            hint = "Give another file, or delete this one to start anew."
            raise self._refusal(f"this checkpoint is of another job ({differ})", hint)
        for record in map(_opened, lines[1:]):
            if record:  # others are computed again
                self.results[str(record["stage"]), int(record["task"])] = record["result"]
        self._stream.seek(0 if lines[-1].endswith(b"\n") else -len(lines[-1]), os.SEEK_END)
        self._stream.truncate()

    def add(self, stage: str, task: int, result: Any) -> None:
        """Append a result; InputError where the disk takes no more, with all earlier results kept."""
        line = sealed({"stage": stage, "task": task, "result": result}).encode("utf-8")
        try:
            while line:
                line = line[self._stream.write(line) or 0 :]
            if time.monotonic() - self._synced > _SYNC:
                os.fsync(self._stream.fileno())
                self._synced = time.monotonic()
        except OSError as error:
            hint = "What it holds is kept: make room and run the same command again."
            raise self._refusal(f"cannot be written: {error.strerror}", hint) from error
        self.results[stage, task] = result

    def __exit__(self, *_: object) -> None:
        """Let go of the file."""
        self._stream.close()


def sealed(record: Mapping[str, Any]) -> str:
    """The line of a record. TypeError where its result is no data."""
    text = json.dumps(record, sort_keys=True, default=_plain)
    return f"{zlib.crc32(text.encode('utf-8')):08x} {text}\n"


def _opened(line: bytes) -> dict[str, Any]:
    """The record of a line; an empty one where the line is not as it was written."""
    seal, _, text = line.partition(b" ")
    if line.endswith(b"\n") and seal == b"%08x" % zlib.crc32(text.removesuffix(b"\n")):
        with suppress(ValueError, TypeError, KeyError):
            record = json.loads(text, object_hook=_array)
            return record if is_mapping(record) else {}
    return {}


def _plain(array: Any) -> dict[str, Any]:
    """An array as JSON has it, to the last bit."""
    if type(array) is not np.ndarray or cast(Any, array).dtype.kind not in "fiub":
        raise TypeError(f"a {type(array).__name__} cannot be written to a checkpoint")
    known: Any = array
    content = base64.b64encode(known.tobytes()).decode("ascii")
    return {"array": content, "dtype": known.dtype.str, "shape": known.shape}


def _array(plain: dict[str, Any]) -> Any:
    if "array" not in plain:
        return plain
    dtype = np.dtype(plain["dtype"])
    if dtype.kind not in "fiub":
        raise ValueError(f"an array of {dtype}")
    return np.frombuffer(base64.b64decode(plain["array"], validate=True), dtype).reshape(plain["shape"]).copy()
