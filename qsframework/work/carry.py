"""What goes to another process and comes back: a value that all tasks share, the tasks, and their results."""

from __future__ import annotations

import copyreg
import functools
import io
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt

from qsframework.errors import InputError
from qsframework.work.threads import on_one_thread
from qsframework.work.versions import differences, versions

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


def pack(value: Any) -> bytes:
    """The value as bytes, which `pickle.loads` reads."""
    stream = io.BytesIO()
    _Packer(stream, protocol=5).dump(value)
    return stream.getvalue()


@dataclass(frozen=True)
class Packed:
    """Bytes of a value that many tasks share, and the versions that are to work on it, where these may differ."""

    content: bytes
    versions: tuple[tuple[str, str], ...] = ()


@functools.lru_cache(maxsize=4)  # a command has few kinds of tasks, and each kind has one value
def unpack(packed: Packed) -> Any:
    """The value; the same object for the same bytes, so that what is cached by object stays cached."""
    if packed.versions and (differ := differences(versions(), dict(packed.versions))):
        raise InputError(f"a worker would compute something else ({differ}); install the same versions there")
    return pickle.loads(packed.content)


def at_worker(function: Callable[[Any, Any], Any], packed: Packed, task: bytes) -> bytes:
    """What runs in another process: a result, or the task's own error. Whatever is raised there is not the task's."""
    try:
        return pickle.dumps((on_one_thread(function)(unpack(packed), pickle.loads(task)), None), protocol=5)
    except Exception as error:
        try:
            sent = pickle.dumps((None, error))
            pickle.loads(sent)
        except Exception:
            return pickle.dumps((None, RuntimeError(f"{type(error).__name__}: {error}")))
        return sent


def received(sent: bytes) -> Any:
    """The result of a task that ran in another process; its own error is raised."""
    result, error = pickle.loads(sent)
    if error is not None:
        raise error
    return result


def settled(result: Any) -> Any:
    """A result of this process, as it would come from another one: arrays lie without gaps, nothing is shared."""
    return pickle.loads(pickle.dumps(result, protocol=5))
