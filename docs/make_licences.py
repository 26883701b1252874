"""Write LICENCES.md, what every package in requirements.lock is licensed under: `make licences`

It reads what the installed packages state, so all extras have to be installed; what no package states stands here.
"""

from __future__ import annotations

import re
from importlib.metadata import metadata, requires
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

DOCS = Path(__file__).parent
PAGE = DOCS.parent / "LICENCES.md"
LOCK = DOCS.parent / "requirements.lock"
FOR_USERS = ("", "cluster", "day", "excel")
"""The extras that a user installs; the others are for work on qsframework itself."""
READ = {
    "cmeel-qhull": "Qhull",
    "cvxopt": "GPL-3.0-or-later",
    "embreex": "MIT",
    "scipy": "BSD-3-Clause",
    "vhacdx": "MIT",
    "xacro": "BSD-3-Clause",
}
"""Read in the licence file of a package that states none in a word."""
COPYLEFT = re.compile(r"GPL|GNU|MPL|Mozilla|EPL|Eclipse|EUPL|CDDL|CC-BY-SA", re.IGNORECASE)
_FILES = "Its own files stay under this licence. Used unchanged, as here, it asks nothing more of you"
MEANS = {
    "certifi": f"{_FILES}. The certificates of authorities: a list, no code.",
    "hypothesis": f"{_FILES}. Only the tests import it.",
    "pathspec": f"{_FILES}. Only the tools that build the package and the site import it.",
    "docutils": "The library is public domain and BSD. One file of its source, for the editor Emacs, is under the "
    "GPL; the package does not hold it.",
    "fqdn": f"{_FILES}. Only the tool that writes the bill of materials imports it.",
    "cvxopt": "FIGAROH asks for it. One benchmark compares with FIGAROH; nothing that you install does. Who hands on "
    "an environment with the extra `bench` hands on GPL code, under the GPL's terms.",
    "picos": "As cvxopt: FIGAROH asks for it, for one benchmark.",
}
"""What the copyleft licence of a package means for users."""
HEAD = """# Licences

qsframework is under the BSD 3-Clause licence (`LICENSE`). This page lists every package of `requirements.lock`, with
the licence that the package states. It is made by `make licences`, once more after each `make lock`, and a test holds
it to the lock.

| who | what |
|---|---|
| users | `pip install qsframework`, with the extras `cluster`, `day` and `excel` |
| work | the tests, the site, the benchmarks and this page: the extras `test`, `docs`, `bench` and `audit` |

`make sbom` writes the software bill of materials of what users have, in CycloneDX's format, to `build/sbom.json`.
`make audit` holds the lock against the known vulnerabilities of these versions.

## Copyleft

Whoever only uses qsframework has nothing to do. Whoever hands it on together with these packages, in a container or on
a machine, hands on their licences too, and tells where the source of the copyleft ones is.

| package | licence | who | what it means |
|---|---|---|---|
"""
INSIDE = """
Some wheels hold compiled libraries under licences of their own. Each lies in a file that can be exchanged, or lets
itself be used by programs under any licence:

| in | library | licence | what it means |
|---|---|---|---|
| numpy, scipy, scs, sparsediffpy | libgfortran, libquadmath | GPL-3.0 with GCC's exception, LGPL-2.1 | as above |
| shapely | GEOS | LGPL-2.1 | a library file of its own: it may be exchanged |
| pyzmq | libzmq | MPL-2.0 | used unchanged |
| libpinocchio, libcoal, eigenpy | Eigen | MPL-2.0 | compiled in unchanged |

## All packages

| package | version | licence | who |
|---|---|---|---|
"""


def locked(text: str) -> dict[str, tuple[str, str]]:
    """Name as written and version of every package of a lock, by its canonical name."""
    lines = (line.split("==") for line in text.splitlines() if "==" in line and not line.startswith("#"))
    return {canonicalize_name(name): (name, version) for name, version in lines}


def needed(extras: tuple[str, ...]) -> set[str]:
    """Canonical names of everything that qsframework with these extras needs."""
    seen: set[tuple[str, str]] = set()
    queue = [("qsframework", extra) for extra in extras]
    while queue:
        name, extra = queue.pop()
        if (name, extra) in seen:
            continue
        seen.add((name, extra))
        for requirement in map(Requirement, requires(name) or ()):
            if requirement.marker is None or requirement.marker.evaluate({"extra": extra}):
                queue += [(canonicalize_name(requirement.name), e) for e in ("", *requirement.extras)]
    return {name for name, _ in seen}


def licence(name: str) -> str:
    """What a package states: an expression, a word or two, a classifier; else what was read in its licence file."""
    if name in READ:
        return READ[name]
    stated = metadata(name)
    for word in (stated.get("License-Expression"), stated.get("License")):
        if word and "\n" not in word and len(word) < 60 and word not in ("UNKNOWN", "BSD"):
            return word
    classifiers = [c.split(" :: ")[-1] for c in stated.get_all("Classifier") or () if c.startswith("License :: ")]
    if classifiers or stated.get("License") == "BSD":
        return ", ".join(classifiers) or "BSD"
    raise SystemExit(f"{name} states no licence: read its licence file and name it in READ of docs/make_licences.py")


def page() -> str:
    """The page, from the lock and the installed packages."""
    users = needed(FOR_USERS)
    rows = [
        (name, written, version, licence(name), "users" if name in users else "work")
        for name, (written, version) in locked(LOCK.read_text()).items()
    ]
    copyleft = [row for row in rows if COPYLEFT.search(row[3])]
    if unsaid := [row[0] for row in copyleft if row[0] not in MEANS]:
        raise SystemExit(f"copyleft, of which MEANS in docs/make_licences.py does not say what it means: {unsaid}")
    return "".join(
        (
            HEAD,
            *(f"| {w} | {said} | {who} | {MEANS[name]} |\n" for name, w, _, said, who in copyleft),
            INSIDE,
            *(f"| {w} | {version} | {said} | {who} |\n" for _, w, version, said, who in rows),
        )
    )


if __name__ == "__main__":
    PAGE.write_text(page())
