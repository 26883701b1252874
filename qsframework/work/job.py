"""What the results of a job depend on, part by part: inputs, options, seed, code."""

from __future__ import annotations

import functools
import hashlib
import io
import pickle
import sys
from collections.abc import Iterable, Mapping
from importlib.metadata import entry_points, version
from importlib.util import find_spec
from pathlib import Path, PurePath
from types import FunctionType, MappingProxyType
from typing import Any, cast

import numpy as np

from qsframework.files import sha256


def job_of(
    command: str, options: Mapping[str, Any], values: Mapping[str, Any], files: Iterable[Path] = ()
) -> dict[str, str]:
    """The parts of a job: options, said as they are where two jobs differ; anything loaded and files, by their hash."""
    parts = {"command": command} | {name: str(value) for name, value in options.items()}
    parts |= {name: _hash_of(value) for name, value in values.items()}
    return parts | {f"file {path.name}": sha256(path) for path in files} | versions()


@functools.cache
def versions() -> dict[str, str]:
    """What computes: Python, the libraries, third parties' effects, and this package's own sources."""
    found = {e.dist.name: e.dist.version for e in entry_points(group="qsframework.effects") if e.dist is not None}
    found |= {name: version(name) for name in ("numpy", "scipy", "pin", "qsframework")}
    digest = hashlib.sha256()
    for spec in filter(None, map(find_spec, ("qsframework", "qsf_plugins"))):
        folder = Path((spec.submodule_search_locations or ["."])[0])
        for path in sorted(folder.rglob("*.py")):
            digest.update(f"{path.relative_to(folder).as_posix()} {sha256(path)}\n".encode())
    found["qsframework"] += f" {digest.hexdigest()[:16]}"
    return {"python": ".".join(map(str, sys.version_info[:3]))} | dict(sorted(found.items()))


def differences(there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """The parts in which two jobs differ, in words; empty where they are the same."""
    both = ((n, there.get(n, "nothing"), here.get(n, "nothing")) for n in dict.fromkeys([*here, *there]))
    short = ((n, *(t if len(t) <= 40 else f"{t[:12]}..." for t in pair)) for n, *pair in both if pair[0] != pair[1])
    return "; ".join(f"{n}: {a} there, {b} here" for n, a, b in short)


def _value(*content: Any) -> tuple[Any, ...]:
    return content


class _Hasher(pickle.Pickler):
    """Bytes to hash: what a value says, not how it came about, nor the folder that its files lie in."""

    def reducer_override(self, obj: Any) -> Any:
        made = cast(Any, type(obj))
        if made is np.ndarray:
            says: Any = (obj.dtype.str, obj.shape, obj.tobytes())
        elif isinstance(obj, PurePath):
            says = obj.name
        elif made is MappingProxyType:
            says = dict(obj)
        elif isinstance(obj, set | frozenset):
            says = sorted(map(repr, cast(set[Any], obj)))
        elif hasattr(obj, "__dict__") and not isinstance(obj, type | FunctionType):
            cached = functools.cached_property  # what a value has worked out meanwhile is not what it says
            held = cast(dict[str, Any], vars(obj))
            says = [(k, v) for k, v in sorted(held.items()) if not isinstance(getattr(made, k, None), cached)]
        else:
            return NotImplemented
        return _value, (f"{made.__module__}.{made.__qualname__}", says)


def _hash_of(value: Any) -> str:
    """Hash of all that a value holds, the same in every process and every folder."""
    stream = io.BytesIO()
    hasher = _Hasher(stream, protocol=5)
    hasher.fast = True  # equal values in two places, or one value in both, are the same
    hasher.dump(value)
    return hashlib.sha256(stream.getvalue()).hexdigest()
