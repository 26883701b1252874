"""The same bits from every executor; lost workers."""

from __future__ import annotations

import itertools
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from long_tasks import bits, die, refuse, shared, spectrum, tasks, too_late, whose

from qsframework.design import Wish, design
from qsframework.errors import InputError
from qsframework.experiment import Experiment
from qsframework.work import Dask, InProcess, Local, Work, WorkerLost, run
from qsframework.work.carry import pack, unpack

HERE = Path(__file__).resolve().parent
COUNT = 12


@pytest.fixture(scope="module")
def wanted() -> bytes:
    return bits(run(spectrum, shared(), tasks(COUNT)))


@pytest.fixture(scope="module")
def local() -> Iterator[Local]:
    executor = Local(2)
    yield executor
    executor.close()


def test_seeds_make_the_tasks_differ(wanted: bytes) -> None:
    assert bits(run(spectrum, shared(), tasks(COUNT, seed=1))) != wanted
    assert len({v.tobytes() for _, v, _ in run(spectrum, shared(), tasks(COUNT))}) == COUNT


def test_local_gives_the_same_bits(local: Local, wanted: bytes) -> None:
    assert bits(run(spectrum, shared(), tasks(COUNT), local)) == wanted


def test_arrays_with_gaps_lie_the_same_in_a_worker() -> None:
    """Sums over memory with gaps differ in their last bits from sums over the same numbers without."""
    wide = np.random.default_rng(0).standard_normal((200, 7))
    column, block, turned = unpack(pack((wide[:, 3], wide[::2, 1:6:2], wide.T)))
    for made, given in ((column, wide[:, 3]), (block, wide[::2, 1:6:2]), (turned, wide.T)):
        assert made.strides == given.strides
        assert np.array_equal(made, given)
    (back,) = InProcess().map(lambda shared, task: shared[:, task], wide, [2])
    assert not back.flags.forc
    assert next(run(lambda shared, task: shared[:, task], wide, [2])).flags.forc


def test_tasks_are_taken_only_as_they_are_needed(local: Local) -> None:
    taken: list[int] = []

    def endless() -> Iterator[tuple[int, np.random.SeedSequence]]:
        for task in itertools.count():
            taken.append(task)
            yield tasks(1)[0]

    results = run(spectrum, shared(20), endless(), local)
    for _ in range(3):
        next(results)
    results.close()  # type: ignore[attr-defined]
    assert len(taken) <= 3 + 2 * 2


def test_workers_with_tasks_that_were_called_back_end_without_a_word(wanted: bytes) -> None:
    """loky's thread once died of the first such task, with a traceback, and the processes lived on."""
    local = Local(2)
    given = [local._workers().submit(whose, 0.2, task) for task in range(30)]
    assert all(future.cancel() for future in given[15:])
    local.close()
    assert bits(run(spectrum, shared(), tasks(COUNT), local)) == wanted
    local.close()


def test_a_task_s_error_arrives_as_it_was_raised(local: Local) -> None:
    with pytest.raises(InputError) as caught:
        list(run(refuse, None, range(4), local))
    assert [p.line for p in caught.value.problems] == [3, None]


def test_a_lost_process_is_said_and_the_next_job_runs(local: Local, wanted: bytes) -> None:
    with pytest.raises(WorkerLost, match="worker process ended"):
        list(run(die, 3, range(8), local))
    assert bits(run(spectrum, shared(), tasks(COUNT), local)) == wanted


MASTER = """
from long_tasks import whose
from qsframework.work import Local, run
if __name__ == "__main__":
    for worker in run(whose, 0.1, range(10000), Local(2)):
        print(worker, flush=True)
"""


def test_processes_end_with_a_killed_master(tmp_path: Path) -> None:
    script = tmp_path / "master.py"
    script.write_text(MASTER)
    environment = os.environ | {"PYTHONPATH": str(HERE)}
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True, env=environment) as master:
        assert master.stdout is not None
        workers = {int(master.stdout.readline()) for _ in range(6)}
        master.kill()
        master.wait(timeout=10)
        assert workers
        assert master.pid not in workers
        end = time.monotonic() + 20
        while any(Path(f"/proc/{worker}").exists() for worker in workers):
            assert time.monotonic() < end, "workers without a master go on"
            time.sleep(0.1)


