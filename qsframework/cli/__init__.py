"""The command line `qsf`, and the public API for commands: everything that a third party's command imports.

A command is a function with one entry point in `qsframework.commands`, whose name is the command's. Its parameters are
records of options (`qsframework.option.Option`), or annotated one by one; its docstring's first line is its help.
"""

import sys

from lazy_loader import attach_stub

_named, __dir__, __all__ = attach_stub(__name__, __file__)


def __getattr__(name: str) -> object:
    """A name of the door; Ctrl-C while the command line itself is loaded ends it: nothing has been done yet."""
    try:
        return _named(name)
    except KeyboardInterrupt:
        sys.exit(130)
