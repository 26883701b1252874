"""Who does tasks when not this process: processes of this machine by joblib's loky, or the workers of a Dask cluster.

Both are executors of `concurrent.futures`. Here stands what is added: what happens where workers are lost.
"""

from __future__ import annotations

import asyncio
import logging
import os
import threading
import time
from collections.abc import Callable, Generator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from typing import Any

from qsframework.errors import InputError, QsfError, missing_extra
from qsframework.work.carry import Packed, at_worker, pack
from qsframework.work.run import WorkerLost
from qsframework.work.versions import versions

ANSWER = 15.0
"""s in which a scheduler has to answer, and a worker has to be there at the start."""
ALONE = 60.0
"""s without any worker after which the work on a cluster is given up."""
AGAIN = 20.0
"""s after which a task on a cluster is given a second time: it is the same whoever does it."""
_LOOK = 1.0
"""s between two looks of a worker at whether it still has a master, and of a master at whether it has workers."""
_IDLE = 60
"""s after which a process that has nothing to do ends."""
_AGAIN = 3
"""Processes that a task may lose."""
_SAFE = {"PYTHONSAFEPATH": "1"}
"""Environment of what is started here: `python -m` and `-c` would import what lies in the current folder."""


class Processes(AbstractContextManager["Processes"]):
    """`jobs` processes of this machine; 0: one per core. They wait for the next work, and end with this process."""

    def __init__(self, jobs: int):
        from joblib import cpu_count

        self.count = jobs or cpu_count()
        self._given: list[Future[bytes]] = []

    def carry(self, shared: Any) -> Packed:
        """A value, packed, as it goes with many tasks."""
        return Packed(pack(shared))

    def give(self, *call: Any) -> Callable[[], bytes]:
        """Give a call of `at_worker` to whichever process is free; what is returned waits for its result."""
        return partial(self._take, call, self._submit(call))

    def _submit(self, call: tuple[Any, ...]) -> Future[bytes]:
        self._given = [future for future in self._given if not future.done()]
        try:
            self._given.append(self._pool().submit(at_worker, *call))
        except BrokenExecutor as error:
            self._given.append(Future[bytes]())
            self._given[-1].set_exception(error)
        return self._given[-1]

    def _take(self, call: tuple[Any, ...], future: Future[bytes]) -> bytes:
        """The result; where a process ended, all tasks that were given out are lost, and run again in new processes."""
        for _ in range(_AGAIN):
            try:
                return future.result()
            except BrokenExecutor:
                future = self._submit(call)
        raise WorkerLost(
            f"{_AGAIN} worker processes ended before one task was done (killed, or out of memory?); take fewer jobs"
        )

    def _pool(self) -> Any:
        """Those that wait, or new ones."""
        from multiprocessing import resource_tracker as python
        from unittest.mock import patch

        from joblib.externals.loky import get_reusable_executor
        from joblib.externals.loky.backend import resource_tracker as loky

        with patch.dict(os.environ, _SAFE):
            for tracker in (python, loky):  # they clear up after the workers, and are started once
                tracker.ensure_running()
        return get_reusable_executor(
            self.count, timeout=_IDLE, env=_SAFE, initializer=_end_with, initargs=(os.getpid(),)
        )

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        """After an error no further task is begun; after an interruption nobody waits for those that were."""
        if kind is None or issubclass(kind, Exception | GeneratorExit):
            for future in self._given:
                future.cancel()
        else:
            pool = self._pool()
            try:
                pool.shutdown(kill_workers=True)
            except RuntimeError:  # it was stopped while it started, and loky cannot wait for what has not begun
                pool.shutdown(wait=False)


