from concurrent.futures import Executor

class _Reusable(Executor):
    def shutdown(self, wait: bool = ..., kill_workers: bool = ...) -> None: ...  # pyright: ignore[reportIncompatibleMethodOverride]

def get_reusable_executor(max_workers: int | None = ..., timeout: float | None = ...) -> _Reusable: ...
