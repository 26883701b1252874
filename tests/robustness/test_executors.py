"""The same bits from every executor; lost workers."""

from __future__ import annotations

import itertools
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from long_tasks import bits, die, refuse, shared, spectrum, tasks, too_late, whose

from qsframework.design import Wish, design
from qsframework.errors import InputError
from qsframework.experiment import Experiment
from qsframework.work import Dask, Local, Work, WorkerLost, run
from qsframework.work.carry import pack, unpack

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
COUNT = 12


@pytest.fixture(scope="module")
def wanted() -> bytes:
    return bits(run(spectrum, shared(), tasks(COUNT)))


@pytest.fixture(scope="module")
def local() -> Iterator[Local]:
    executor = Local(2)
    yield executor
    executor.shutdown()


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
    given = [local.submit(whose, 0.2, task) for task in range(30)]
    assert all(future.cancel() for future in given[15:])
    local.shutdown()
    assert bits(run(spectrum, shared(), tasks(COUNT), local)) == wanted
    local.shutdown()


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
        inside = list(run(threads, None, range(2)))[1]
        outside = threads(None, 0)
    assert set(inside) == {1}
    assert max(outside) == min(2, os.cpu_count() or 1)


# ---------------------------------------------------------------- a cluster


@dataclass
class Cluster:
    """A scheduler and its workers, in processes of their own."""

    address: str
    scheduler: subprocess.Popen[bytes]
    workers: list[subprocess.Popen[bytes]]


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


def started(folder: Path, path: str, *command: str) -> subprocess.Popen[bytes]:
    environment = os.environ | {"PYTHONPATH": path, "OPENBLAS_NUM_THREADS": "1"}
    whole = [sys.executable, "-m", "dask", *command, "--host", "127.0.0.1", "--no-dashboard"]
    return subprocess.Popen(whole, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=folder, env=environment)


@contextmanager
def clustered(folder: Path, workers: int = 2, path: str = str(HERE)) -> Iterator[Cluster]:
    """A scheduler and workers on this machine, which end with the test whatever happens."""
    address = f"tcp://127.0.0.1:{free_port()}"
    end = f"--nthreads 1 --no-nanny --memory-limit 0 --death-timeout 90 --local-directory {folder}".split()
    processes = [started(folder, str(HERE), "scheduler", "--port", address.rsplit(":", 1)[1], "--no-show")]
    try:
        processes += [started(folder, path, "worker", address, *end, "--name", f"w{k}") for k in range(workers)]
        yield Cluster(address, processes[0], processes[1:])
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.wait(timeout=10)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    with clustered(tmp_path) as cluster:
        yield cluster


@pytest.fixture
def lone(tmp_path: Path) -> Iterator[Cluster]:
    """A cluster of one worker."""
    with clustered(tmp_path, workers=1) as cluster:
        yield cluster


def wait_for_workers(dask: Dask, count: int, limit: float = 90.0) -> None:
    end = time.monotonic() + limit
    while len(dask.client.nthreads()) != count:
        assert time.monotonic() < end, f"{len(dask.client.nthreads())} workers, {count} expected"
        time.sleep(0.1)


def wait_for_the_cluster(cluster: Cluster) -> None:
    """It is up, with all its workers."""
    dask = Dask(cluster.address, answer=90.0)
    try:
        wait_for_workers(dask, len(cluster.workers))
    finally:
        dask.shutdown()


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
        dask.shutdown()


def test_a_worker_that_stops_answering_is_given_up(cluster: Cluster, wanted: bytes) -> None:
    """A partition: its connections stay open, its tasks and what it holds never come."""
    dask = Dask(cluster.address, answer=60.0)
    frozen: subprocess.Popen[bytes] | None = None
    try:
        wait_for_workers(dask, 2)
        dask.alone, results = 2.0, []
        for result in run(spectrum, shared(sleep=0.1), tasks(COUNT), dask):
            results.append(result)
            if frozen is None:  # the one that holds the value which all tasks share
                holds = next(w for w, keys in dask.client.has_what().items() if any("_same" in str(k) for k in keys))
                frozen = cluster.workers[int(dask.client.scheduler_info()["workers"][holds]["name"][1:])]
                frozen.send_signal(signal.SIGSTOP)
        assert bits(results) == wanted
        with pytest.raises(TimeoutError, match="the task's own"):
            list(run(too_late, None, range(2), dask))
    finally:
        dask.shutdown()


