"""Shared by all tests: loaded experiments, once per session."""

from __future__ import annotations

import gc
import importlib
import os
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import remembered
import typer.main
import typer.testing
import yaml
from hypothesis import settings

from qsframework.experiment import Experiment, Readings, example, load_experiment, read_readings
from qsframework.robot import loader
from qsframework.robot.expand import files_of
from qsframework.robot.urdf import Urdf, read_urdf

for folder in ("elastostatics", "proof"):
    sys.path.insert(0, str(Path(__file__).parent / folder))
# whichever test comes first in a random order pays for what is loaded once: no deadlines
settings.register_profile("qsf", deadline=None)
settings.load_profile("qsf")
os.environ["COLUMNS"] = "1000"  # sentences stand on one line; tests of the terminal set their own width
ROOT = Path(__file__).resolve().parents[1]
for folder in ("docs", "docs/paper", "benchmarks"):
    sys.path.insert(0, str(ROOT / folder))


@pytest.hookimpl(trylast=True)  # once there is a reporter
def pytest_configure(config: pytest.Config) -> None:
    """Pytest's own lines are not that wide."""
    if config.pluginmanager.has_plugin("terminalreporter"):
        config.get_terminal_writer().fullwidth = 100


@pytest.hookimpl(trylast=True)  # once the order is drawn
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """In whatever order, a folder's files follow each other: of what they share, such as a diagnosis, most is made in
    one worker only. The pages' commands, all run by one fixture, begin, so that no worker waits for the other's end."""
    place = {ROOT / "tests" / "readme": 0}
    for item in items:
        place.setdefault(item.path.parent, len(place))
    items.sort(key=lambda item: place[item.path.parent])


LONG: dict[str, dict[str, list[str]]] = yaml.safe_load((ROOT / "tests" / "long.yaml").read_text())
"""By file and test: the cases that `make test` keeps of tests that need not run at every change."""


def pytest_itemcollected(item: pytest.Item) -> None:
    """Marks those tests."""
    if isinstance(item, pytest.Function):
        kept = LONG.get(item.path.relative_to(ROOT / "tests").as_posix(), {}).get(item.originalname)
        if kept is not None and (not hasattr(item, "callspec") or item.callspec.id not in kept):
            item.add_marker("long")


def pytest_collection_finish() -> None:
    """Thousands of tests and all modules live to the end: garbage is not looked for among them again and again, and
    seldom among what tests share."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)
    gc.set_threshold(50_000)


@pytest.fixture(scope="session", autouse=True)
def _commands_once() -> Iterator[None]:
    """Tests call the command line hundreds of times and none changes its options: it is made of its functions'
    signatures once, which else takes most of the time of a short command."""
    made = cache(typer.main.get_command)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(typer.main, "get_command", made)
        patched.setattr(typer.testing, "_get_command", made)
        yield


@pytest.fixture(scope="session", autouse=True)
def _in_memory() -> Iterator[None]:
    """No test cuts the power, and commands that are killed are other processes: nobody waits for a disk here."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(os, "fsync", lambda _handle: None)
        yield


@cache
def _expanded(path: Path, folder: Path) -> Urdf:
    return read_urdf(path, folder)


@cache
def _included(path: Path, folder: Path) -> Any:
    return files_of(path, folder)


@cache
def _shipped() -> dict[bytes, Path]:
    """The xacros of the repository by what they hold, those that include no other file."""
    files = {path.read_bytes(): path for path in sorted(ROOT.glob("robots/*/*.xacro"))}
    return {text: path for text, path in files.items() if b"xacro:include" not in text and b"load_yaml" not in text}


def _copied(value: Any, file: Path, copy: Path) -> Any:
    """What was read of a file, as if it had been read of a copy."""
    if isinstance(value, Path | str):
        return copy if value == file else str(copy) if value == str(file) else value
    if isinstance(value, tuple):
        return tuple(_copied(part, file, copy) for part in value)
    if is_dataclass(value) and not isinstance(value, type):
        return replace(value, **{f.name: _copied(getattr(value, f.name), file, copy) for f in fields(value)})
    return value


@pytest.fixture(scope="session", autouse=True)
def _expand_once() -> Iterator[None]:
    """Robots of the repository, and copies of them, are loaded thousands of times and no test writes into them: each
    xacro is expanded once in a process, which is most of what loading takes."""

    def read(path: Path, folder: Path) -> Urdf:
        if path.is_relative_to(ROOT / "robots") or path.is_relative_to(ROOT / "tests"):
            return _expanded(path, folder)
        small = path.suffix == ".xacro" and path.is_file() and path.stat().st_size < 1_000_000
        own = _shipped().get(path.read_bytes()) if small else None
        return read_urdf(path, folder) if own is None else _copied(_expanded(own, own.parent), own, path)

    def included(path: Path, folder: Path) -> Any:
        return (_included if path.is_relative_to(ROOT / "robots") else files_of)(path, folder)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(loader, "read_urdf", read)
        patched.setattr(loader, "files_of", included)
        yield


@pytest.fixture(scope="session", autouse=True)
def _answers(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Where both workers lay what they diagnosed."""
    base = tmp_path_factory.getbasetemp()
    remembered.keep_in((base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "answers")


ASKERS = (
    "qsframework",
    "qsframework.uses.certificate",
    "qsframework.uses.conformance",
    "qsf_day.so_far",
    "qsframework.cli.diagnose",
    "qsframework.diagnoses",
)
"""Modules that know `diagnose` by its name."""


@pytest.fixture(scope="module")
def diagnosed_once() -> Iterator[None]:
    """For a file whose tests look at what commands do with diagnoses: each is made once, for all such files."""
    askers = [importlib.import_module(name) for name in ASKERS]
    with pytest.MonkeyPatch.context() as patched:
        for module in askers:
            patched.setattr(module, "diagnose", remembered.diagnose)
        yield


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository."""
    return ROOT


@pytest.fixture(scope="session")
def r2000ic() -> Experiment:
    """The real readings' experiment."""
    return load_experiment(example("r2000ic") / "experiment.yaml")


@pytest.fixture(scope="session")
def real(r2000ic: Experiment) -> Readings:
    """The 43 real readings."""
    return read_readings(r2000ic.data, r2000ic)


@pytest.fixture(scope="session")
def m900ib() -> Experiment:
    """The paper's robot."""
    return load_experiment(example("m900ib") / "experiment.yaml")
