"""The public API is what docs/public_api.txt lists, so that a change of it is a deliberate act."""

from __future__ import annotations

import difflib
import importlib
import re
from importlib.metadata import version
from pathlib import Path

import make_public_api
import pytest

import qsframework as qsf
from qsframework import __version__

TELL = """the public API differs from docs/public_api.txt. If that is meant: tell users in CHANGELOG.md; then run
python docs/make_public_api.py
"""


def test_the_public_api_changes_only_on_purpose(root: Path) -> None:
    kept = (root / "docs" / "public_api.txt").read_text().splitlines()
    found = make_public_api.listing().splitlines()
    assert found == kept, TELL + "\n".join(difflib.unified_diff(kept, found, "listed", "found", lineterm="", n=0))


def test_the_list_notices_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    """An argument, a method or a name more or less is another list."""
    package = importlib.import_module("qsframework.fits")
    before = make_public_api.listing()
    monkeypatch.setattr(package, "read_fit", lambda path, strict=True: None)
    assert make_public_api.listing() != before
    monkeypatch.undo()
    monkeypatch.setattr(package.Fit, "added", lambda self: None, raising=False)
    assert "def added" in make_public_api.listing()
    monkeypatch.undo()
    monkeypatch.setattr(package, "__all__", package.__all__[1:])
    assert make_public_api.listing() != before


def test_every_public_name_is_in_its_package() -> None:
    for package in make_public_api.PACKAGES:
        assert {*make_public_api.public(package)} <= {*dir(importlib.import_module(package))}, package


def test_what_the_pages_show_is_public(root: Path) -> None:
    """docs/api.md documents public names only; scripts and pages import nothing else."""
    front = [getattr(qsf, name) for name in dir(qsf)]
    for dotted in re.findall(r"^::: (\S+)$", (root / "docs" / "api.md").read_text(), re.M):
        home = dotted.rpartition(".")[0]
        package = ".".join(dotted.split(".")[: 2 if dotted.startswith("qsframework") else 1])
        module = importlib.import_module(home)
        if any(one in (module, vars(module).get(dotted.rpartition(".")[2])) for one in front):
            continue  # a name of the front door at its home, or of a module that the front door has
        assert package in make_public_api.PACKAGES, dotted
        assert dotted == package or dotted.split(".")[-1] in make_public_api.public(package), dotted
    pages = [*(root / "docs").glob("*.md"), *(root / "examples" / "scripts").glob("*.py"), root / "README.md"]
    line = re.compile(r"^from (qsf(?!_plugins)[\w.]*) import ([\w, ]+)$", re.M)
    said = [(page.name, *found) for page in pages for found in line.findall(page.read_text())]
    assert len(said) > 10
    for page, package, names in said:
        assert package in make_public_api.PACKAGES, f"{page}: {package}"
        assert set(names.split(", ")) <= set(make_public_api.public(package)), f"{page}: {names}"


def test_the_version_stands_in_one_place(root: Path) -> None:
    stated = re.findall(r'^version = "(.+)"$', (root / "pyproject.toml").read_text(), re.M)
    assert stated == [version("qsframework")] == [__version__]
    assert re.fullmatch(r"\d+\.\d+\.\d+(rc\d+)?", __version__)
    assert f"## {__version__}" in (root / "CHANGELOG.md").read_text()
    with pytest.raises(AttributeError, match="attribute"):
        importlib.import_module("qsframework").__getattr__("nothing")
