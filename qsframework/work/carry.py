"""What a function works on, carried to another process: packed once, unpacked once in each worker."""

from __future__ import annotations

import copyreg
import hashlib
import io
import pickle
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import PurePath
from types import FunctionType, MappingProxyType
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from qsframework.work.threads import on_one_thread

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


def _value(kind: str, *content: Any) -> tuple[Any, ...]:
    return kind, *content


class _Hasher(pickle.Pickler):
    """Bytes to hash: what a value says, not how it came about, nor the folder that its files lie in."""

    def reducer_override(self, obj: Any) -> Any:
        kind = f"{type(obj).__module__}.{type(obj).__qualname__}"
        if isinstance(obj, np.ndarray):
            array = cast(Array, obj)
            return _value, (kind, array.dtype.str, array.shape, array.tobytes())
        if isinstance(obj, PurePath):
            return _value, (kind, obj.name)
        if isinstance(obj, MappingProxyType):
            return _value, (kind, dict(cast(Mapping[Any, Any], obj)))
        if not hasattr(obj, "__dict__") or isinstance(obj, type | FunctionType):
            return NotImplemented
        state = cast(dict[str, Any], vars(obj))
        return _value, (kind, [(k, _ordered(state[k])) for k in sorted(state) if not _is_cache(obj, k)])


def _ordered(value: Any) -> Any:
    return sorted(map(repr, cast(set[Any], value))) if isinstance(value, set | frozenset) else value


def _is_cache(obj: Any, name: str) -> bool:
    return isinstance(getattr(cast(type[Any], type(obj)), name, None), cached_property)


@dataclass(frozen=True)
class Packed:
    """Bytes of a value, and their hash."""

    content: bytes
    digest: str


def pack(value: Any) -> Packed:
    """The value as bytes."""
    stream = io.BytesIO()
    _Packer(stream, protocol=5).dump(value)
    return Packed(stream.getvalue(), hashlib.sha256(stream.getvalue()).hexdigest())


def value_hash(value: Any) -> str:
    """Hash of all that a value holds, the same in every process and every folder."""
    stream = io.BytesIO()
    hasher = _Hasher(stream, protocol=5)
    hasher.fast = (
        True  # no references from one part to another: equal values in two places, or one in both, are the same
    )
    hasher.dump(value)
    return hashlib.sha256(stream.getvalue()).hexdigest()


def unpack(packed: Packed) -> Any:
    """The value; the same object for the same bytes, so that what is cached by object stays cached."""
    if packed.digest in _unpacked:
        _unpacked.move_to_end(packed.digest)
    else:
        _unpacked[packed.digest] = pickle.loads(packed.content)
        while len(_unpacked) > _HELD:
            _unpacked.popitem(last=False)
    return _unpacked[packed.digest]


def settled(result: Any) -> Any:
    """A result of tuples, lists, dictionaries and arrays, these without gaps: as it comes from elsewhere."""
    if isinstance(result, np.ndarray):
        array = cast(Array, result)
        return np.ascontiguousarray(array) if array.ndim else array
    if isinstance(result, tuple):
        return tuple(settled(v) for v in cast(tuple[Any, ...], result))
    if isinstance(result, list):
        return [settled(v) for v in cast(list[Any], result)]
    if isinstance(result, dict):
        return {key: settled(v) for key, v in cast(dict[Any, Any], result).items()}
    return result


def at_worker(function: Callable[[Any, Any], Any], packed: Packed, task: Any) -> Any:
    """What runs in another process."""
    return on_one_thread(function)(unpack(packed), task)
