"""The number of a result file's format: 1 more whenever an older qsframework would read the file wrongly."""

from __future__ import annotations

from qsframework.errors import InputError, Problem
from qsframework.files.documents import Document

FORMAT = 1
"""Of every JSON result that qsframework writes now. Files without the number are of format 1."""


def check_format(document: Document) -> None:
    """InputError where a file is of a format that this qsframework does not know."""
    found = document.data.get("format", 1)
    if found is True or found is False or not isinstance(found, int) or not 1 <= found <= FORMAT:
        newer = isinstance(found, int) and found > FORMAT
        raise InputError(
            Problem(
                "the file is of a format that this qsframework does not read",
                str(document.path),
                document.line("format"),
                "format",
                found=repr(found),
                allowed=str(FORMAT) if FORMAT == 1 else f"1 to {FORMAT}",
                hint="A newer qsframework wrote it; update this one." if newer else None,
            )
        )
