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

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

_HELD = 4
"""Unpacked values that a worker keeps: a command has few stages, and each has one."""
Array = npt.NDArray[Any]
_unpacked: OrderedDict[str, Any] = OrderedDict()


def _view(content: dict[Any, Any]) -> MappingProxyType[Any, Any]:
    return MappingProxyType(content)


def _strided(base: Array, offset: int, shape: tuple[int, ...], strides: tuple[int, ...], dtype: str) -> Array:
    return np.ndarray(shape, np.dtype(dtype), base, offset, strides)


def _layout(array: Array) -> Any:
    """How to make an array with gaps again, gaps included; other arrays keep their layout anyway.

    Sums over memory with gaps are added in another order than without, so that their last bits differ.
    """
    base = array.base
    if array.flags.forc or not isinstance(base, np.ndarray) or not base.flags.forc or array.dtype.hasobject:
        return NotImplemented
    offset = array.__array_interface__["data"][0] - base.__array_interface__["data"][0]
    return _strided, (base, offset, array.shape, array.strides, array.dtype.str)


class _Packer(pickle.Pickler):
    """Pickle, with the read-only mappings of a robot's links, and arrays as they lie in memory."""

    def reducer_override(self, obj: Any) -> Any:
        return _layout(obj) if type(obj) is np.ndarray else NotImplemented

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


def settled(result: Any) -> Any:
    """A result of tuples, lists, dictionaries and arrays, these without gaps: as it comes from elsewhere."""
    if isinstance(result, np.ndarray):
        return np.ascontiguousarray(result) if result.ndim else result
    if isinstance(result, tuple | list):
        return type(result)(map(settled, result))  # pyright: ignore[reportUnknownArgumentType, reportUnknownVariableType]
    if isinstance(result, dict):
        return {key: settled(value) for key, value in result.items()}  # pyright: ignore[reportUnknownVariableType]
    return result


def at_worker(function: Callable[[Any, Any], Any], packed: Packed, task: Any) -> Any:
    """What runs in another process."""
    return one_thread(function, unpack(packed), task)
