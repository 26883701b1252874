"""A disk that takes no more, and a kill at every single step of a write: the old file stays, and no half file."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

import pytest
from killed import ended, files_in, in_child

from qsframework.errors import InputError
from qsframework.files import folders, output, write_bytes, write_folder
from qsframework.files.journal import Journal

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
    return subprocess.run(command, capture_output=True, text=True, timeout=600)


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


def for_ever(journal: Journal) -> None:
    """Records without end."""
    for number in count():
        journal.append({"number": number, "text": "x" * 990})


def test_a_really_full_disk(tiny: Path) -> None:
    target = write_bytes(tiny / "a.bin", b"old")
    with pytest.raises(InputError, match=r"a\.bin: cannot be written: No space left"):
        write_bytes(target, bytes(100_000))
    with pytest.raises(InputError, match="cannot be written: No space left"):
        write_folder(tiny / "folder", {"one": "1", "two": "2" * 100_000})
    assert files_in(tiny) == {"a.bin": b"old"}
    with Journal(tiny / "kept", {"format": "a test"}) as journal, pytest.raises(InputError, match="make room"):
        for_ever(journal)
    content = (tiny / "kept").read_bytes()
    assert content.endswith(b"\n"), "nothing is left of the record that found no room"
    target.unlink()
    with Journal(tiny / "kept", {"format": "a test"}) as journal:
        assert [r["number"] for r in journal.records] == list(range(content.count(b"\n") - 1))
        assert len(journal.records) > 40
        journal.append({"number": -1})
        assert not journal.spoilt


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
