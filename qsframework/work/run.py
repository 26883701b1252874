"""Run the tasks of a job: somewhere, with results kept as they come.

A task is a pure function of a shared value and of its own small value, both of which can be pickled. Which tasks there
are never depends on the executor, and linear algebra inside a task keeps to one thread: the results are the same bits
everywhere.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial
from itertools import chain, islice
from typing import Any, TypeVar

from qsframework.work.carry import at_worker, settled
from qsframework.work.checkpoint import Checkpoint
from qsframework.work.executors import Workers
from qsframework.work.threads import on_one_thread

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")
_AHEAD = 2
"""Tasks that are given out per worker."""


@dataclass(frozen=True)
class Work:
    """Where tasks run, in this process where nothing is named, and the file that keeps their results."""

    executor: Workers | None = None
    checkpoint: Checkpoint | None = None

    def run(
        self, stage: str, function: Callable[[S, T], R], shared: S, tasks: Iterable[T], keep: bool = True
    ) -> Generator[R, None, None]:
        """As `run`. stage: their name in a checkpoint; keep: False where they are sooner made than read."""
        return run(function, shared, tasks, self.executor, self.checkpoint if keep else None, stage)


HERE = Work()
"""In this process, with nothing kept."""


def run(
    function: Callable[[S, T], R],
    shared: S,
    tasks: Iterable[T],
    executor: Workers | None = None,
    checkpoint: Checkpoint | None = None,
    stage: str = "",
) -> Generator[R, None, None]:
    """function(shared, task) of each task, in the order of the tasks, which are taken as they are needed.

    Tasks whose results the checkpoint holds are not run again; every other result is written to it as it comes.
    """
    left = enumerate(tasks)
    first = list(islice(left, 2 if executor else 0))
    if len(first) < 2:  # not worth a process
        executor = None
    window = _AHEAD * executor.count if executor else 1
    carried = executor.carry(shared) if executor else None
    futures: deque[Future[Any]] = deque(maxlen=window)

    def give(task: T) -> Callable[[], Any]:
        if executor is None:
            return partial(on_one_thread(function), shared, task)
        futures.append(executor.submit(at_worker, function, carried, task))
        return partial(executor.take, futures[-1])

    kept = {} if checkpoint is None else checkpoint.results
    given: deque[tuple[int, Callable[[], Any]]] = deque()
    left = chain(first, left)
    try:
        while True:
            for i, task in islice(left, window - len(given)):
                given.append((i, partial(kept.get, (stage, i)) if (stage, i) in kept else give(task)))
            if not given:
                return
            i, take = given.popleft()
            result = settled(take())
            if checkpoint is not None and (stage, i) not in kept:
                checkpoint.add(stage, i, result)
            yield result
    finally:
        for future in futures:
            future.cancel()
