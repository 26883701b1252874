"""Each defect planted in simulated readings is found with its rows; clean readings are left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qsframework.experiment import Experiment, Plan, Readings, make_plan, read_readings, simulate
from qsframework.identify import identify
from qsframework.identify.hygiene import Finding, check_readings, masked
from qsframework.identify.mistakes import _exchanges, _orders
from qsframework.identify.noise import noise_parts
from qsframework.identify.observations import Independent
from qsframework.identify.trial import trial
from qsframework.plugin import Poses


@pytest.fixture(scope="module")
def plan(m900ib: Experiment) -> Plan:
    rng = np.random.default_rng(4)
    controller = m900ib.robot.controller
    pendant = rng.uniform(controller.lower, controller.upper, (14, 6)) * 0.7
    wrench = np.tile([0.0, 1500.0, -4000.0, 0, 0, 0], (14, 1))
    return make_plan(Poses(pendant, controller.to_joints(pendant), wrench), ["pull"] * 14)


def clean(experiment: Experiment, plan: Plan, seed: int = 0) -> Readings:
    return simulate(experiment, plan, truth="drawn", seed=seed).readings


def only(found: tuple[Finding, ...], kind: str) -> Finding:
    assert [f.kind for f in found] == [kind], [(f.kind, f.words) for f in found]
    return found[0]


def spoil(readings: Readings, rows: list[int], change: np.ndarray) -> Readings:
    displacement = np.array(readings.displacement)
    displacement[rows] = displacement[rows] + change
    return replace(readings, displacement=displacement)


NOISE = pytest.mark.parametrize("stated", [True, False])


def experiment_of(m900ib: Experiment, stated: bool) -> Experiment:
    return m900ib if stated else m900ib.with_(noise=replace(m900ib.noise, sigma=None))


SIMULATED = 200


def test_clean_readings_are_left_alone(m900ib: Experiment, plan: Plan) -> None:
    """At a level of 5 % at most 10 of 200 clean campaigns have any finding, and 3 sigma of the binomial beyond."""
    wrong = {True: 0, False: 0}
    for seed in range(SIMULATED // 2):
        for stated in (True, False):
            found = check_readings(experiment_of(m900ib, stated), clean(m900ib, plan, seed), level=0.05)
            wrong[stated] += bool(found)
    for count in wrong.values():
        assert count <= 5 + 3.0 * np.sqrt(100 * 0.05 * 0.95)


@NOISE
def test_a_zero_and_a_copied_row(m900ib: Experiment, plan: Plan, stated: bool) -> None:
    readings = clean(m900ib, plan)
    displacement = np.array(readings.displacement)
    displacement[7] = 0.0
    displacement[20] = displacement[12]
    found = check_readings(experiment_of(m900ib, stated), replace(readings, displacement=displacement))
    assert [f.kind for f in found] == ["zero", "duplicate"]
    assert found[0].rows == (readings.rows[7],)
    assert found[1].rows == (readings.rows[20],)
    assert f"row {readings.rows[12]}" in found[1].words


@NOISE
def test_gross_errors_are_named_one_by_one(m900ib: Experiment, plan: Plan, stated: bool) -> None:
    readings = spoil(clean(m900ib, plan), [5, 30], np.array([[0.0, 0.5e-3, 0.0], [0.4e-3, 0.0, 0.0]]))
    found = check_readings(experiment_of(m900ib, stated), readings)
    assert {f.kind for f in found} == {"gross"}
    assert {f.rows[0] for f in found} == {readings.rows[5], readings.rows[30]}


@NOISE
def test_swapped_markers_of_a_pose_are_named(m900ib: Experiment, plan: Plan, stated: bool) -> None:
    readings = clean(m900ib, plan)
    displacement = np.array(readings.displacement)
    displacement[[9, 11]] = displacement[[11, 9]]
    finding = only(check_readings(experiment_of(m900ib, stated), replace(readings, displacement=displacement)),
                   "swapped markers")  # fmt: skip
    assert finding.rows == (readings.rows[9], readings.rows[11])
    assert "m1 and m3" in finding.words


@NOISE
def test_markers_swapped_everywhere_are_named(m900ib: Experiment, plan: Plan, stated: bool) -> None:
    readings = clean(m900ib, plan)
    marker = np.where(readings.marker == 0, 1, np.where(readings.marker == 1, 0, readings.marker))
    finding = only(check_readings(experiment_of(m900ib, stated), replace(readings, marker=marker)), "swapped markers")
    assert "m1 and m2 are exchanged at all poses" in finding.words
    assert finding.mask.sum() == 28


@NOISE
@pytest.mark.parametrize("source", [[10, 11, 9], [11, 9, 10]])
def test_three_markers_in_the_wrong_places(m900ib: Experiment, plan: Plan, stated: bool, source: list[int]) -> None:
    readings = clean(m900ib, plan)
    displacement = np.array(readings.displacement)
    displacement[[9, 10, 11]] = displacement[source]
    finding = only(check_readings(experiment_of(m900ib, stated), replace(readings, displacement=displacement)),
                   "swapped markers")  # fmt: skip
    assert finding.rows == tuple(readings.rows[9:12])
    assert "m1, m2 and m3 are exchanged at pose" in finding.words
    everywhere = clean(m900ib, plan)
    given = replace(everywhere, marker=np.array([1, 2, 0])[everywhere.marker])
    finding = only(check_readings(experiment_of(m900ib, stated), given), "swapped markers")
    assert "m1, m2 and m3 are exchanged at all poses" in finding.words


def sharing(readings: Readings) -> Readings:
    """Two measurements on one unloaded reading of each marker."""
    return replace(readings, reference=tuple(f"u{m // 2}" for m in readings.measurement))


@NOISE
def test_what_readings_share_counts_in_every_test(m900ib: Experiment, plan: Plan, stated: bool) -> None:
    """What leaving a row out takes off the sum of squares, against a fit without it; exchanges against a new fit."""
    given = trial(experiment_of(m900ib, stated), sharing(clean(m900ib, plan)))
    assert not isinstance(given.noise, Independent)
    fall = given.row_squares()
    for row in (0, 7, 20, 41):
        rest = given.take(np.arange(len(fall)) != row)
        assert given.square() - rest.square() == pytest.approx(fall[row], rel=1e-8)
    orders = _orders(np.arange(9, 12))
    assert len(orders) == 5
    for order, change in zip(orders, _exchanges(given, orders), strict=True):
        displacement = np.array(given.readings.displacement)
        displacement[order[:, 0]] = given.readings.displacement[order[:, 1]]
        again = trial(given.experiment, replace(given.readings, displacement=displacement))
        assert again.square() - given.square() == pytest.approx(change, rel=1e-8)


@NOISE
def test_with_shared_readings_clean_ones_are_left_alone_and_gross_ones_found(
    m900ib: Experiment, plan: Plan, stated: bool
) -> None:
    experiment, wrong, found = experiment_of(m900ib, stated), 0, 0
    readings = sharing(clean(m900ib, plan))
    own, groups = noise_parts(readings, np.arange(42), np.full(42, m900ib.noise.sigma or 1.0))
    exact = m900ib.model().predict(readings.poses)[readings.measurement, readings.marker]
    for seed in range(40):
        rng = np.random.default_rng([7, seed])
        common = rng.standard_normal(int(groups[0][0].max()) + 1)[groups[0][0]]
        e = own * rng.standard_normal(126) + groups[0][1] * common
        drawn = replace(readings, displacement=exact + e.reshape(42, 3))
        wrong += bool(check_readings(experiment, drawn, level=0.05))
        gross = check_readings(experiment, spoil(drawn, [8], np.array([[0.0, 0.3e-3, 0.0]])))
        found += [f.rows for f in gross] == [(readings.rows[8],)]
    assert wrong <= 40 * 0.05 + 3.0 * np.sqrt(40 * 0.05 * 0.95)
    assert found >= 34


@NOISE
def test_a_tool_that_was_touched_is_named(m900ib: Experiment, plan: Plan, stated: bool) -> None:
    """Two markers moved 0.12 mm away from each other: too little for either to be a gross error."""
    readings = clean(m900ib, plan)
    place = m900ib.model().positions(readings.poses)[4]
    along = (place[1] - place[0]) / np.linalg.norm(place[1] - place[0])
    finding = only(
        check_readings(experiment_of(m900ib, stated), spoil(readings, [12, 13], 0.12e-3 * np.stack([-along, along]))),
        "tool",
    )
    assert finding.rows == tuple(readings.rows[[12, 13, 14]])


def with_angles(readings: Readings, order: list[int]) -> Readings:
    poses = readings.poses
    return replace(readings, poses=replace(poses, pendant=poses.pendant[order], q=poses.q[order]))


@NOISE
@pytest.mark.parametrize(("first", "last"), [(0, 14), (5, 14), (3, 9)])
def test_angles_logged_late_are_named(m900ib: Experiment, plan: Plan, stated: bool, first: int, last: int) -> None:
    """Measurements `first` to `last` - 1 have the angles of the one before; the first one's are those of the last."""
    order = list(range(14))
    for m in range(first, last):
        order[m] = (m - 1) % 14
    readings = with_angles(clean(m900ib, plan), order)
    found = check_readings(experiment_of(m900ib, stated), readings)
    late = [f for f in found if f.kind == "late angles"]
    assert len(late) == 1, [(f.kind, f.words) for f in found]
    assert set(late[0].rows) == set(readings.rows[3 * first : 3 * last].tolist())


