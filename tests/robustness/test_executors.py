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
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from long_tasks import bits, column, die, odd, refuse, shared, spectrum, strides, tasks, too_late, whose

from qsframework.errors import InputError
from qsframework.experiment import Experiment
from qsframework.plans import DesignOptions, design
from qsframework.work import HERE, Work, WorkerLost, run, workers
from qsframework.work.carry import Packed, pack, unpack

FOLDER = Path(__file__).resolve().parent
ROOT = FOLDER.parents[1]
COUNT = 12
TWO = Work(2)


@pytest.fixture(scope="module")
def wanted() -> bytes:
    return bits(run(spectrum, shared(), tasks(COUNT)))


def test_seeds_make_the_tasks_differ(wanted: bytes) -> None:
    assert bits(run(spectrum, shared(), tasks(COUNT, seed=1))) != wanted
    assert len({v.tobytes() for _, v, _ in run(spectrum, shared(), tasks(COUNT))}) == COUNT


def test_processes_give_the_same_bits(wanted: bytes) -> None:
    assert bits(run(spectrum, shared(), tasks(COUNT), TWO)) == wanted


def test_arrays_with_gaps_lie_the_same_in_a_worker() -> None:
    """Sums over memory with gaps differ in their last bits from sums over the same numbers without."""
    wide = np.random.default_rng(0).standard_normal((200, 7))
    column, block, turned = unpack(Packed(pack((wide[:, 3], wide[::2, 1:6:2], wide.T))))
    for made, given in ((column, wide[:, 3]), (block, wide[::2, 1:6:2]), (turned, wide.T)):
        assert made.strides == given.strides
        assert np.array_equal(made, given)


@pytest.mark.parametrize("work", [HERE, TWO])
def test_tasks_and_results_lie_the_same_everywhere(work: Work) -> None:
    wide = np.random.default_rng(0).standard_normal((200, 7))
    views = [wide[:, 3], wide[::2, 1:6:2], wide.T]
    assert [tuple(s) for s in run(strides, None, views, work)] == [view.strides for view in views]
    assert next(run(column, wide, [2, 3], work)).flags.forc


def test_what_cannot_be_asked_for() -> None:
    with pytest.raises(InputError, match="found -1"):
        Work(-1)
    with pytest.raises(InputError, match="give one of them"):
        Work(2, "tcp://127.0.0.1:1")


@pytest.mark.parametrize("work", [HERE, TWO])
def test_tasks_are_taken_only_as_they_are_needed(work: Work) -> None:
    taken: list[int] = []

    def endless() -> Iterator[tuple[int, np.random.SeedSequence]]:
        for task in itertools.count():
            taken.append(task)
            yield tasks(1)[0]

    results = run(spectrum, shared(20), endless(), work)
    for _ in range(3):
        next(results)
    results.close()
    assert len(taken) <= 3 + (2 * 2 if work == TWO else 0)


@pytest.mark.parametrize("count", [0, 1])
def test_one_task_is_done_here(count: int) -> None:
    assert list(run(whose, 0.0, range(count), TWO)) == [os.getpid()] * count


def test_a_task_s_error_arrives_as_it_was_raised() -> None:
    with pytest.raises(InputError) as caught:
        list(run(refuse, None, range(4), TWO))
    assert [p.line for p in caught.value.problems] == [3, None]
    with pytest.raises(RuntimeError, match="Odd: cannot be sent"):
        list(run(odd, None, range(4), TWO))


def test_a_killed_process_does_not_matter(wanted: bytes, tmp_path: Path) -> None:
    given = shared(killed=str(tmp_path / "killed"))
    assert bits(run(spectrum, given, tasks(COUNT), TWO)) == wanted
    assert (tmp_path / "killed").exists()


def test_a_task_that_ends_its_process_is_said_and_the_next_job_runs(wanted: bytes) -> None:
    with pytest.raises(WorkerLost, match="worker processes ended"):
        list(run(die, 3, range(8), TWO))
    assert bits(run(spectrum, shared(), tasks(COUNT), TWO)) == wanted


MASTER = """
from long_tasks import whose
from qsframework.work import Work, run
if __name__ == "__main__":
    for worker in run(whose, 0.1, range(10000), Work(2)):
        print(worker, flush=True)
"""


def test_processes_end_with_a_killed_master(tmp_path: Path) -> None:
    script = tmp_path / "master.py"
    script.write_text(MASTER)
    environment = os.environ | {"PYTHONPATH": str(FOLDER)}
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True, env=environment) as master:
        assert master.stdout is not None
        workers = {int(master.stdout.readline()) for _ in range(6)}
        master.kill()
        master.wait(timeout=600)
        assert workers
        assert master.pid not in workers
        wait_for_the_end(workers)


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
def clustered(folder: Path, workers: int = 2, path: str = str(FOLDER)) -> Iterator[Cluster]:
    """A scheduler and workers on this machine, which end with the test whatever happens."""
    address = f"tcp://127.0.0.1:{free_port()}"
    end = f"--nthreads 1 --no-nanny --memory-limit 0 --death-timeout 90 --local-directory {folder}".split()
    processes = [started(folder, str(FOLDER), "scheduler", "--port", address.rsplit(":", 1)[1], "--no-show")]
    try:
        processes += [started(folder, path, "worker", address, *end, "--name", f"w{k}") for k in range(workers)]
        yield Cluster(address, processes[0], processes[1:])
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.wait(timeout=600)


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    with clustered(tmp_path) as cluster:
        yield cluster


