"""Where tasks run when not in this process: in processes of this machine, or on a Dask cluster.

Both are executors of `concurrent.futures`. Here stands what is added: what is said where workers are lost.
"""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import suppress
from queue import Empty
from typing import Any

from qsframework.errors import InputError, QsfError
from qsframework.work.carry import pack
from qsframework.work.job import versions

_LOOK = 1.0
"""s between two looks of a worker at whether it still has a master, and of a master at whether it has workers."""
_IDLE = 60
"""s after which a worker that has nothing to do ends."""


def _cancelled() -> type[BaseException]:
    """What an event loop ends a task with; asyncio is loaded where something was lost, or on a cluster."""
    from asyncio import CancelledError as Cancelled

    return Cancelled


class WorkerLost(QsfError):
    """Workers ended before their work was done; what a checkpoint holds is not lost."""


class Workers(Executor):
    """An executor whose workers may be lost. count: how many there are."""

    count: int

    def carry(self, shared: Any) -> Any:
        """A value, packed, as it goes with many tasks."""
        return pack(shared)

    def take(self, future: Future[Any]) -> Any:
        """The result of a task of `at_worker`; its own error, or in words that workers were lost."""
        try:
            while not wait([future], timeout=_LOOK).done:
                self._look()
            result, error = future.result()
        except (Exception, _cancelled()) as lost:
            raise self.lost(lost) from lost
        if error is not None:
            raise error
        return result

    def _look(self) -> None:
        """WorkerLost where nobody works any more."""

    def lost(self, error: BaseException) -> BaseException:
        """What an error says that is not a task's own."""
        words = "a worker process ended before its work was done (killed, or out of memory?); take fewer jobs"
        return WorkerLost(words) if isinstance(error, BrokenExecutor) else error


class Local(Workers):
    """`jobs` processes of this machine, by joblib's loky; 0: one per core."""

    def __init__(self, jobs: int = 0):
        from joblib import cpu_count

        if jobs < 0:
            raise InputError(f"jobs is a number of processes, 0 for one per core; found {jobs}")
        self.count = jobs or int(cpu_count())

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Give a call to whichever process is free."""
        return self._pool().submit(fn, *args, **kwargs)

    def _pool(self) -> Any:
        from joblib.externals.loky import get_reusable_executor

        return get_reusable_executor(self.count, timeout=_IDLE, initializer=_end_with, initargs=(os.getpid(),))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes."""
        pool = self._pool()
        for waiting in list(pool._pending_work_items.values()):
            # loky tells each that it is not to be done, which one called back cannot hear
            if waiting.future.cancelled():
                waiting.future = Future()
        with suppress(Empty):  # and its thread would look for what it has let go of
            while True:
                pool._work_ids.get_nowait()
        pool.shutdown(wait=wait, kill_workers=True)


def _end_with(parent: int) -> None:
    """In a worker: end when the process that started it is gone, however that ended."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_LOOK)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


class Dask(Workers):
    """The cluster at an address, as `tcp://10.0.0.5:8786`. A task whose worker is lost runs again on another one.

    answer: s in which the scheduler has to answer, and a worker has to be there at the start; alone: s after which a
    worker that is not heard of is given up, and the work where there is none at all.
    """

    def __init__(self, address: str, answer: float = 15.0, alone: float = 60.0):
        self.address, self.answer, self.alone = address, answer, alone
        self._heard: dict[str, tuple[float, float]] = {}
        try:
            import distributed
        except ImportError as error:
            raise InputError("Dask needs the package distributed: pip install 'qsframework[cluster]'") from error
        for name in (*logging.root.manager.loggerDict, "concurrent"):  # what is lost is said by us
            if name.split(".")[0] in ("distributed", "tornado", "asyncio", "concurrent"):
                logging.getLogger(name).setLevel(logging.CRITICAL + 1)
        known: Any = distributed
        import asyncio

        async def asked() -> None:  # a Client waits without end for a scheduler that hears and says nothing
            async with known.rpc(address) as scheduler:
                await asyncio.wait_for(scheduler.identity(n_workers=0), answer)

        try:
            known.utils.LoopRunner(asynchronous=False).run_sync(asked)
            self.client: Any = known.Client(address, timeout=answer, set_as_default=False)
        except Exception as error:  # of the network, of the address, of a server that is no scheduler
            raise InputError(
                f"no Dask scheduler answers at {address} within {answer:g} s. Start one with `dask scheduler` and give "
                "the address that it prints, for example tcp://10.0.0.5:8786"
            ) from error
        self._last, none = time.monotonic(), f"the Dask scheduler at {address} has no workers"
        try:
            while not (found := self._workers()):
                if time.monotonic() - self._last > answer:
                    raise InputError(f"{none}. Start some: dask worker {address}")
                time.sleep(0.1)
            # a task that a worker cannot read would end the worker, and another one after it
            for name, said in self._ask(self.client._run, versions, on_error="return").items():
                if isinstance(said, Exception) and not isinstance(said, OSError):  # those are lost, others may be there
                    raise InputError(f"the worker {name} has another qsframework, or none ({said}); install it there")
        except BaseException:
            self.shutdown()
            raise
        self.count = sum(worker["nthreads"] for worker in found.values())
        self._pool = self.client.get_executor(pure=False)

    def _ask(self, what: Any, *args: Any, **given: Any) -> Any:
        try:
            return self.client.sync(what, *args, callback_timeout=self.answer, **given)
        except Exception as error:
            raise WorkerLost(f"the Dask scheduler at {self.address} is gone, or does not answer") from error

    def _workers(self) -> dict[str, Any]:
        """The workers. One that the scheduler has not heard of for long is given up, so that others do its tasks."""
        found, now = self._ask(self.client.scheduler.identity, n_workers=-1)["workers"], time.monotonic()
        for name, worker in list(found.items()):
            if name not in self._heard or self._heard[name][0] != worker["last_seen"]:  # by the scheduler's clock
                self._heard[name] = worker["last_seen"], now
            elif now - self._heard[name][1] > self.alone:
                self._ask(self.client.scheduler.unregister, address=name, stimulus_id=f"qsframework-silent-{now}")
                del found[name]
        return found

    def _look(self) -> None:
        now = time.monotonic()
        self._last = now if self._workers() else self._last
        if now - self._last > self.alone:
            raise WorkerLost(f"the Dask scheduler at {self.address} has had no workers for {self.alone:g} s")

    def carry(self, shared: Any) -> Any:
        """A task of its own: the cluster can make the value again where the workers that held it are lost."""
        return self._given(self.client.submit, _same, pack(shared), pure=False)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Give a call to the scheduler."""
        return self._given(self._pool.submit, fn, *args, **kwargs)

    def _given(self, submit: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
        try:
            return submit(*args, **kwargs)
        except Exception as error:
            raise self.lost(error) from error

    def lost(self, error: BaseException) -> QsfError:
        """Words for what a cluster may go through."""
        if isinstance(error, QsfError):
            return error
        if isinstance(error, CancelledError | _cancelled()) or self.client.status != "running":
            return WorkerLost(f"the Dask scheduler at {self.address} is gone")
        what = "one worker after another ended" if type(error).__name__ == "KilledWorker" else "a task was lost"
        return WorkerLost(f"{what} on the Dask cluster at {self.address}: {error}")

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Leave the cluster; it goes on."""
        with suppress(Exception):  # it may be gone
            self.client.close(timeout=5)


def _same(value: Any) -> Any:
    return value
