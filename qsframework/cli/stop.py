"""What Ctrl-C and a polite kill do to a command: files are left whole, and one line says that it stopped."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Generator
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
    try:
        yield
    finally:
        for number, handler in before:
            signal.signal(number, handler)


def _stop(number: int, frame: FrameType | None) -> NoReturn:
    for each in _SIGNALS:
        signal.signal(each, _stop_now)
    raise Stopped(number)


def _stop_now(number: int, frame: FrameType | None) -> NoReturn:
    os._exit(128 + number)
