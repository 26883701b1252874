"""LICENCES.md speaks of what is locked; SECURITY.md and the page of what is made from it."""

from __future__ import annotations

import re
from pathlib import Path

from make_licences import COPYLEFT, FOR_USERS, LOCK, PAGE, locked, needed
from packaging.utils import canonicalize_name


def rows(title: str) -> list[list[str]]:
    """The cells of the table under a title, without its head."""
    part = PAGE.read_text().partition(f"\n## {title}\n")[2].partition("\n## ")[0]
    lines = re.findall(r"^\| (.*) \|$", part, re.MULTILINE)
    return [line.split(" | ") for line in lines][1:]


def test_the_page_has_every_locked_package_in_its_version() -> None:
    """After `make lock` comes `make licences`."""
    assert [(name, version) for name, version, _, _ in rows("All packages")] == list(locked(LOCK.read_text()).values())


def test_the_page_says_what_users_have() -> None:
    users = {canonicalize_name(name) for name, _, _, who in rows("All packages") if who == "users"}
    assert users == needed(FOR_USERS) & set(locked(LOCK.read_text()))
    assert {"numpy", "pin", "distributed"} <= users


def test_copyleft_is_named_with_what_it_means() -> None:
    found = {name for name, _, licence, _ in rows("All packages") if COPYLEFT.search(licence)}
    told = {cells[0] for cells in rows("Copyleft") if len(cells[3]) > 40 and cells[0] in found}
    assert told == found
    assert "certifi" in found


def test_the_lock_has_no_setuptools_of_some_pythons_own(root: Path) -> None:
    """What a new environment brings may be years old: the lock once had 65.5.0, with three known vulnerabilities."""
    (version,) = re.findall(r"^setuptools==(\d+)", (root / "requirements.lock").read_text(), re.MULTILINE)
    assert int(version) >= 80