def _end_with(parent: int) -> None:
    """In a worker: end when the process that started it is gone, however that ended."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_LOOK)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class Cluster(AbstractContextManager["Cluster"]):
    """The Dask cluster at an address. A task whose worker is lost runs again on another one."""

    def __init__(self, address: str):
        self._address = address
        try:
            self.client = _client(address)
        except QsfError:
            raise
        except Exception as error:  # of the network, of the address, of a server that is no scheduler
            raise InputError(
                f"no Dask scheduler answers at {address} within {ANSWER:g} s. Start one with `dask scheduler` and give "
                "the address that it prints, for example tcp://10.0.0.5:8786"
            ) from error
        try:
            self.count, self._seen = self._ready(), time.monotonic()
        except BaseException:
            self.__exit__()
            raise
        self._pool: Executor = self.client.get_executor(pure=False)

    def _ready(self) -> int:
        """How many tasks run at once. InputError where there is no worker, or one without this qsframework."""
        end = time.monotonic() + ANSWER
        while not (count := self._threads()):
            if time.monotonic() > end:
                where = f"the Dask scheduler at {self._address}"
                raise InputError(f"{where} has no workers. Start some: dask worker {self._address}")
            time.sleep(0.1)
        # a task that a worker cannot read would end the worker, and another one after it
        for name, said in self._ask(self.client._run, versions, on_error="return").items():
            if isinstance(said, Exception) and not isinstance(said, OSError):  # those are lost, others may be there
                raise InputError(f"the worker {name} has another qsframework, or none ({said}); install it there")
        return count

    @contextmanager
    def _words(self) -> Generator[None, None, None]:
        """WorkerLost for all that a cluster may go through meanwhile."""
        try:
            yield
        except QsfError:
            raise
        except (Exception, asyncio.CancelledError) as error:
            if isinstance(error, OSError | CancelledError | asyncio.CancelledError) or self.client.status != "running":
                raise WorkerLost(f"the Dask scheduler at {self._address} is gone, or does not answer") from error
            raise WorkerLost(f"a task was lost on the Dask cluster at {self._address}: {error}") from error

    def _ask(self, what: Any, *args: Any, **given: Any) -> Any:
        with self._words():
            return self.client.sync(what, *args, callback_timeout=ANSWER, **given)

    def _threads(self) -> int:
        """What all workers together do at once."""
        workers = self._ask(self.client.scheduler.identity, n_workers=-1)["workers"]
        return sum(worker["nthreads"] for worker in workers.values())

    def carry(self, shared: Any) -> Any:
        """A task of its own: the cluster can make the value again where the workers that held it are lost."""
        self._packed = Packed(pack(shared), tuple(versions().items()))
        with self._words():
            return self.client.submit(Packed, self._packed.content, self._packed.versions, pure=False)

    def give(self, *call: Any) -> Callable[[], bytes]:
        """Give a call of `at_worker` to the scheduler; what is returned waits for its result."""
        with self._words():
            return partial(self._take, call, self._pool.submit(at_worker, *call))

    def _take(self, call: tuple[Any, ...], future: Future[bytes]) -> bytes:
        """The result. Where it does not come the task is given a second time, with the shared value in it: the
        scheduler may wait for ever for the value to be made again by a worker that has it, or is gone."""
        function, _, task = call
        given, again = {future}, time.monotonic() + AGAIN
        with self._words():
            while not (done := wait(given, timeout=_LOOK, return_when=FIRST_COMPLETED).done):
                self._look()
                if len(given) == 1 and time.monotonic() > again:
                    given.add(self._pool.submit(at_worker, function, self._packed, task))
            return done.pop().result()

    def _look(self) -> None:
        """WorkerLost where nobody works any more."""
        now = time.monotonic()
        self._seen = now if self._threads() else self._seen
        if now - self._seen > ALONE:
            raise WorkerLost(f"the Dask scheduler at {self._address} has had no workers for {ALONE:g} s")

    def __exit__(self, *_: object) -> None:
        """Leave the cluster; it goes on."""
        with suppress(Exception):  # it may be gone
            self.client.close(timeout=5)


def _client(address: str) -> Any:
    """A client of the scheduler at an address; some error of the network where there is none."""
    try:
        import distributed
    except ImportError as error:
        raise missing_extra("Dask needs the package distributed", "cluster") from error
    for name in (*logging.root.manager.loggerDict, "concurrent"):  # what is lost is said by us
        if name.split(".")[0] in ("distributed", "tornado", "asyncio", "concurrent"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    known: Any = distributed

    async def asked() -> None:  # a Client waits without end for a scheduler that hears and says nothing
        async with known.rpc(address) as scheduler:
            await asyncio.wait_for(scheduler.identity(n_workers=0), ANSWER)

    known.utils.LoopRunner(asynchronous=False).run_sync(asked)
    return known.Client(address, timeout=ANSWER, set_as_default=False)
