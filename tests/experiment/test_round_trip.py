"""What is written is read back: plans and their proof; and what numbers and loads become on the way."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from qsframework.errors import InputError
from qsframework.experiment import (
    Experiment,
    PlanCertificate,
    load_experiment,
    make_plan,
    read_plan,
    read_readings,
    write_plan,
)
from qsframework.experiment.columns import joint_cells, number, recorded
from qsframework.plugin import Poses
from qsframework.units import JointUnits

TURNING = JointUnits((False,))
SAME_FOLDER = settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def random_poses(experiment: Experiment, count: int, seed: int) -> Poses:
    rng = np.random.default_rng(seed)
    controller = experiment.robot.controller
    pendant = rng.uniform(controller.lower, controller.upper, (count, len(controller.lower)))
    wrench = rng.normal(0.0, 10.0 ** rng.integers(-3, 5), (count, 6))
    return Poses(pendant, controller.to_joints(pendant), wrench)


@SAME_FOLDER
@given(st.integers(1, 12), st.integers(0, 10**6))
def test_plans(m900ib: Experiment, tmp_path: Path, count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    certificate = PlanCertificate(
        criterion="D",
        value=0.1 + rng.random(),
        relaxed_value=0.1,
        relaxed_efficiency=0.99999,
        efficiency=0.97,
        candidates=1000,
        poses=count,
        parameters=("a[b].c", "d"),
    )
    loads = [str(w) for w in rng.choice(["weight", "side, pull"], count)]
    poses, repeats = random_poses(m900ib, count, seed), rng.integers(1, 5, count).tolist()
    before = make_plan(poses, loads, repeats, "D", certificate, seed)
    write_plan(tmp_path / "plan.csv", before, m900ib)
    after = read_plan(tmp_path / "plan.csv", m900ib)
    for name in ("pose", "load", "repeats", "criterion", "certificate", "seed"):
        assert getattr(after, name) == getattr(before, name), name
    assert np.allclose(after.pendant, before.pendant, rtol=0, atol=np.deg2rad(1e-9))
    assert np.allclose(after.wrench, before.wrench, rtol=1e-9, atol=0)
    once = (tmp_path / "plan.csv").read_text()
    write_plan(tmp_path / "plan.csv", after, m900ib)
    assert (tmp_path / "plan.csv").read_text() == once
    again = read_plan(tmp_path / "plan.csv", m900ib)
    assert np.array_equal(again.pendant, after.pendant)
    assert np.array_equal(again.wrench, after.wrench)


def test_a_changed_plan_loses_its_proof(m900ib: Experiment, tmp_path: Path) -> None:
    certificate = PlanCertificate(
        criterion="D",
        value=1.0,
        relaxed_value=1.0,
        relaxed_efficiency=1.0,
        efficiency=1.0,
        candidates=10,
        poses=2,
        parameters=("a",),
    )
    path = tmp_path / "plan.csv"
    plan = make_plan(random_poses(m900ib, 2, 0), ["w", "w"], None, "D", certificate, 1)
    write_plan(path, plan, m900ib)
    assert read_plan(path, m900ib).certificate == certificate
    path.write_text(path.read_text().replace(",w,1", ",w,2"))
    assert read_plan(path, m900ib).certificate is None
    path.with_suffix(".json").write_text(json.dumps({"criterion": "D"}))
    with pytest.raises(InputError, match="is not the proof of a plan"):
        read_plan(path, m900ib)
    with pytest.raises(InputError, match=r"name it \.csv"):
        write_plan(tmp_path / "other.json", plan, m900ib)
    assert not (tmp_path / "other.json").exists()


def test_a_hung_mass_is_a_load(tmp_path: Path) -> None:
    path = tmp_path / "experiment.yaml"
    path.write_text(
        "robot: fanuc_m900ib\nload: {mass_kg: 250, centre_mm: [150, 0, 200]}\n"
        "markers: {m1: {xyz_mm: [1, 2, 3]}}\nnoise: estimate\n"
    )
    experiment = load_experiment(path)
    (load,) = experiment.loads
    assert np.allclose(load.wrench, [0, 0, -250 * 9.81, 0, 0, 0])
    assert np.allclose(experiment.load_point, [0.15, 0, 0.2])


def test_a_parameter_named_twice_is_fitted_once(tmp_path: Path, m900ib: Experiment) -> None:
    twice = m900ib.with_(fit=("joint_compliance", "joint_compliance[joint_3]"))
    assert len(set(twice.fit_names())) == len(twice.fit_names()) == 6


def test_many_readings_are_read_in_seconds(r2000ic: Experiment, tmp_path: Path) -> None:
    (data,) = r2000ic.data
    lines = data.read_text().splitlines()
    row = lines[3].split(",", 1)[1]
    path = tmp_path / "many.csv"
    path.write_text("\n".join([*lines[:3], *(f"{i},{row}" for i in range(100_000))]))
    assert len(read_readings(path, r2000ic)) == 100_000


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.9100000000000001, "1.91"),
        (-59.99999999999999, "-60"),
        (-0.0, "0"),
        (1234.5678901234, "1234.56789"),
        (1e-7 / 3, "3.333333333e-08"),
        (-4000.0, "-4000"),
        (123456789012.0, "1.23456789e+11"),
    ],
)
def test_numbers_for_people(value: float, text: str) -> None:
    assert number(value) == text


@given(st.floats(-360.0, 360.0))
def test_angles_keep_a_billionth_of_a_degree(angle: float) -> None:
    (text,) = joint_cells(np.deg2rad([angle]), TURNING)
    assert abs(float(text) - angle) <= 1e-9
    assert joint_cells(np.deg2rad([float(text)]), TURNING) == [text]
    assert len(text.lstrip("-").split("e")[0].replace(".", "").lstrip("0")) <= 12


def test_a_clock_keeps_its_fractions() -> None:
    assert recorded(1763746355.123456) == "1763746355.12346"
