"""Files are written before anything is printed, so that `qsf ... | head` loses none; and outputs that many may want."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path

import command_lines
import killed
import pytest
from killed import ended, files_in, in_child

from qsframework.files import output, write_bytes

ROBOT = ("robot.yaml", "nominal.yaml")
DESIGNED, MEASURED = ("plan.csv", "plan.json"), ("readings.csv", "readings.json", "truth.json")


MORE = {
    "design plan.csv": ("plan.csv", "plan.json"),
    "simulate r.csv": ("r.csv", "r.json"),
    "diagnose new": tuple(f"new/{n}" for n in ("experiment.yaml", *(f"robot/{r}" for r in ROBOT), "robot/small.urdf")),
    "protocol r.csv": ("r.csv", "r_floor.csv"),
    "day day": ("day/day.jsonl", "day/readings.csv"),
    "new arm": tuple(f"arm/{n}" for n in ("README.md", "arm.urdf", "experiment.yaml", *ROBOT)),
    "demo demo": tuple(f"demo/{n}" for n in ("report.html", "fit.json", *DESIGNED, *MEASURED)),
}
"""Files that a command writes for an output that its line names, where they are not that one."""


def outputs(line: str) -> set[str]:
    """All files that a command writes, from its line."""
    named = [word.removeprefix("out/") for word in line.split() if word.startswith("out/")]
    return {file for name in named for file in MORE.get(f"{line.split()[0]} {name}", (name,))}


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    before = Path.cwd()
    yield command_lines.prepared(tmp_path_factory.mktemp("bench"))
    os.chdir(before)


@pytest.mark.parametrize("line", killed.WRITING, ids=[" ".join(line.split()[:1]) for line in killed.WRITING])
def test_no_file_is_lost_with_the_reader(bench: Path, tmp_path: Path, line: str) -> None:
    def unread() -> int:
        reader, writer = os.pipe()
        os.close(reader)
        os.dup2(writer, 1)
        with redirect_stdout(sys.__stdout__):
            return killed.qsf(line.split())()

    killed.laid(bench, tmp_path / "place", {})
    code = ended(in_child(unread, tmp_path / "said"))
    said = (tmp_path / "said").read_text()
    assert code == 0, said
    assert "Traceback" not in said, said
    assert files_in(tmp_path / "place" / "out").keys() == outputs(line), said


def test_a_pipe_that_closes_early(bench: Path, tmp_path: Path) -> None:
    """The command itself, whose reader took one line."""
    command = [sys.executable, "-m", "qsframework", "robots", "--json", str(tmp_path / "r.json")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=bench) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        said = process.stderr.read().decode()
        process.wait(timeout=600)
    assert said == ""
    assert (tmp_path / "r.json").stat().st_size > 100


def test_two_writers_of_one_output(tmp_path: Path) -> None:
    """One of them wins, whole; neither leaves a part."""
    contents = [bytes([65 + k]) * (100_000 + k) for k in range(2)]

    def writes(content: bytes) -> int:
        for _ in range(100):
            write_bytes(tmp_path / "place" / "a", content)
        return 0

    children = [in_child(lambda c=c: writes(c), tmp_path / f"said{len(c)}") for c in contents]
    seen = set[bytes]()
    while any(os.waitid(os.P_PID, c, os.WEXITED | os.WNOHANG | os.WNOWAIT) is None for c in children):
        if (tmp_path / "place" / "a").exists():
            seen.add((tmp_path / "place" / "a").read_bytes())
    assert [ended(child) for child in children] == [0, 0]
    assert seen <= set(contents)
    assert files_in(tmp_path / "place").keys() == {"a"}


def test_a_folder_that_may_not_be_written(bench: Path, tmp_path: Path) -> None:
    """As a user who is not root: root may write everywhere."""
    if os.getuid() != 0:
        pytest.skip("only root can become another user; the modes of folders are tried by the other tests")
    closed, reachable = tmp_path / "closed", [*tmp_path.parents][:-2]
    closed.mkdir(mode=0o755)
    (closed / "s.json").write_text("old")
    modes = {folder: folder.stat().st_mode for folder in (tmp_path, *reachable)}

    def nobody() -> int:
        os.setuid(65534)
        line = f"stiffness ur10 --pose 0,-90,90,0,90,0 --load 0,0,-50 --json {closed / 's.json'}"
        return killed.qsf(line.split())()

    try:
        for folder, mode in modes.items():
            folder.chmod(mode | 0o055)
        code = ended(in_child(nobody, tmp_path / "said"))
    finally:
        for folder, mode in modes.items():
            folder.chmod(mode)
    said = " ".join((tmp_path / "said").read_text().split())
    if "Permission denied" in said and "closed" not in said:
        pytest.skip("the interpreter's own files are not readable for other users here")
    assert code == 2, said
    assert "s.json: cannot be written: nothing may be written in" in said
    assert (closed / "s.json").read_text() == "old"


@pytest.mark.parametrize(
    "line", [killed.WRITING[k] for k in (0, 1, 4, 13)], ids=["design", "simulate", "extend", "import"]
)
def test_a_command_on_a_file_system_that_is_full(bench: Path, tmp_path: Path, line: str) -> None:
    place = tmp_path / "place"
    killed.laid(bench, place, {})
    disk = place / "out"
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=8k", "tmpfs", str(disk)], capture_output=True).returncode:
        pytest.skip("no disk can be mounted here; the limit of a file's size stands for it in test_disk_full.py")
    try:
        (disk / "old").write_bytes(bytes(8000))
        code = ended(in_child(killed.qsf(line.split()), tmp_path / "said"))
        left = files_in(disk)
    finally:
        os.chdir(bench)
        subprocess.run(["umount", str(disk)], check=True)
    said = " ".join((tmp_path / "said").read_text().split())
    assert code == 2, said
    assert "cannot be written: No space left on device" in said
    assert not [name for name in left if output.SUFFIX in name]
    assert left["old"] == bytes(8000)
