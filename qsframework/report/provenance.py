"""How a report was computed: versions, seeds, hashes, equations and sources."""

from __future__ import annotations

import importlib.metadata
import platform
from collections.abc import Sequence
from pathlib import Path

from qsframework.files import sha256
from qsframework.plugin import Effect
from qsframework.report.page import Section, Table, Text

PROVENANCE = "How this was computed"
_PACKAGES = ("qsframework", "pin", "numpy", "scipy", "cvxpy", "clarabel")


def provenance_section(effects: Sequence[Effect], files: Sequence[Path], seed: int | None) -> Section:
    """What is needed to compute the report again."""
    versions = [("Python", platform.python_version())]
    versions += [(name, importlib.metadata.version(name)) for name in _PACKAGES]
    hashes = tuple((path.name, sha256(path)[:16]) for path in files)
    unique = {type(e): e for e in effects}
    laws = tuple((k.effect_name(), (k.__doc__ or "").split("\n")[0], k.source) for k in unique)
    return Section(
        PROVENANCE,
        (
            Text(
                "A displacement reading is the loaded minus the unloaded position of a marker in the base frame. "
                "Linear model: eps = (diag(1/c) + K_par(q))^-1 D' w and t = D eps (equations (1)-(5) and (10) of the "
                "paper)." + ("" if seed is None else f" Random numbers from seed {seed}.")
            ),
            Table(("software", "version"), tuple(versions)),
            Table(("file", "SHA-256, first 16 digits"), hashes),
            Table(("effect", "physics", "source"), laws),
        ),
    )
