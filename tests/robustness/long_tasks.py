"""Tasks for the tests of executors; other processes import them from here."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np

Shared = dict[str, Any]


def spectrum(shared: Shared, task: tuple[int, np.random.SeedSequence]) -> tuple[int, np.ndarray, float]:
    """Monte Carlo: singular values of a random matrix, whose bits depend on the order of every addition.

    killed: a file that the first worker of the fourth task makes before it is killed.
    """
    number, seed = task
    time.sleep(shared.get("sleep", 0.0))
    if number == 3 and "killed" in shared and not Path(shared["killed"]).exists():
        Path(shared["killed"]).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    A = np.random.default_rng(seed).standard_normal((shared["size"], shared["size"] // 2)) @ shared["mix"]
    return number, np.linalg.svd(A.T @ A, compute_uv=False), float(A.sum())


def shared(size: int = 120, **more: Any) -> Shared:
    """What all tasks look at."""
    return {"size": size, "mix": np.random.default_rng(7).standard_normal((size // 2, size // 2)), **more}


def tasks(count: int, seed: int = 0) -> list[tuple[int, np.random.SeedSequence]]:
    """Each task has a seed of its own, whoever does it."""
    return list(enumerate(np.random.SeedSequence(seed).spawn(count)))


def bits(results: Any) -> bytes:
    """The results, to the last bit."""
    return b"".join(np.int64(n).tobytes() + v.tobytes() + np.float64(s).tobytes() for n, v, s in results)


def die(fatal: int, task: int) -> int:
    """One task takes its worker with it."""
    if task == fatal:
        os._exit(1)
    return task


def refuse(shared: None, task: int) -> int:
    """A task that finds its input bad."""
    from qsframework.errors import InputError, Problem

    raise InputError([Problem("one", file="a.yaml", line=3), Problem("two")])


def too_late(shared: None, task: int) -> int:
    """A task whose own waiting ended."""
    raise TimeoutError("the task's own")


def whose(seconds: float, task: int) -> int:
    """The process that does the task."""
    time.sleep(seconds)
    return os.getpid()


def strides(shared: None, task: np.ndarray) -> list[int]:
    """How an array lies in memory where the task is done."""
    return list(task.strides)


def column(shared: np.ndarray, task: int) -> np.ndarray:
    """A result with gaps."""
    return shared[:, task]


class Odd(Exception):
    """An error that pickle cannot make again."""

    def __init__(self, one: str, two: str):
        super().__init__(f"{one} {two}")


def odd(shared: None, task: int) -> int:
    """A task with such an error."""
    raise Odd("cannot", "be sent")
