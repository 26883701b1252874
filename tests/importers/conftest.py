"""Shared by the tests of imports: what is found in readings, once for all exports of the same campaign."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from remembered import asked

import qsframework.screening
from qsframework.experiment import Experiment, Readings
from qsframework.screening import Mistake, find_mistakes


@pytest.fixture(scope="session", autouse=True)
def _looked_at_once() -> Iterator[None]:
    """Dozens of exports are of one campaign and read to the last digit alike: where nothing is wrong with its readings,
    that is found once. What is said of lines and files is found anew."""
    fine = set[bytes]()

    def looked(experiment: Experiment, readings: Readings) -> tuple[Mistake, ...]:
        nowhere = np.zeros_like(readings.line)
        bare = replace(readings, line=nowhere, file=nowhere, sources=())
        key = asked([experiment.path], experiment, bare)
        found = () if key in fine else find_mistakes(experiment, readings)
        if not found:
            fine.add(key)
        return found

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(qsframework.screening, "find_mistakes", looked)
        yield
