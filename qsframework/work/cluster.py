"""Tasks on a Dask cluster: other machines, whose workers may come and go."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import CancelledError
from functools import partial
from typing import Any, TypeVar

from qsframework.errors import InputError
from qsframework.work.carry import Packed, at_worker, pack
from qsframework.work.executors import AHEAD, WorkerLost, in_order
from qsframework.work.job import versions

S = TypeVar("S")
T = TypeVar("T")
R = TypeVar("R")
_LOOK = 2.0
"""s between two looks at whether there still is a cluster."""


class Dask:
    """The cluster at an address, as `tcp://10.0.0.5:8786`. A task whose worker is lost runs again on another one.

    answer: s in which the scheduler has to answer and a worker has to be there; alone: s for which there may be no
    worker at all during the work. InputError where there is no Dask here, no answer, or other code on the workers.
    """

    def __init__(self, address: str, answer: float = 15.0, alone: float = 60.0):
        self.address, self.alone = address, alone
        try:
            from distributed import Client
        except ImportError as error:
            raise InputError("Dask needs the package distributed: pip install 'qsframework[cluster]'") from error
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # its words about lost workers are said by us
        try:
            self.client: Any = Client(address, timeout=answer, set_as_default=False)
        except (OSError, TimeoutError, ValueError, TypeError, ImportError) as error:
            raise InputError(
                f"no Dask scheduler answers at {address} within {answer:g} s. Start one with `dask scheduler` and give "
                "the address that it prints, for example tcp://10.0.0.5:8786"
            ) from error
        try:
            self._meet(answer)
        except BaseException:
            self.client.close(timeout=2)
            raise

    def _meet(self, answer: float) -> None:
        """Wait for a worker, and refuse workers that would compute something else."""
        try:
            self.client.wait_for_workers(1, timeout=answer)
        except TimeoutError as error:
            raise InputError(
                f"the Dask scheduler at {self.address} has no workers. Start some: dask worker {self.address}"
            ) from error
        try:
            found: Mapping[str, Mapping[str, str] | BaseException] = self.client.run(versions, on_error="return")
        except Exception as error:  # whatever a foreign worker's missing package raises
            raise InputError(f"the workers at {self.address} do not know qsframework: {error}") from error
        mine = versions()
        for worker, theirs in found.items():
            if not isinstance(theirs, Mapping):
                raise InputError(f"the worker {worker} cannot say its versions: {theirs!r}; install qsframework there")
            differ = [f"{k} {theirs.get(k, 'none')} there, {v} here" for k, v in mine.items() if theirs.get(k) != v]
            if differ:
                raise InputError(f"the worker {worker} would compute something else: {'; '.join(differ)}")

    def map(self, function: Callable[[S, T], R], shared: S, tasks: Iterable[T]) -> Iterator[R]:
        """function(shared, task) of each task."""
        packed = pack(shared)
        # by a task of its own the cluster can make the shared value again where the workers that held it are lost
        held = self.client.submit(_held, packed, key=f"qsframework-{packed.digest}", pure=True)
        give = partial(self.client.submit, at_worker, function, held, pure=False, retries=0)
        window = AHEAD * max(sum(self.client.nthreads().values()), 1)
        yield from in_order(give, self._await, tasks, window)

    def _await(self, future: Any) -> Any:
        last = time.monotonic()
        while True:
            try:
                return future.result(timeout=_LOOK)
            except TimeoutError:
                if future.status == "error":
                    raise  # the task's own; of a finished one the result may still be on its way, or lost with a worker
            except CancelledError as error:
                raise WorkerLost(f"the Dask scheduler at {self.address} is gone") from error
            except Exception as error:
                if type(error).__name__ == "KilledWorker":
                    raise WorkerLost(f"a task ended one Dask worker after another: {error}") from error
                raise
            if self.client.status != "running":
                raise WorkerLost(f"the Dask scheduler at {self.address} is gone")
            last = time.monotonic() if self._workers() else last
            if time.monotonic() - last > self.alone:
                raise WorkerLost(f"the Dask scheduler at {self.address} has had no workers for {self.alone:g} s")

    def _workers(self) -> int:
        return len(self.client.scheduler_info(n_workers=-1)["workers"])

    def close(self) -> None:
        """Leave the cluster; it goes on."""
        self.client.close(timeout=5)


def _held(packed: Packed) -> Packed:
    return packed