@pytest.fixture
def lone(tmp_path: Path) -> Iterator[Cluster]:
    """A cluster of one worker."""
    with clustered(tmp_path, workers=1) as cluster:
        yield cluster


@contextmanager
def watching(cluster: Cluster) -> Iterator[Any]:
    """A client of a cluster that is up, with all its workers."""
    from distributed import Client

    with Client(cluster.address, timeout=600, set_as_default=False) as client:
        wait_for_workers(client, len(cluster.workers))
        yield client


def wait_for_workers(client: Any, count: int, limit: float = 600.0) -> None:
    end = time.monotonic() + limit
    while len(client.nthreads()) != count:
        assert time.monotonic() < end, f"{len(client.nthreads())} workers, {count} expected"
        time.sleep(0.1)


def test_dask_gives_the_same_bits_though_a_worker_is_killed(
    cluster: Cluster, wanted: bytes, m900ib: Experiment, monkeypatch: pytest.MonkeyPatch
) -> None:
    dask = Work(dask=cluster.address)
    with watching(cluster) as client:
        options = DesignOptions(polish=False, starts=4)
        plans = [design(m900ib, 9, candidates=100, options=options, work=work) for work in (HERE, dask)]
        assert plans[0].pendant.tobytes() == plans[1].pendant.tobytes()
        results = []
        for result in run(spectrum, shared(sleep=0.15), tasks(COUNT), dask):
            results.append(result)
            if len(results) == 2:
                cluster.workers[0].send_signal(signal.SIGKILL)
        assert cluster.workers[0].wait(timeout=600) == -signal.SIGKILL
        wait_for_workers(client, 1)
        assert bits(results) == wanted
        with pytest.raises(InputError) as caught:
            list(run(refuse, None, range(2), dask))
        assert [p.line for p in caught.value.problems] == [3, None]
        with pytest.raises(TimeoutError, match="the task's own"):
            list(run(too_late, None, range(2), dask))
        monkeypatch.setattr(workers, "ALONE", 0.5)
        left = run(spectrum, shared(sleep=0.15), tasks(COUNT), dask)
        next(left)
        cluster.workers[1].send_signal(signal.SIGKILL)
        with pytest.raises(WorkerLost, match="no workers"):
            list(left)
        monkeypatch.setattr(workers, "ANSWER", 1.0)
        with pytest.raises(InputError, match=f"has no workers. Start some: dask worker {cluster.address}"):
            list(run(spectrum, shared(), tasks(2), dask))


