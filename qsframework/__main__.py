"""`python -m qsframework` is `qsf`."""

from qsframework.cli import main

main()
