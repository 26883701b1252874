"""The errors that plugins raise, and how their messages are made."""

from qsframework.errors import InputError, Problem, nearest, refuse, some_of

__all__ = ["InputError", "Problem", "nearest", "refuse", "some_of"]