def test_a_worker_that_stops_answering_is_given_up(
    tmp_path: Path, wanted: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A partition: its connections stay open, its tasks and what it holds never come."""
    # 5 minutes by default; of a few workers 5 s at least, looked at as often as is said here
    monkeypatch.setenv("DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL", "500 ms")
    frozen: subprocess.Popen[bytes] | None = None
    results = []
    with clustered(tmp_path) as cluster, watching(cluster) as client:
        for result in run(spectrum, shared(sleep=0.1), tasks(COUNT), Work(dask=cluster.address)):
            results.append(result)
            if frozen is None:  # the one that holds the value which all tasks share
                holds = next(w for w, keys in client.has_what().items() if any("Packed" in str(k) for k in keys))
                frozen = cluster.workers[int(client.scheduler_info()["workers"][holds]["name"][1:])]
                frozen.send_signal(signal.SIGSTOP)
        assert bits(results) == wanted


DESIGN = ["design", str(ROOT / "examples" / "m900ib" / "experiment.yaml"), "--candidates", "4000000", "-o"]
"""A command of half a minute, whatever the machine: what is done to it happens in its first seconds."""
IMPATIENT = "from qsframework.cli import main; from qsframework.work import workers; workers.ANSWER = 4.0; main()"
"""`qsf` that waits less for a scheduler that does not answer."""


def seconds(process: int) -> float:
    """Processor time of a process; 0 where it is gone."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    except FileNotFoundError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def children(process: int) -> list[int]:
    """Processes that a process has started."""
    return [
        int(child) for each in Path(f"/proc/{process}/task").glob("*/children") for child in each.read_text().split()
    ]


def wait_for_work(processes: Callable[[], list[int]], start: float, more: float = 1.5, limit: float = 600.0) -> None:
    """Until processes have worked so long."""
    end = time.monotonic() + limit
    while sum(map(seconds, processes())) < start + more:
        assert time.monotonic() < end, "nothing is done"
        time.sleep(0.05)


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_scheduler_lost_at_work_is_one_sentence(lone: Cluster, tmp_path: Path, number: signal.Signals) -> None:
    """Nothing of distributed's own is printed, not even while Python ends."""
    with watching(lone):
        before = seconds(lone.workers[0].pid)
    command = [sys.executable, "-c", IMPATIENT, *DESIGN, str(tmp_path / "p.csv"), "--dask", lone.address]
    with subprocess.Popen(command, stdout=-1, stderr=-1, text=True, env=os.environ | {"COLUMNS": "200"}) as client:
        wait_for_work(lambda: [lone.workers[0].pid], before)
        lone.scheduler.send_signal(number)
        _, said = client.communicate(timeout=600)
    assert client.returncode == 2, said
    assert said == f"error: the Dask scheduler at {lone.address} is gone, or does not answer\n"
    assert not list(tmp_path.glob("p.*"))


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        ("__version__ = 'another'\n", r"something else \(qsframework: .* there, .* here\)"),
        ("raise ImportError('nothing here')\n", "another qsframework, or none"),
    ],
)
def test_a_worker_with_another_qsframework_is_refused(
    tmp_path: Path, spoil: str, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = tmp_path / "other"
    shutil.copytree(ROOT / "qsframework", other / "qsframework", ignore=shutil.ignore_patterns("__pycache__"))
    with (other / "qsframework" / "__init__.py").open("a") as file:
        file.write(spoil)
    monkeypatch.setattr(workers, "ANSWER", 60.0)
    with (
        clustered(tmp_path, workers=1, path=f"{other}:{FOLDER}") as cluster,
        watching(cluster),
        pytest.raises(InputError, match=said),
    ):
        list(run(spectrum, shared(20), tasks(2), Work(dask=cluster.address)))


def test_ctrl_c_ends_a_command_on_other_processes(tmp_path: Path) -> None:
    stop_at_work(tmp_path, "--jobs", "2", 0.0, [])


def test_ctrl_c_ends_a_command_on_a_cluster_and_a_scheduler_lost_in_the_handshake_is_one_sentence(
    lone: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with watching(lone):
        before, busy = seconds(lone.workers[0].pid), [lone.workers[0].pid]
    stop_at_work(tmp_path, "--dask", lone.address, before, busy)
    lost_in_the_handshake(lone, monkeypatch)


def stop_at_work(tmp_path: Path, where: str, number: str, before: float, busy: list[int]) -> None:
    """Ctrl-C for a command once processes, its own or busy ones, have worked for it."""
    command = [sys.executable, "-m", "qsframework", *DESIGN, str(tmp_path / "p.csv"), where, number]
    with subprocess.Popen(command, stderr=-1, text=True) as process:
        wait_for_work(lambda: busy or children(process.pid), before, 3.0 if where == "--jobs" else 1.5)
        own = children(process.pid)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=600)
    assert process.returncode == 130, said
    assert said == "Interrupted. No partial files were left.\n"
    assert not (tmp_path / "p.csv").exists()
    assert bool(own) == (where == "--jobs")
    wait_for_the_end(own)


def lost_in_the_handshake(lone: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is said of a scheduler that goes, or answers nobody, before anything is computed."""
    from distributed import Client
    from distributed.comm import CommClosedError

    given = Client.sync

    def lost(client: Client, what: object, *args: object, **more: object) -> object:
        if "callback_timeout" in more:
            raise CommClosedError("in <TCP>: Stream is closed")
        return given(client, what, *args, **more)

    monkeypatch.setattr(Client, "sync", lost)
    with pytest.raises(WorkerLost, match="is gone, or does not answer"):
        workers.Cluster(lone.address)
    monkeypatch.undo()
    lone.scheduler.send_signal(signal.SIGSTOP)
    monkeypatch.setattr(workers, "ANSWER", 1.0)
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        workers.Cluster(lone.address)


def wait_for_the_end(processes: Iterable[int], limit: float = 600.0) -> None:
    end = time.monotonic() + limit
    while any(Path(f"/proc/{each}").exists() for each in processes):
        assert time.monotonic() < end, "workers without a master go on"
        time.sleep(0.1)


def test_no_scheduler_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "ANSWER", 1.0)
    start = time.process_time()
    for address in (f"tcp://127.0.0.1:{free_port()}", "no address", ""):
        with pytest.raises(InputError, match=r"no Dask scheduler answers.*Start one with `dask scheduler`"):
            list(run(whose, 0.0, range(2), Work(dask=address)))
    assert time.process_time() - start < 15


def test_without_dask_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install '\.\[cluster\]'"):
        list(run(whose, 0.0, range(2), Work(dask="tcp://127.0.0.1:1")))
