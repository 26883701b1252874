"""The command line `qsf`: it parses, calls and prints."""

from qsframework.cli.main import main

__all__ = ["main"]
