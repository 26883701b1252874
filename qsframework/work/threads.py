"""Linear algebra on one thread: more threads add in another order, and small problems only wait for them."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager
from functools import lru_cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController


def single_thread() -> AbstractContextManager[Any]:
    """While it is open, every loaded library of linear algebra keeps to one thread."""
    return _controller(len(sys.modules)).limit(limits=1, user_api="blas")


@lru_cache(maxsize=1)
def _controller(modules: int) -> ThreadpoolController:
    """The loaded linear algebra, looked up again (5 ms) whenever a module has been imported since."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
