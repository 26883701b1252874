"""What Ctrl-C and a polite kill do to a command: files are left whole, and one line says that it stopped."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Stopped(BaseException):
    """A signal that ends the command. Not an Exception, nor a KeyboardInterrupt, which typer takes for its own."""

    def __init__(self, number: int):
        self.number = number
        super().__init__(signal.Signals(number).name)

    @property
    def code(self) -> int:
        """The exit code, as shells have it: 130 after Ctrl-C."""
        return 128 + self.number


@contextmanager
def listening() -> Generator[None, None, None]:
    """Within, these signals raise `Stopped`; a second one ends the process at once."""
    here = threading.current_thread() is threading.main_thread()  # no other thread may listen
    before = [(number, signal.signal(number, _stop)) for number in _SIGNALS] if here else []
    hook, show = sys.unraisablehook, sys.excepthook
    sys.unraisablehook = lambda lost: _lost(lost.exc_value, lambda: hook(lost))
    # compiled code that cannot raise may first print the traceback of what it loses
    sys.excepthook = lambda kind, error, trace: _lost(error, lambda: show(kind, error, trace))
    try:
        yield
    finally:
        sys.unraisablehook, sys.excepthook = hook, show
        for number, handler in before:
            signal.signal(number, handler)


def _lost(error: BaseException | None, otherwise: Callable[[], object]) -> None:
    """End at once where compiled code swallowed the signal: it would go on with what it was half through."""
    if not isinstance(error, Stopped):
        otherwise()
        return
    os.write(2, b"Interrupted. No partial files were left.\n")
    os._exit(error.code)


def _stop(number: int, frame: FrameType | None) -> NoReturn:
    for each in _SIGNALS:
        signal.signal(each, _stop_now)
    raise Stopped(number)


def _stop_now(number: int, frame: FrameType | None) -> NoReturn:
    os._exit(128 + number)
