"""What a function works on, carried to another process: packed once, unpacked once in each worker."""

from __future__ import annotations

import copyreg
import functools
import io
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from qsframework.errors import InputError
from qsframework.work.job import differences, versions
from qsframework.work.threads import on_one_thread

Array = npt.NDArray[Any]


def _view(content: dict[Any, Any]) -> Mapping[Any, Any]:
    return MappingProxyType(content)


def _strided(base: Array, offset: int, shape: tuple[int, ...], strides: tuple[int, ...], dtype: str) -> Array:
    return np.ndarray(shape, np.dtype(dtype), base, offset, strides)


class _Packer(pickle.Pickler):
    """Pickle, with the read-only mappings of a robot's links, and arrays as they lie in memory, gaps included.

    Sums over memory with gaps are added in another order than without, so that their last bits differ.
    """

    dispatch_table = dict(copyreg.dispatch_table)  # noqa: RUF012 - as pickle has it
    dispatch_table[MappingProxyType] = lambda view: (_view, (dict(view),))

    def reducer_override(self, obj: Any) -> Any:
        base = obj.base if type(obj) is np.ndarray and not obj.flags.forc else None
        if not isinstance(base, np.ndarray) or not base.flags.forc or obj.dtype.hasobject:
            return NotImplemented
        offset = obj.__array_interface__["data"][0] - base.__array_interface__["data"][0]
        return _strided, (base, offset, obj.shape, obj.strides, obj.dtype.str)


@dataclass(frozen=True)
class Packed:
    """Bytes of a value, and the versions that are to work on it."""

    content: bytes
    versions: tuple[tuple[str, str], ...]


def pack(value: Any) -> Packed:
    """The value as bytes."""
    stream = io.BytesIO()
    _Packer(stream, protocol=5).dump(value)
    return Packed(stream.getvalue(), tuple(versions().items()))


@functools.lru_cache(maxsize=4)  # a command has few stages, and each has one value
def unpack(packed: Packed) -> Any:
    """The value; the same object for the same bytes, so that what is cached by object stays cached."""
    if differ := differences(versions(), dict(packed.versions)):
        raise InputError(f"a worker would compute something else ({differ}); install the same versions there")
    return pickle.loads(packed.content)


def at_worker(function: Callable[[Any, Any], Any], packed: Any, task: Any) -> tuple[Any, Exception | None]:
    """What runs in another process: a result, or the task's own error. Whatever is raised there is not the task's."""
    try:
        return on_one_thread(function)(unpack(packed), task), None
    except Exception as error:
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:
            return None, RuntimeError(f"{type(error).__name__}: {error}")
        return None, error


def settled(result: Any) -> Any:
    """A result as it comes from elsewhere: numbers of Python's, tuples as lists, arrays without gaps."""
    if isinstance(result, np.ndarray | np.generic):
        array = cast(Array, result)
        return np.ascontiguousarray(array) if array.ndim else array.item()
    if isinstance(result, tuple | list):
        return [settled(v) for v in cast(list[Any], result)]
    if isinstance(result, dict):
        return {key: settled(v) for key, v in cast(dict[Any, Any], result).items()}
    return result