CLIENT = """
import sys
from long_tasks import shared, spectrum, tasks
from qsframework.errors import QsfError
from qsframework.work import Dask, run
if __name__ == "__main__":
    try:
        with Dask(sys.argv[1], answer=2.0, alone=3.0) as dask:
            for number, *_ in run(spectrum, shared(20, sleep=0.2), tasks(1000), dask):
                print(number, flush=True)
    except QsfError as error:
        print("error:", error, file=sys.stderr)
        sys.exit(2)
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_scheduler_lost_at_work_is_one_sentence(lone: Cluster, tmp_path: Path, number: signal.Signals) -> None:
    """Nothing of distributed's own is printed, not even while Python ends."""
    wait_for_the_cluster(lone)
    (tmp_path / "client.py").write_text(CLIENT)
    command = [sys.executable, str(tmp_path / "client.py"), lone.address]
    environment = os.environ | {"PYTHONPATH": str(HERE)}
    with subprocess.Popen(command, stdout=-1, stderr=-1, text=True, env=environment) as client:
        assert client.stdout is not None
        assert client.stdout.readline() == "0\n"
        lone.scheduler.send_signal(number)
        _, said = client.communicate(timeout=60)
    assert client.returncode == 2, said
    assert len(said.splitlines()) == 1, said
    assert said.startswith(f"error: the Dask scheduler at {lone.address} is gone")


def test_a_scheduler_lost_in_the_handshake_is_one_sentence(lone: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    from distributed import Client
    from distributed.comm import CommClosedError

    wait_for_the_cluster(lone)
    given = Client.sync

    def lost(client: Client, what: object, *args: object, **more: object) -> object:
        if "callback_timeout" in more:
            raise CommClosedError("in <TCP>: Stream is closed")
        return given(client, what, *args, **more)

    monkeypatch.setattr(Client, "sync", lost)
    with pytest.raises(WorkerLost, match="is gone, or does not answer"):
        Dask(lone.address, answer=5.0)
    monkeypatch.undo()
    lone.scheduler.send_signal(signal.SIGSTOP)
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        Dask(lone.address, answer=1.0)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        ("__version__ = 'another'\n", r"something else \(qsframework: .* there, .* here\)"),
        ("raise ImportError('nothing here')\n", "another qsframework, or none"),
    ],
)
def test_a_worker_with_another_qsframework_is_refused(tmp_path: Path, spoil: str, said: str) -> None:
    other = tmp_path / "other"
    shutil.copytree(ROOT / "qsframework", other / "qsframework", ignore=shutil.ignore_patterns("__pycache__"))
    with (other / "qsframework" / "__init__.py").open("a") as file:
        file.write(spoil)
    with (
        clustered(tmp_path, workers=1, path=f"{other}:{HERE}") as cluster,
        pytest.raises(InputError, match=said),
        Dask(cluster.address, answer=60.0) as dask,
    ):
        list(run(spectrum, shared(20), tasks(2), dask))


@pytest.mark.parametrize("where", ["--jobs", "--dask"])
def test_ctrl_c_ends_a_command_on_other_processes(tmp_path: Path, where: str, request: pytest.FixtureRequest) -> None:
    number = "2"
    if where == "--dask":
        lone: Cluster = request.getfixturevalue("lone")
        wait_for_the_cluster(lone)
        number = lone.address
    experiment = str(ROOT / "examples" / "m900ib" / "experiment.yaml")
    kept = tmp_path / "kept"
    command = ["design", experiment, "--candidates", "300000", "-o", str(tmp_path / "p.csv"), "--checkpoint", str(kept)]
    command += [where, number]
    with subprocess.Popen([sys.executable, "-m", "qsframework", *command], stderr=-1, text=True) as process:
        end = time.monotonic() + 60
        while not kept.exists() or kept.read_text().count("\n") < 3:  # it works
            assert time.monotonic() < end
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=30)
    assert process.returncode == 130, said
    assert said == "stopped: the files written so far are whole\n"
    assert not (tmp_path / "p.csv").exists()


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
