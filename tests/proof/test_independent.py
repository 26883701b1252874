"""Campaigns that another code has made: what is hidden in them is named, and nothing where nothing is."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from qsframework.diagnose import Diagnosis, diagnose
from qsframework.elastostatics import equilibrium
from qsframework.experiment import load_experiment, read_readings
from qsframework.report.words.diagnosis import diagnosis_words

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from independent import (
    HEAVY,
    SMALL,
    Arm,
    Hidden,
    Turn,
    campaign,
    equilibrium as theirs,
)

ARMS = {"heavy": HEAVY, "small": SMALL}


def answer(arm: Arm, hidden: Hidden, folder: Path, **how: float) -> Diagnosis:
    path = campaign(arm, hidden, folder, **how)
    experiment = load_experiment(path)
    return diagnose(experiment, read_readings(experiment.data, experiment), repeats=1)


@pytest.mark.parametrize("name", ARMS)
def test_both_codes_put_the_arm_at_one_place(name: str, tmp_path: Path) -> None:
    """Positions under weight and load, of ten poses, to a nanometre."""
    arm = ARMS[name]
    experiment = load_experiment(campaign(arm, Hidden(), tmp_path, poses=10, sigma=1e-6))
    poses = read_readings(experiment.data, experiment).poses
    model = experiment.model()
    ours = equilibrium(model, poses, model.nominal, True).markers
    for q, wrench, markers in zip(poses.q, poses.wrench, ours, strict=True):
        other = theirs(arm, Hidden(), np.array(arm.compliance), q, wrench[:3])
        np.testing.assert_allclose(markers, other, atol=1e-9)


def _hardening(c3: float, joint: int) -> Hidden:
    return Hidden(law=lambda torque, q: np.eye(6)[joint] * c3 * torque[joint] ** 3)


def _wave(size: float, joint: int, n: int) -> Hidden:
    return Hidden(law=lambda torque, q: np.eye(6)[joint] * size * np.sin(n * q[joint]) * torque[joint])


CASES = {
    "bearing": (HEAVY, Hidden((Turn(3, (0, 0, 1), 2e-7),)), "offaxis_compliance[j4/z]"),
    "pedestal": (HEAVY, Hidden((Turn(0, (0, 1, 0), 4e-8, foot=True),)), "base_compliance[ry]"),
    "hardening": (HEAVY, _hardening(-2.5e-16, 2), "joint_hardening[j3]"),
    "gear waves": (HEAVY, _wave(1.2e-7, 2, 1), "gear_waves[j3]"),
    "small bearing": (SMALL, Hidden((Turn(3, (0, 0, 1), 4e-6),)), "offaxis_compliance[j4/z]"),
}


@pytest.mark.parametrize("case", CASES)
def test_what_another_code_hides_is_named(case: str, tmp_path: Path) -> None:
    """The cause itself or one that does the same, its held-out error near the noise, nothing else."""
    arm, hidden, wanted = CASES[case]
    found = answer(arm, hidden, tmp_path)
    named = {name for f in found.findings for name in (f.name, *(r.name for r in f.rivals))}
    assert wanted in named, diagnosis_words(found)
    assert len(found.findings) == 1, diagnosis_words(found)
    assert found.verdict != "unexplained"
    assert found.rms.heldout_extended < 1.25 * 3e-5
    assert found.rms.heldout_identified > 1.3 * found.rms.heldout_extended


@pytest.mark.parametrize(("poses", "shared"), [(12, 0.0), (12, 5e-5)])
def test_nothing_is_named_where_another_code_hides_nothing(poses: int, shared: float, tmp_path: Path) -> None:
    """Of six at most two: three have a probability of 0.1 % at the level of 4 %."""
    alarms = 0
    for seed in range(6):
        found = answer(HEAVY, Hidden(), tmp_path / str(seed), poses=poses, seed=seed, shared=shared)
        alarms += bool(found.findings or found.leftovers)
    assert alarms <= 2
