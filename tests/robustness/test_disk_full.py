"""A disk that takes no more, and a kill at every single step of a write: the old file stays, and no half file."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from killed import ended, files_in, in_child
from long_tasks import bits, shared, spectrum, tasks

from qsframework.errors import InputError
from qsframework.files import folders, output, write_bytes, write_folder
from qsframework.work import Checkpoint, run

ROOT = Path(__file__).resolve().parents[2]
LIMITED = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, ({size}, {size}))
from qsframework.cli import main
sys.argv[0] = "qsf"
main()
"""


def limited(size: int, *arguments: str) -> subprocess.CompletedProcess[str]:
    """`qsf` in a process whose files may not grow beyond a size: writing more fails as on a full disk."""
    command = [sys.executable, "-c", LIMITED.format(size=size), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


@pytest.fixture
def tiny(tmp_path: Path) -> Iterator[Path]:
    """A disk of 64 kB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(disk)], capture_output=True).returncode:
        pytest.skip("no disk can be mounted here; the limit of a file's size stands for it in the other tests")
    try:
        yield disk
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_a_command_on_a_full_disk(tmp_path: Path) -> None:
    old = tmp_path / "s.html"
    old.write_text("old")
    stiffness = ("stiffness", "fanuc_m900ib", "--pose", "0,20,-20,0,-60,0", "--load", "0,0,-2000", "--report", str(old))
    done = limited(100_000, *stiffness)
    assert done.returncode == 2
    assert done.stderr.splitlines() == [f"error: {old}: cannot be written: {os.strerror(errno.EFBIG)}"]
    assert files_in(tmp_path) == {"s.html": b"old"}


def test_a_checkpoint_on_a_full_disk_keeps_what_it_holds(tmp_path: Path) -> None:
    experiment = str(ROOT / "examples" / "m900ib" / "experiment.yaml")
    kept, plan = tmp_path / "kept", tmp_path / "plan.csv"
    design = ("design", experiment, "-n", "8", "--candidates", "6000", "--no-polish", "-o", str(plan))
    full = limited(400_000, *design, "--checkpoint", str(kept))
    assert full.returncode == 2
    assert "What it holds is kept: make room" in full.stderr.splitlines()[-1]
    assert kept.stat().st_size == 400_000, "a last line that is not whole"
    assert not plan.exists()
    again = limited(10_000_000, *design, "--checkpoint", str(kept))
    assert again.returncode == 0, again.stderr
    assert "results" in next(line for line in again.stderr.splitlines() if line.startswith("checkpoint:"))
    found = plan.read_bytes()
    plan.unlink()
    assert limited(10_000_000, *design).returncode == 0
    assert plan.read_bytes() == found


def test_a_really_full_disk(tiny: Path) -> None:
    target = write_bytes(tiny / "a.bin", b"old")
    with pytest.raises(InputError, match=r"a\.bin: cannot be written: No space left"):
        write_bytes(target, bytes(100_000))
    with pytest.raises(InputError, match="cannot be written: No space left"):
        write_folder(tiny / "folder", {"one": "1", "two": "2" * 100_000})
    assert files_in(tiny) == {"a.bin": b"old"}
    kept = tiny / "kept"
    with Checkpoint(kept, {"seed": "0"}) as checkpoint, pytest.raises(InputError, match="make room"):
        list(run(spectrum, shared(400), tasks(60), None, checkpoint, "s"))
    target.unlink()
    with Checkpoint(kept, {"seed": "0"}) as checkpoint:
        assert 5 < checkpoint.loaded < 60


# ---------------------------------------------------------------- a kill at every step


STEPS = ("open", "fdopen", "fsync", "replace", "close", "rmtree")


def stopped_at(step: int, number: int, work: Callable[[], object]) -> Callable[[], int]:
    """The work with a signal before its step-th call of the system; exit code 3 where it has fewer."""

    def child() -> int:
        from qsframework.cli.stop import Stopped, listening

        count = 0

        class Counted:
            def __init__(self, module: object):
                self.module = module

            def __getattr__(self, name: str) -> object:
                nonlocal count
                if name in STEPS:
                    count += 1
                    if count == step:
                        os.kill(os.getpid(), number)
                return getattr(self.module, name)

        output.os = folders.os = Counted(os)  # type: ignore[assignment]
        folders.shutil = Counted(shutil)  # type: ignore[assignment]
        try:
            with listening():
                work()
        except Stopped as stopped:
            return stopped.code
        return 3 if count < step else 0

    return child


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
@pytest.mark.parametrize("what", ["file", "folder"])
def test_a_kill_at_every_step_of_a_write(tmp_path: Path, what: str, number: signal.Signals) -> None:
    place, said = tmp_path / "place", tmp_path / "said"
    new = {"a": b"new" * 9000} if what == "file" else {"f/x": b"new", "f/y": b"new"}
    old = {name: b"old" for name in new}

    def write() -> None:
        if what == "file":
            write_bytes(place / "a", new["a"])
        else:
            write_folder(place / "f", {Path(name).name: content for name, content in new.items()})

    before = after = 0
    for step in range(1, 60):
        for name, content in old.items():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            (place / name).write_bytes(content)
        code = ended(in_child(stopped_at(step, number, write), said))
        if code == 3:
            break
        left = files_in(place)
        parts = {name for name in left if output.SUFFIX in name}
        assert code == (-number if number == signal.SIGKILL else 130), said.read_text()
        assert {name: left[name] for name in left if name not in parts} in (old, new)
        assert not (parts and number == signal.SIGINT)
        before, after = before + (left[next(iter(new))] == b"old"), after + (left[next(iter(new))] != b"old")
        write()
        assert files_in(place) == new, "the next run removes what the killed one left"
    assert code == 3
    assert before >= 3
    assert after >= 1


def test_a_living_process_is_not_disturbed(tmp_path: Path) -> None:
    alive = tmp_path / output.part_name("a").replace(f".{os.getpid()}.", f".{os.getppid()}.")
    elsewhere = tmp_path / f".a.another-host.1.abcdef{output.SUFFIX}"
    foreign = tmp_path / ".a.notes"
    for path in (alive, elsewhere, foreign):
        path.write_text("mine")
    write_bytes(tmp_path / "a", b"new")
    assert {p.name for p in tmp_path.iterdir()} == {"a", alive.name, elsewhere.name, foreign.name}


def test_only_ordinary_files_are_written(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "pipe", Path(os.devnull)):
        with pytest.raises(InputError, match="no ordinary file"):
            write_bytes(path, b"x")
    assert Path(os.devnull).is_char_device()


# ---------------------------------------------------------------- checkpoints cut short


def filled(path: Path) -> bytes:
    """A whole checkpoint, and the results of its job."""
    with Checkpoint(path, {"seed": "0"}) as checkpoint:
        return bits(run(spectrum, shared(40), tasks(12), None, checkpoint, "s"))


def test_a_checkpoint_cut_anywhere_leads_to_the_same_bits(tmp_path: Path) -> None:
    wanted = filled(tmp_path / "whole")
    content = (tmp_path / "whole").read_bytes()
    first = content.index(b"\n") + 1
    path = tmp_path / "cut"
    for size in [first, *range(first + 1, len(content), len(content) // 25), len(content)]:
        path.write_bytes(content[:size])
        assert filled(path) == wanted
        assert sorted(path.read_bytes().splitlines()) == sorted(content.splitlines())


def test_spoiled_lines_are_computed_again(tmp_path: Path) -> None:
    path = tmp_path / "kept"
    wanted, lines = filled(path), (tmp_path / "kept").read_bytes().splitlines(keepends=True)
    lines[3] = lines[3].replace(b"dtype", b"dtypo")
    lines[5] = b"\xff\n"
    path.write_bytes(b"".join(lines))
    calls = tmp_path / "calls"
    with Checkpoint(path, {"seed": "0"}) as checkpoint:
        assert checkpoint.loaded == 10
        assert bits(run(spectrum, shared(40, calls=str(calls)), tasks(12), None, checkpoint, "s")) == wanted
    assert calls.read_text().split() == ["2", "4"]


def test_another_job_is_refused_by_what_differs(tmp_path: Path) -> None:
    path = tmp_path / "kept"
    filled(path)
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"another job \(seed: 0 there, 1 here\).*or delete this one"):
        Checkpoint(path, {"seed": "1"})
    with pytest.raises(InputError, match="poses: nothing there, 9 here"):
        Checkpoint(path, {"seed": "0", "poses": "9"})
    (tmp_path / "notes.txt").write_text("my notes\n")
    with pytest.raises(InputError, match="no checkpoint of qsframework"):
        Checkpoint(tmp_path / "notes.txt", {"seed": "0"})
    assert (tmp_path / "notes.txt").read_text() == "my notes\n"
    assert path.read_bytes() == before


def test_a_checkpoint_has_one_writer(tmp_path: Path) -> None:
    with Checkpoint(tmp_path / "kept", {"seed": "0"}), pytest.raises(InputError, match="in use"):
        Checkpoint(tmp_path / "kept", {"seed": "0"})


def test_a_checkpoint_runs_nothing(tmp_path: Path) -> None:
    """A record may hold data only: a pickle, or an array of objects, is no result."""
    from qsframework.work.checkpoint import sealed

    path = tmp_path / "kept"
    filled(path)
    head = path.read_bytes().splitlines(keepends=True)[0].decode()
    evil = {"array": "gASVIQAAAAAAAACMBXBvc2l4lIwGc3lzdGVt", "dtype": "|O", "shape": [1]}
    path.write_text(head + sealed({"stage": "s", "task": 0, "result": evil}))
    with Checkpoint(path, {"seed": "0"}) as checkpoint:
        assert ("s", 0) not in checkpoint.results
