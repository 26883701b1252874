"""Run tasks: in this process, in several processes of this machine, or on a cluster.

A task is a pure function of a shared value and of its own small value; these and its result can be pickled. Which tasks
there are never depends on where they run, and linear algebra inside a task keeps to one thread: the results are the
same bits everywhere, also where workers are lost on the way.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass
from itertools import chain, islice
from typing import TypeVar

from qsframework.errors import InputError, QsfError
from qsframework.work.carry import pack, received, settled
from qsframework.work.threads import on_one_thread

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")
_AHEAD = 2
"""Tasks that are given out per worker."""


class WorkerLost(QsfError):
    """Workers ended before their work was done, and the work cannot go on."""


@dataclass(frozen=True)
class Work:
    """Where tasks run: in `jobs` processes of this machine (0: one per core; 1: this process), or on the Dask cluster
    at an address, as `tcp://10.0.0.5:8786`."""

    jobs: int = 1
    dask: str | None = None

    def __post_init__(self) -> None:
        if self.jobs < 0:
            raise InputError(f"jobs is a number of processes, 0 for one per core; found {self.jobs}")
        if self.dask is not None and self.jobs != 1:
            raise InputError("jobs is for this machine, dask for a cluster; give one of them")


HERE = Work()
"""In this process."""


def run(function: Callable[[S, T], R], shared: S, tasks: Iterable[T], work: Work = HERE) -> Generator[R, None, None]:
    """function(shared, task) of each task, in the order of the tasks, which are taken as they are needed."""
    left = iter(tasks)
    first = list(islice(left, 0 if work == HERE else 2))
    left = chain(first, left)
    if len(first) < 2:  # one task is not worth a process
        alone = on_one_thread(function)
        for task in left:
            yield settled(alone(shared, task))
        return
    from qsframework.work.workers import Cluster, Processes

    with Processes(work.jobs) if work.dask is None else Cluster(work.dask) as workers:
        carried = workers.carry(shared)
        given: deque[Callable[[], bytes]] = deque()
        while True:
            more = islice(left, _AHEAD * workers.count - len(given))
            given.extend(workers.give(function, carried, pack(task)) for task in more)
            if not given:
                return
            yield received(given.popleft()())
