"""Run a function in a process of its own, with little memory and little time: what a bomb must not get past."""

from __future__ import annotations

import math
import multiprocessing
import resource
import traceback
from collections.abc import Callable
from importlib import import_module
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from qsframework.errors import InputError

MEGABYTE = 1_000_000
HANGS = 600.0
"""Seconds after which something hangs, however busy the machine."""


def _size() -> int:
    """Bytes of address space that this process has already."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def _child(function: Callable[[], Any], seconds: float, memory: int, out: Connection) -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (math.ceil(seconds), math.ceil(seconds)))
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
    """The words of the refusal, "" for a value. AssertionError for a fault, or where the limits do not suffice: seconds
    are those of the processor, which a busy machine does not use up."""
    import_module("pinocchio")  # loaded once, whatever is read: no part of what is limited
    context = multiprocessing.get_context("fork")
    here, there = context.Pipe(duplex=False)
    process = context.Process(target=_child, args=(function, seconds, megabytes * MEGABYTE, there))
    process.start()
    there.close()
    try:
        assert here.poll(HANGS), "it waits for something"
        kind, words = here.recv()
    except EOFError:
        raise AssertionError(f"the process died, or took more than {seconds} s of CPU") from None
    finally:
        process.kill()
        process.join()
    assert kind != "fault", words
    return words
