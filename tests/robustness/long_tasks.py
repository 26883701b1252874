"""Tasks for the tests of executors and checkpoints; other processes import them from here."""

from __future__ import annotations

import os
import time
from typing import Any

import numpy as np

Shared = dict[str, Any]


def spectrum(shared: Shared, task: tuple[int, np.random.SeedSequence]) -> tuple[int, np.ndarray, float]:
    """Monte Carlo: singular values of a random matrix, whose bits depend on the order of every addition."""
    number, seed = task
    time.sleep(shared.get("sleep", 0.0))
    if "calls" in shared:
        with open(shared["calls"], "a") as file:
            file.write(f"{number}\n")
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
