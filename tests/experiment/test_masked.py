"""A masked row may hold what made it unusable."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from qsframework.errors import InputError
from qsframework.experiment import example, load_experiment, read_readings
from qsframework.fits import identify


@pytest.mark.parametrize("cell", ["", "nan", "9999", "lost beam"])
def test_a_masked_reading_may_be_anything(tmp_path: Path, cell: str) -> None:
    shutil.copytree(example("r2000ic"), tmp_path / "e")
    file = tmp_path / "e" / "readings.csv"
    lines = file.read_text().splitlines()
    lines[2] += ",use"
    for i in range(3, len(lines)):
        lines[i] += ",1"
    parts = lines[5].split(",")
    parts[13], parts[14] = cell, "0"
    lines[5] = ",".join(parts)
    file.write_text("\n".join(lines))
    experiment = load_experiment(tmp_path / "e" / "experiment.yaml")
    readings = read_readings(file, experiment)
    assert readings.use.sum() == 42
    fit = identify(experiment, readings)
    assert len(fit.lines) == 42
    assert np.isfinite(fit.rms)
    file.write_text(file.read_text().replace(",0\n", ",1\n"))
    if cell != "":
        with pytest.raises(InputError, match="dz_mm"):
            read_readings(file, experiment)
