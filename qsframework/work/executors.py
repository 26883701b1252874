"""Where tasks run: in this process, in processes of this machine, or (cluster.py) on a Dask cluster.

A task is a pure function of a shared value and of its own small value, both of which can be pickled. Which tasks there
are never depends on the executor, and linear algebra inside a task keeps to one thread: the results are the same bits
everywhere.
"""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Future
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import chain, islice
from queue import Empty
from typing import Any, Protocol, TypeVar

from qsframework.errors import InputError, QsfError
from qsframework.work.carry import at_worker, pack
from qsframework.work.threads import on_one_thread

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")
_LOOK = 1.0
"""s between two looks of a worker at whether it still has a master."""
_IDLE = 60
"""s after which a worker that has nothing to do ends."""
AHEAD = 2
"""Tasks that are given out beyond the one awaited, per worker."""


class Given(Protocol):
    """A task that was given out."""

    def cancel(self) -> Any:
        """It is not needed any more."""
        ...


F = TypeVar("F", bound=Given)


class WorkerLost(QsfError):
    """Workers ended before their work was done; what a checkpoint holds is not lost."""


class Executor(Protocol):
    """Runs tasks."""

    def map(self, function: Callable[[S, T], R], shared: S, tasks: Iterable[T]) -> Iterator[R]:
        """function(shared, task) of each task, in the order of the tasks; tasks are taken as they are needed."""
        ...

    def close(self) -> None:
        """Let go of the workers."""
        ...


@dataclass(frozen=True)
class InProcess:
    """One task after the other, here."""

    def map(self, function: Callable[[S, T], R], shared: S, tasks: Iterable[T]) -> Iterator[R]:
        """function(shared, task) of each task."""
        for task in tasks:
            yield on_one_thread(function)(shared, task)

    def close(self) -> None:
        """Nothing to let go of."""


@dataclass(frozen=True)
class Local:
    """`jobs` processes of this machine, by joblib's loky; 0: one per core."""

    jobs: int = 0

    def __post_init__(self) -> None:
        if self.jobs < 0:
            raise InputError(f"jobs is a number of processes, 0 for one per core; found {self.jobs}")

    def map(self, function: Callable[[S, T], R], shared: S, tasks: Iterable[T]) -> Iterator[R]:
        """function(shared, task) of each task; a single task is not worth a process."""
        left = iter(tasks)
        first = list(islice(left, 2))
        if len(first) < 2:
            yield from InProcess().map(function, shared, first)
            return
        workers, packed = self._workers(), pack(shared)
        count = self.jobs or cores()
        give = partial(workers.submit, at_worker, function, packed)
        try:
            yield from in_order(give, lambda future: future.result(), chain(first, left), AHEAD * count)
        except BrokenExecutor as error:
            raise WorkerLost(
                "a worker process ended before its work was done (killed, or out of memory?); take fewer jobs"
            ) from error

    def _workers(self) -> Any:
        from joblib.externals.loky import get_reusable_executor

        return get_reusable_executor(
            max_workers=self.jobs or cores(), timeout=_IDLE, initializer=_end_with, initargs=(os.getpid(),)
        )

    def close(self) -> None:
        """End the processes."""
        workers = self._workers()
        for waiting in list(workers._pending_work_items.values()):
            # loky tells each that it is not to be done, which one called back cannot hear
            if waiting.future.cancelled():
                waiting.future = Future()
        with suppress(Empty):  # and its thread would look for what it has let go of
            while True:
                workers._work_ids.get_nowait()
        workers.shutdown(wait=True, kill_workers=True)


def _end_with(parent: int) -> None:
    """In a worker: end when the process that started it is gone, however that ended."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_LOOK)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def cores() -> int:
    """Cores that this process may use."""
    from joblib import cpu_count

    return int(cpu_count())


def in_order(give: Callable[[T], F], await_: Callable[[F], R], tasks: Iterable[T], window: int) -> Iterator[R]:
    """Results in the order of the tasks, at most `window` of them given out; the rest is called back at the end."""
    given: deque[F] = deque()
    left = iter(tasks)
    try:
        while True:
            given.extend(give(task) for task in islice(left, window - len(given)))
            if not given:
                return
            yield await_(given.popleft())
    finally:
        for future in given:
            future.cancel()
