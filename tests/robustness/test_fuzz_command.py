"""A sample of the spoiled files through the command line: exit code 0 or 2, words on stderr, never a traceback."""

from __future__ import annotations

import random
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import fuzzing
import pytest

from qsframework.cli.app import main
from qsframework.experiment import example

COMMANDS = {
    "robot.yaml": lambda path: ["check", str(path)],
    "URDF": lambda path: ["stiffness", str(path.parent), "--pose", "10,20", "--load", "0,0,-10"],
    "experiment.yaml": lambda path: ["check", str(path)],
    "readings.csv": lambda path: ["identify", str(example("r2000ic") / "experiment.yaml"), str(path)],
    "plan.csv": lambda path: ["simulate", str(example("m900ib") / "experiment.yaml"), str(path), "-o", "out.csv"],
    "fit.json": lambda path: ["show", str(example("r2000ic") / "experiment.yaml"), str(path), "--html", "s"],
    "task.yaml": lambda path: ["compare", "fanuc_m900ib", "no_such_robot", "--task", str(path)],
}
"""For each format a command that reads it."""
COUNT = 12


@pytest.mark.filterwarnings("default")  # a warning is no traceback; the library's own are counted in test_fuzz_files.py
@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_ends_with_0_or_2(
    corpus: dict[str, list[fuzzing.Good]],
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    goods = [g for g in corpus[name] if g.label not in ("every", "poses.csv", "full.csv")]
    for seed in range(COUNT):
        good, content = fuzzing.spoiled(goods, 7000 + seed)
        code, told = run(good, content, COMMANDS[name](good.path), monkeypatch, capfd)
        assert code in (0, 2), (seed, told)
        assert "Traceback" not in told, (seed, told)
        assert code == 0 or "error: " in told, (seed, told)


def run(
    good: fuzzing.Good,
    content: bytes,
    words: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> tuple[int, str]:
    """Exit code and stderr of `qsf` on a spoiled file."""
    good.path.write_bytes(content)
    monkeypatch.setattr("sys.argv", ["qsf", *words])
    try:
        main()
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1 if end.code else 0
    finally:
        good.path.write_bytes(good.content)
    return code, capfd.readouterr().err


SPOILT: dict[str, Callable[[bytes], bytes]] = {
    "NUL": lambda content: content[:40] + b"\0" + content[40:],
    "another encoding": lambda content: content.decode().encode("utf-16"),
    "cut off": lambda content: content[: len(content) // 2],
}


@pytest.mark.parametrize("name", SPOILT)
def test_the_installed_command_says_it_in_words(tmp_path: Path, name: str) -> None:
    path = tmp_path / "experiment.yaml"
    path.write_bytes(SPOILT[name]((example("m900ib") / "experiment.yaml").read_bytes()))
    done = subprocess.run([sys.executable, "-m", "qsframework", "check", str(path)], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.startswith("error: ")
    assert "Traceback" not in done.stderr


def test_random_bytes_are_no_file_of_any_kind(corpus: dict[str, list[fuzzing.Good]]) -> None:
    rng = random.Random(3)
    for goods in corpus.values():
        for size in (0, 1, 10, 1000):
            found = fuzzing.try_file(goods[0], rng.randbytes(size))
            assert found.outcome is fuzzing.Outcome.REFUSED, found.words
