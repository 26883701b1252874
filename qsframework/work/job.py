"""What the results of a job depend on, part by part: inputs, options, seed, code."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable, Mapping
from importlib.metadata import entry_points, version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from qsframework.files import sha256
from qsframework.work.carry import value_hash

_LIBRARIES = ("numpy", "scipy", "pin")


def job_of(
    command: str, options: Mapping[str, Any], values: Mapping[str, Any], files: Iterable[Path] = ()
) -> dict[str, str]:
    """The parts of a job for the head of its checkpoint.

    options: plain values, said as they are where two jobs differ; values: of anything loaded, by its hash
    """
    parts = {"command": command}
    parts |= {name: str(value) for name, value in options.items()}
    parts |= {name: value_hash(value) for name, value in values.items()}
    parts |= {f"file {path.name}": sha256(path) for path in files}
    return parts | versions()


def versions() -> dict[str, str]:
    """What computes: Python, the libraries, this package's own code, and third parties' effects."""
    here = {"python": ".".join(map(str, sys.version_info[:3]))} | {name: version(name) for name in _LIBRARIES}
    here["qsframework"] = f"{version('qsframework')} {code_hash()[:16]}"
    others = {e.dist.name: e.dist.version for e in entry_points(group="qsframework.effects") if e.dist is not None}
    others.pop("qsframework", None)
    return here | {name: others[name] for name in sorted(others)}


def code_hash() -> str:
    """Hash of the sources of the package and its physics."""
    specs = [find_spec(name) for name in ("qsframework", "qsf_plugins")]
    folders = [Path(place) for spec in specs if spec for place in (spec.submodule_search_locations or ())[:1]]
    return hashlib.sha256("".join(folder_hash(f, "*.py") for f in folders).encode()).hexdigest()


def folder_hash(folder: Path, pattern: str = "*") -> str:
    """Hash of the names and contents of the files in a folder."""
    digest = hashlib.sha256()
    for path in sorted(p for p in folder.rglob(pattern) if p.is_file() and "__pycache__" not in p.parts):
        digest.update(f"{path.relative_to(folder).as_posix()} {sha256(path)}\n".encode())
    return digest.hexdigest()