def test_one_thread_of_linear_algebra_inside_a_task() -> None:
    from threadpoolctl import threadpool_info, threadpool_limits

    def threads(_: None, task: int) -> list[int]:
        import scipy.linalg  # noqa: F401 - brings a second OpenBLAS where it was not loaded yet

        return [lib["num_threads"] for lib in threadpool_info() if lib["user_api"] == "blas"]

    with threadpool_limits(2):
        inside = list(InProcess().map(threads, None, range(2)))[1]
        outside = threads(None, 0)
    assert set(inside) == {1}
    assert max(outside) == min(2, os.cpu_count() or 1)


# ---------------------------------------------------------------- a cluster


@dataclass
class Cluster:
    """A scheduler and its workers, in processes of their own."""

    address: str
    workers: list[subprocess.Popen[bytes]]


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


def started(folder: Path, *command: str) -> subprocess.Popen[bytes]:
    environment = os.environ | {"PYTHONPATH": str(HERE), "OPENBLAS_NUM_THREADS": "1"}
    with open(os.devnull, "w") as nowhere:
        return subprocess.Popen(
            [sys.executable, "-m", "dask", *command], stdout=nowhere, stderr=nowhere, cwd=folder, env=environment
        )


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    """A scheduler and two workers on this machine, which end with the test whatever happens."""
    address = f"tcp://127.0.0.1:{free_port()}"
    port = address.rsplit(":", 1)[1]
    processes = [started(tmp_path, "scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard", "--no-show")]
    worker = (
        "worker",
        address,
        "--host",
        "127.0.0.1",
        "--nthreads",
        "1",
        "--no-nanny",
        "--no-dashboard",
        "--memory-limit",
        "0",
        "--death-timeout",
        "90",
        "--local-directory",
        str(tmp_path),
    )
    try:
        processes += [started(tmp_path, *worker, "--name", f"w{k}") for k in range(2)]
        yield Cluster(address, processes[1:])
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.wait(timeout=10)


def wait_for_workers(dask: Dask, count: int, limit: float = 90.0) -> None:
    end = time.monotonic() + limit
    while len(dask.client.nthreads()) != count:
        assert time.monotonic() < end, f"{len(dask.client.nthreads())} workers, {count} expected"
        time.sleep(0.1)


def test_dask_gives_the_same_bits_though_a_worker_is_killed(
    cluster: Cluster, wanted: bytes, m900ib: Experiment
) -> None:
    dask = Dask(cluster.address, answer=60.0)
    try:
        wait_for_workers(dask, 2)
        wish = Wish(polish=False, starts=4)
        plans = [design(m900ib, 9, candidates=100, wish=wish, work=work) for work in (Work(), Work(dask))]
        assert plans[0].pendant.tobytes() == plans[1].pendant.tobytes()
        results = []
        for result in run(spectrum, shared(sleep=0.15), tasks(COUNT), dask):
            results.append(result)
            if len(results) == 2:
                cluster.workers[0].send_signal(signal.SIGKILL)
        assert cluster.workers[0].wait(timeout=5) == -signal.SIGKILL
        wait_for_workers(dask, 1)
        assert bits(results) == wanted
        with pytest.raises(InputError) as caught:
            list(run(refuse, None, range(2), dask))
        assert [p.line for p in caught.value.problems] == [3, None]
        dask.alone = 3.0
        cluster.workers[1].send_signal(signal.SIGKILL)
        with pytest.raises(WorkerLost, match="no workers"):
            list(run(spectrum, shared(), tasks(2), dask))
    finally:
        dask.close()


def test_a_result_that_is_slow_to_come_is_waited_for(
    cluster: Cluster, wanted: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A task was done when its worker was killed: its result did not come in time, and once ended the whole run."""
    from distributed import Future

    dask = Dask(cluster.address, answer=60.0)
    given, slow = Future.result, iter([True, True])

    def result(future: Future, timeout: float | None = None) -> object:
        if next(slow, False):
            while not future.done():
                time.sleep(0.01)
            raise TimeoutError
        return given(future, timeout)

    try:
        monkeypatch.setattr(Future, "result", result)
        assert bits(run(spectrum, shared(), tasks(COUNT), dask)) == wanted
        assert next(slow, None) is None
        with pytest.raises(TimeoutError, match="the task's own"):
            list(run(too_late, None, range(2), dask))
    finally:
        dask.close()


def test_no_scheduler_is_said() -> None:
    start = time.monotonic()
    with pytest.raises(InputError, match="dask scheduler"):
        Dask(f"tcp://127.0.0.1:{free_port()}", answer=1.0)
    with pytest.raises(InputError, match="dask scheduler"):
        Dask("no address", answer=1.0)
    assert time.monotonic() - start < 15


def test_without_dask_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"qsframework\[cluster\]"):
        Dask("tcp://127.0.0.1:1")
