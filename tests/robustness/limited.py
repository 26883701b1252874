"""Run a function in a process of its own, with little memory and little time: what a bomb must not get past."""

from __future__ import annotations

import multiprocessing
import resource
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from qsframework.errors import InputError

MEGABYTE = 1_000_000


def _size() -> int:
    """Bytes of address space that this process has already."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def _child(function: Callable[[], Any], memory: int, out: Connection) -> None:
    resource.setrlimit(resource.RLIMIT_AS, (_size() + memory, _size() + memory))
    try:
        function()
        said = ("value", "")
    except InputError as error:
        said = ("refused", str(error))
    except BaseException:
        said = ("fault", traceback.format_exc(limit=-6))
    out.send(said)


def limited(function: Callable[[], Any], seconds: float = 20.0, megabytes: int = 400) -> str:
    """The words of the refusal, "" for a value. AssertionError for a fault, or where the limits do not suffice."""
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_child, args=(function, megabytes * MEGABYTE, there))
    process.start()
    there.close()
    try:
        assert here.poll(seconds), f"not done after {seconds} s"
        kind, words = here.recv()
    except EOFError:
        raise AssertionError("the process died") from None
    finally:
        process.kill()
        process.join()
    assert kind != "fault", words
    return words