@NOISE
def test_one_pose_with_the_angles_of_the_one_before(m900ib: Experiment, plan: Plan, stated: bool) -> None:
    order = list(range(14))
    order[6] = 5
    readings = with_angles(clean(m900ib, plan), order)
    finding = only(check_readings(experiment_of(m900ib, stated), readings), "late angles")
    assert finding.rows == tuple(readings.rows[18:21])


def test_masking_restores_the_fit(m900ib: Experiment, plan: Plan) -> None:
    readings = clean(m900ib, plan)
    spoilt = spoil(readings, [5], np.array([[0.0, 2e-3, 0.0]]))
    found = check_readings(m900ib, spoilt)
    repaired = masked(spoilt, found)
    assert repaired.use.sum() == len(readings.use) - 1
    assert spoilt.use.all()  # a copy: nothing is deleted
    p = identify(m900ib, repaired).p_value
    assert p is not None
    assert p > 1e-3


def test_the_real_readings_have_their_known_outliers(r2000ic: Experiment, real: Readings) -> None:
    """Readings 11 and 17 of the R-2000iC are the ones that every analysis of this set finds apart."""
    again = read_readings(r2000ic.data, r2000ic)  # type: ignore[arg-type]
    found = check_readings(r2000ic, again)
    named = {readings_pose for f in found for readings_pose in [again.pose[int(np.flatnonzero(f.mask)[0])]]}
    assert all(f.kind == "gross" for f in found)
    assert named <= {"11", "17"}
