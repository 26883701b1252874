"""Displacements of a file, whichever of the two kinds of readings it holds."""

from __future__ import annotations

from pathlib import Path

from qsframework.experiment import Experiment, Readings, is_states, read_readings, read_states


def read_displacements(experiment: Experiment, source: Path) -> Readings:
    """Readings of a file of displacements, or loaded minus unloaded positions of a file of states."""
    if is_states(source):
        from qsframework.identify.differences import differences

        return differences(read_states(source, experiment), experiment)[0]
    return read_readings(source, experiment)
