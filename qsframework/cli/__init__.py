"""The command line `qsf`: it parses, calls and prints."""

import sys

try:
    from qsframework.cli.main import main
except KeyboardInterrupt:  # Ctrl-C while the command line itself is loaded: nothing has been done yet
    sys.exit(130)

__all__ = ["main"]
