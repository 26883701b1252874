"""Results as one line of text and back, to the last bit: numbers, texts, lists, tuples, dictionaries and arrays.

No pickle: a checkpoint is a file that somebody else may have written, and reading it runs nothing.
"""

from __future__ import annotations

import base64
import json
import math
from typing import Any

import numpy as np

from qsframework.files.plain import is_list, is_mapping, is_tuple

_KINDS = "fiub"


def encode(value: Any) -> str:
    """One line of JSON; TypeError for what is not data."""
    return json.dumps(_plain(value), separators=(",", ":"), allow_nan=False)


def decode(text: str) -> Any:
    """The value of a line; ValueError where it is not one of ours."""
    try:
        return _value(json.loads(text))
    except (KeyError, TypeError) as error:
        raise ValueError(str(error)) from error


def _plain(value: Any) -> Any:
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return _array(value)
    if isinstance(value, int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else {"float": str(value)}
    if is_list(value):
        return [_plain(v) for v in value]
    if is_tuple(value):
        return {"tuple": [_plain(v) for v in value]}
    if is_mapping(value):
        return {"dict": [[_plain(k), _plain(v)] for k, v in value.items()]}
    raise TypeError(f"a {type(value).__name__} cannot be written to a checkpoint")


def _array(value: Any) -> dict[str, Any]:
    array = np.asarray(value)
    if array.dtype.kind not in _KINDS:
        raise TypeError(f"an array of {array.dtype} cannot be written to a checkpoint")
    content = base64.b64encode(np.ascontiguousarray(array).tobytes()).decode("ascii")
    number = not isinstance(value, np.ndarray)
    return {"array": content, "dtype": array.dtype.str, "shape": list(array.shape), "number": number}


def _value(plain: Any) -> Any:
    if is_list(plain):
        return [_value(v) for v in plain]
    if not is_mapping(plain):
        return plain
    if "float" in plain:
        return float(plain["float"])
    if "tuple" in plain:
        return tuple(_value(v) for v in plain["tuple"])
    if "dict" in plain:
        return {_value(k): _value(v) for k, v in plain["dict"]}
    dtype = np.dtype(plain["dtype"])
    if dtype.kind not in _KINDS:
        raise ValueError(f"an array of {dtype}")
    array = np.frombuffer(base64.b64decode(plain["array"], validate=True), dtype).reshape(plain["shape"]).copy()
    return array[()] if plain["number"] else array
