"""Run the tasks of a job: somewhere, with results kept as they come."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain
from typing import TypeVar

from qsframework.work.carry import settled
from qsframework.work.checkpoint import Checkpoint
from qsframework.work.executors import Executor, InProcess

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True)
class Work:
    """Where tasks run, and the file that keeps their results."""

    executor: Executor = field(default_factory=InProcess)
    checkpoint: Checkpoint | None = None

    def run(
        self, stage: str, function: Callable[[S, T], R], shared: S, tasks: Iterable[T], keep: bool = True
    ) -> Generator[R, None, None]:
        """function(shared, task) of each task, in the order of the tasks.

        stage: the name under which a checkpoint keeps the results; keep: False where they are sooner made than read
        """
        return run(function, shared, tasks, self.executor, self.checkpoint if keep else None, stage)


HERE = Work()
"""In this process, with nothing kept."""


def run(
    function: Callable[[S, T], R],
    shared: S,
    tasks: Iterable[T],
    executor: Executor | None = None,
    checkpoint: Checkpoint | None = None,
    stage: str = "",
) -> Generator[R, None, None]:
    """function(shared, task) of each task, in the order of the tasks, whatever the executor.

    Tasks whose results the checkpoint holds are not run again; every other result is written to it as it comes.
    """
    where = executor or InProcess()
    if checkpoint is None:
        yield from map(settled, where.map(function, shared, tasks))
        return
    left = iter(enumerate(tasks))
    for i, task in left:
        if not checkpoint.has(stage, i):
            yield from _run_rest(function, shared, chain([(i, task)], left), where, checkpoint, stage)
            return
        yield checkpoint.result(stage, i)


def _run_rest(
    function: Callable[[S, T], R],
    shared: S,
    tasks: Iterable[tuple[int, T]],
    where: Executor,
    checkpoint: Checkpoint,
    stage: str,
) -> Iterator[R]:
    """From the first task on that the checkpoint does not hold; it may hold later ones."""
    order: deque[int] = deque()

    def missing() -> Iterator[T]:
        for i, task in tasks:
            order.append(i)
            if not checkpoint.has(stage, i):
                yield task

    for result in map(settled, where.map(function, shared, missing())):
        while checkpoint.has(stage, order[0]):
            yield checkpoint.result(stage, order.popleft())
        checkpoint.add(stage, order[0], result)
        order.popleft()
        yield result
    while order:
        yield checkpoint.result(stage, order.popleft())
