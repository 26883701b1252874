"""What computes: a worker with other versions would compute something else."""

from __future__ import annotations

import functools
import hashlib
import sys
from collections.abc import Mapping
from importlib.metadata import entry_points, version
from importlib.util import find_spec
from pathlib import Path

from qsframework.files import sha256
from qsframework.installed import EFFECTS


@functools.cache
def versions() -> dict[str, str]:
    """Python, the libraries, third parties' effects, and this package's own sources, each by its name."""
    effects = [(e.module.partition(".")[0], e.dist) for e in entry_points(group=EFFECTS) if e.dist is not None]
    found = {dist.name: dist.version for _, dist in effects}
    found |= {name: version(name) for name in ("numpy", "scipy", "pin", "qsframework")}
    digest = hashlib.sha256()
    for spec in filter(
        None, map(find_spec, sorted({"qsframework", *(own for own, dist in effects if dist.name == "qsframework")}))
    ):
        folder = Path((spec.submodule_search_locations or ["."])[0])
        for path in sorted(folder.rglob("*.py")):
            digest.update(f"{path.relative_to(folder).as_posix()} {sha256(path)}\n".encode())
    found["qsframework"] += f" {digest.hexdigest()[:16]}"
    return {"python": ".".join(map(str, sys.version_info[:3]))} | dict(sorted(found.items()))


def differences(there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """The versions that differ, in words; empty where all are the same."""
    pairs = {name: (there.get(name, "nothing"), here.get(name, "nothing")) for name in dict.fromkeys([*here, *there])}
    return "; ".join(f"{name}: {a} there, {b} here" for name, (a, b) in pairs.items() if a != b)
