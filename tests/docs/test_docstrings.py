"""Every verb of the front door says what it does, what it takes, what it returns and what it raises."""

from __future__ import annotations

import inspect
import re

import pytest

import qsframework as qsf

VERBS = [name for name in dir(qsf) if inspect.isfunction(getattr(qsf, name))]
CLASSES = [name for name in dir(qsf) if inspect.isclass(getattr(qsf, name))]


@pytest.mark.parametrize("name", VERBS)
def test_a_verb_lists_what_it_takes_returns_and_raises(name: str) -> None:
    verb = getattr(qsf, name)
    doc = inspect.getdoc(verb) or ""
    assert [part for part in ("\nArgs:\n", "\nRaises:\n") if part not in doc] == []
    assert ("\nReturns:\n" in doc) == (inspect.signature(verb).return_annotation != "None")
    assert doc.splitlines()[0].endswith((".", ","))
    listed = re.split(r"\n(?:Returns|Raises):\n", doc.partition("\nArgs:\n")[2])[0]
    named = re.findall(r"^    (\w+): ", listed, re.M)
    assert named == list(inspect.signature(verb).parameters)


@pytest.mark.parametrize("name", CLASSES)
def test_a_class_says_what_it_is(name: str) -> None:
    assert len((getattr(qsf, name).__doc__ or "").split()) > 3
