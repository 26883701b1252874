"""Linear algebra on one thread: more threads add in another order, and small problems only wait for them."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


def on_one_thread(verb: Callable[P, T]) -> Callable[P, T]:
    """The verb, with linear algebra on one thread while it runs."""

    @functools.wraps(verb)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        with single_thread():
            return verb(*args, **kwargs)

    return run


def single_thread() -> AbstractContextManager[Any]:
    """While it is open, every loaded library of linear algebra keeps to one thread."""
    return _controller(len(sys.modules)).limit(limits=1, user_api="blas")


@functools.lru_cache(maxsize=1)
def _controller(modules: int) -> Any:
    """The loaded linear algebra, looked up again (5 ms) whenever a module has been imported since."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
