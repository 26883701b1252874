"""Options of the form NAME=VALUE."""

from __future__ import annotations

from collections.abc import Sequence

from qsframework.errors import InputError, Problem


def pairs(option: str, texts: Sequence[str], form: str) -> dict[str, str]:
    """NAME=VALUE options by name, joined by commas or given one by one; a comma inside a name or a value
    stays in it."""
    split: list[str] = []
    for text in texts:
        for k, part in enumerate(text.split(",")):
            if "=" in part or not k:
                split.append(part)
            else:
                split[-1] += f",{part}"
    wrong = [text for text in split if not text.partition("=")[0] or not text.partition("=")[2]]
    if wrong:
        raise InputError(Problem(f"{option}: not understood", found=repr(wrong[0]), allowed=form))
    return {name: value for name, _, value in (text.partition("=") for text in split)}
