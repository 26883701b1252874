"""What a function works on, carried to another process: packed once, unpacked once in each worker."""

from __future__ import annotations

import copyreg
import hashlib
import io
import pickle
import sys
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

_HELD = 4
"""Unpacked values that a worker keeps: a command has few stages, and each has one."""
_unpacked: OrderedDict[str, Any] = OrderedDict()


def _view(content: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(content)


class _Packer(pickle.Pickler):
    """Pickle, and the read-only mappings of a robot's links."""

    dispatch_table = dict(copyreg.dispatch_table)  # noqa: RUF012 - as pickle has it
    dispatch_table[MappingProxyType] = lambda view: (_view, (dict(view),))


class _Hasher(_Packer):
    """Bytes to hash: of a path the name only, so that the same files in another folder are the same."""

    dispatch_table = dict(_Packer.dispatch_table)  # noqa: RUF012 - as pickle has it
    dispatch_table[type(Path())] = lambda path: (Path, (path.name,))


@dataclass(frozen=True)
class Packed:
    """Bytes of a value, and their hash."""

    content: bytes
    digest: str


def pack(value: Any) -> Packed:
    """The value as bytes."""
    content = _dumped(_Packer, value)
    return Packed(content, hashlib.sha256(content).hexdigest())


def value_hash(value: Any) -> str:
    """Hash of all that a value holds, the same in every process and every folder."""
    return hashlib.sha256(_dumped(_Hasher, value)).hexdigest()


def _dumped(packer: type[_Packer], value: Any) -> bytes:
    stream = io.BytesIO()
    packer(stream, protocol=5).dump(value)
    return stream.getvalue()


def unpack(packed: Packed) -> Any:
    """The value; the same object for the same bytes, so that what is cached by object stays cached."""
    if packed.digest in _unpacked:
        _unpacked.move_to_end(packed.digest)
    else:
        _unpacked[packed.digest] = pickle.loads(packed.content)
        while len(_unpacked) > _HELD:
            _unpacked.popitem(last=False)
    return _unpacked[packed.digest]


def one_thread(function: Callable[[Any, Any], Any], shared: Any, task: Any) -> Any:
    """function(shared, task) with linear algebra on one thread: more threads add in another order."""
    with _controller(len(sys.modules)).limit(limits=1, user_api="blas"):
        return function(shared, task)


@lru_cache(maxsize=1)
def _controller(modules: int) -> ThreadpoolController:
    """The loaded linear algebra, looked up again (5 ms) whenever a module has been imported since."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def at_worker(function: Callable[[Any, Any], Any], packed: Packed, task: Any) -> Any:
    """What runs in another process."""
    return one_thread(function, unpack(packed), task)
