from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any

class _Reusable(Executor):
    def shutdown(self, wait: bool = ..., kill_workers: bool = ...) -> None: ...  # pyright: ignore[reportIncompatibleMethodOverride]

def get_reusable_executor(
    max_workers: int | None = ...,
    timeout: float | None = ...,
    initializer: Callable[..., object] | None = ...,
    initargs: tuple[Any, ...] = ...,
    env: dict[str, str] | None = ...,
) -> _Reusable: ...
