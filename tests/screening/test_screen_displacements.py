"""Each defect planted in simulated readings is found with its rows; clean readings are left alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.cli import main
from qsframework.errors import NotIdentifiable
from qsframework.estimation import FitOptions, Independent, LinearFit
from qsframework.experiment import Experiment, Plan, Readings, example, make_plan, simulate
from qsframework.fits import identify
from qsframework.hypotheses.catalogue.late_angles import late_angles
from qsframework.hypotheses.catalogue.markers import exchanged_markers
from qsframework.hypotheses.linearized import linearized
from qsframework.hypotheses.outliers import find_outliers
from qsframework.plugin import Poses, build_effects
from qsframework.screening import Mistake
from tests.identify.arm import copied, shared_unloaded, spoilt, with_sigma, without, wrong_in


@pytest.fixture(scope="module")
def plan(m900ib: Experiment) -> Plan:
    rng = np.random.default_rng(4)
    controller = m900ib.robot.controller
    pendant = rng.uniform(controller.lower, controller.upper, (14, 6)) * 0.7
    wrench = np.tile([0.0, 1500.0, -4000.0, 0, 0, 0], (14, 1))
    return make_plan(Poses(pendant, controller.to_joints(pendant), wrench), ["pull"] * 14)


def clean(experiment: Experiment, plan: Plan, seed: int = 0) -> Readings:
    return simulate(experiment, plan, truth="drawn", seed=seed).readings


def only(found: tuple[Mistake, ...], kind: str) -> Mistake:
    assert [f.name for f in found] == [kind], [(f.name, f.words) for f in found]
    return found[0]


NOISE = pytest.mark.parametrize("stated", [True, False])


def said(m900ib: Experiment, readings: Readings, stated: bool, level: float = 0.01) -> tuple[Mistake, ...]:
    """What is found where the noise is stated, or nobody knows it."""
    if stated:
        return wrong_in(m900ib, readings, level=level)
    return wrong_in(m900ib.with_(noise=replace(m900ib.noise, sigma=None)), with_sigma(readings, None), level=level)


SIMULATED = 16


def test_clean_readings_are_left_alone(m900ib: Experiment, plan: Plan) -> None:
    """At a level of 5 % at most 5 % of clean campaigns have any finding, and 3 sigma of the binomial beyond."""
    wrong = {True: 0, False: 0}
    for seed in range(SIMULATED // 2):
        for stated in (True, False):
            wrong[stated] += bool(said(m900ib, clean(m900ib, plan, seed), stated, level=0.05))
    for count in wrong.values():
        assert count <= 0.05 * SIMULATED / 2 + 3.0 * np.sqrt(0.5 * SIMULATED * 0.05 * 0.95)


@NOISE
def test_a_zero_and_a_copied_row(m900ib: Experiment, plan: Plan, stated: bool) -> None:
    readings = clean(m900ib, plan)
    wrong = copied(spoilt(readings, [7], -readings.value[7]), [20], [12])
    found = said(m900ib, wrong, stated)
    assert [f.name for f in found] == ["unread", "repeated_readings"]
    assert found[0].rows == (readings.line[7],)
    assert found[1].rows == (readings.line[20],)
    assert f"row {readings.line[12]}" in found[1].words


def test_a_long_table_is_judged_in_parts(m900ib: Experiment, plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts of whole visits, every row judged once; what is gross in one is gross among all."""
    readings = spoilt(clean(m900ib, plan), [5, 30], np.array([[0.0, 2e-3, 0.0], [2e-3, 0.0, 0.0]]))
    whole = find_outliers(m900ib, readings)
    monkeypatch.setattr("qsframework.hypotheses.outliers._PART", 22)
    parts = find_outliers(m900ib, readings)
    assert whole is not None
    assert parts is not None
    assert np.flatnonzero(parts.gross).tolist() == np.flatnonzero(whole.gross).tolist() == [5, 30]
    assert parts.size.shape == whole.size.shape
    assert not np.array_equal(parts.size, whole.size)


@NOISE
def test_gross_errors_are_named_one_by_one(m900ib: Experiment, plan: Plan, stated: bool) -> None:
    readings = spoilt(clean(m900ib, plan), [5, 30], np.array([[0.0, 0.5e-3, 0.0], [0.4e-3, 0.0, 0.0]]))
    found = said(m900ib, readings, stated)
    assert {f.name for f in found} == {"gross"}
    assert {f.rows[0] for f in found} == {readings.line[5], readings.line[30]}


@NOISE
def test_swapped_markers_of_a_pose_are_named(m900ib: Experiment, plan: Plan, stated: bool) -> None:
    readings = clean(m900ib, plan)
    finding = only(said(m900ib, copied(readings, [9, 11], [11, 9]), stated), "swapped_markers")
    assert finding.rows == (readings.line[9], readings.line[11])
    assert "m1 and m3" in finding.words


@NOISE
def test_markers_swapped_everywhere_are_named(m900ib: Experiment, plan: Plan, stated: bool) -> None:
    readings = clean(m900ib, plan)
    finding = only(
        said(m900ib, replace(readings, marker=np.array([1, 0, 2])[readings.marker]), stated), "swapped_markers"
    )
    assert "m1 and m2 are exchanged at all poses" in finding.words
    assert finding.mask.sum() == 28


@NOISE
@pytest.mark.parametrize("source", [[10, 11, 9], [11, 9, 10]])
def test_three_markers_in_the_wrong_places(m900ib: Experiment, plan: Plan, stated: bool, source: list[int]) -> None:
    readings = clean(m900ib, plan)
    finding = only(said(m900ib, copied(readings, [9, 10, 11], source), stated), "swapped_markers")
    assert finding.rows == tuple(readings.line[9:12])
    assert "m1, m2 and m3 are exchanged at pose" in finding.words


def test_three_markers_in_the_wrong_places_everywhere(m900ib: Experiment, plan: Plan) -> None:
    readings = clean(m900ib, plan)
    given = replace(readings, marker=np.array([1, 2, 0])[readings.marker])
    assert "m1, m2 and m3 are exchanged at all poses" in only(wrong_in(m900ib, given), "swapped_markers").words


@pytest.fixture(scope="module")
def two_loads(m900ib: Experiment, plan: Plan) -> Plan:
    """Seven poses under two loads each."""
    order = np.repeat(np.arange(7), 2)
    wrench = np.tile([[0.0, 1500.0, -4000.0, 0, 0, 0], [0.0, -1500.0, -3000.0, 0, 0, 0]], (7, 1))
    return make_plan(replace(plan.poses.take(order), wrench=wrench), ["one", "other"] * 7)


def sharing(readings: Readings) -> Readings:
    """The two loads of a pose, named as one, on one unloaded reading of each marker."""
    states = readings.states
    one = replace(states, pose=tuple(f"p{i // 2}" for i in range(len(states) // 2)) * 2)
    return shared_unloaded(replace(readings, states=one), np.arange(len(states) // 2) // 2)


@NOISE
def test_what_readings_share_counts_in_every_test(m900ib: Experiment, two_loads: Plan, stated: bool) -> None:
    """What leaving a row out takes off the sum of squares, against a fit without it; exchanges against a new fit."""
    readings = sharing(clean(m900ib, two_loads))
    given = linearized(m900ib, readings if stated else with_sigma(readings, None))
    assert not isinstance(given.noise, Independent)
    alone = given.fit.held_out(given.row)
    for row in (0, 7, 20, 41):
        kept = np.arange(len(given.keep)) != row
        own = kept[given.row]
        rest = LinearFit.of(given.slopes[own], given.errors[own], given.rows.take(kept).noise)
        (drop,) = alone.chi2_drop[alone.label == row]
        assert given.fit.chi2 - rest.chi2 == pytest.approx(drop, rel=1e-8)
    swapped = copied(given.readings, [9, 11], [11, 9])
    found = exchanged_markers(linearized(m900ib, swapped), 0.01)
    assert found is not None
    assert found.mask is not None
    assert np.flatnonzero(found.mask).tolist() == [9, 11]
    assert "m1 and m3" in found.words


@pytest.mark.parametrize("everywhere", [False, True])
def test_of_a_long_file_the_worst_rows_are_exchanged(
    m900ib: Experiment, two_loads: Plan, monkeypatch: pytest.MonkeyPatch, everywhere: bool
) -> None:
    """As it is found among all rows: at one pose, or at all though not all were tried."""
    given = clean(m900ib, two_loads)
    first, third = np.flatnonzero(given.marker == 0), np.flatnonzero(given.marker == 2)
    some = slice(None) if everywhere else slice(3, 4)
    swapped = linearized(m900ib, copied(given, [*first[some], *third[some]], [*third[some], *first[some]]))
    every = exchanged_markers(swapped, 0.01)
    monkeypatch.setattr("qsframework.hypotheses.catalogue.markers._MOST", 20)
    monkeypatch.setattr("qsframework.hypotheses.catalogue.markers._NUMBERS", 200)
    found = exchanged_markers(swapped, 0.01)
    assert every is not None
    assert found is not None
    assert found.rows == every.rows
    assert found.words == every.words


def test_with_shared_readings_clean_ones_are_left_alone_and_gross_ones_found(
    m900ib: Experiment, two_loads: Plan
) -> None:
    wrong, found = {True: 0, False: 0}, {True: 0, False: 0}
    readings, sigma, count = sharing(clean(m900ib, two_loads)), 0.03e-3, 4
    exact = simulate(m900ib.with_(noise=replace(m900ib.noise, sigma=0.0)), two_loads).readings.value
    for seed in range(count):
        rng = np.random.default_rng([7, seed])
        common = rng.standard_normal((7, 3, 3))[readings.plus // 2, readings.marker]
        e = sigma / np.sqrt(2.0) * (rng.standard_normal((42, 3)) - common)
        drawn = readings.with_values(exact + e)
        gross = spoilt(drawn, [8], np.array([[0.0, 0.3e-3, 0.0]]))
        for stated in (True, False):
            wrong[stated] += bool(said(m900ib, drawn, stated, level=0.05))
            rows = {r for f in said(m900ib, gross, stated) if f.name == "gross" for r in f.rows}
            # the other load's row of this marker shares the unloaded reading, and is named with it at times
            found[stated] += readings.line[8] in rows and rows <= {readings.line[8], readings.line[11]}
    assert max(wrong.values()) <= count * 0.05 + 3.0 * np.sqrt(count * 0.05 * 0.95)
    assert min(found.values()) >= 0.8 * count


@NOISE
def test_a_tool_that_was_touched_is_named(m900ib: Experiment, plan: Plan, stated: bool) -> None:
    """Two markers moved 0.12 mm away from each other: too little for either to be a gross error."""
    readings = clean(m900ib, plan)
    place = m900ib.model().positions(readings.poses)[4]
    along = (place[1] - place[0]) / np.linalg.norm(place[1] - place[0])
    touched = spoilt(readings, [12, 13], 0.12e-3 * np.stack([-along, along]))
    finding = only(said(m900ib, touched, stated), "tool")
    assert finding.rows == tuple(readings.line[[12, 13, 14]])


def with_angles(readings: Readings, order: list[int]) -> Readings:
    """The angles of other visits, of the loaded and the unloaded state alike."""
    poses, both = readings.poses, np.array([*order, *(len(order) + k for k in order)])
    return readings.with_poses(replace(poses, pendant=poses.pendant[both], q=poses.q[both]))


@NOISE
@pytest.mark.parametrize(("first", "last"), [(0, 14), (5, 14), (3, 9)])
def test_angles_logged_late_are_named(m900ib: Experiment, plan: Plan, stated: bool, first: int, last: int) -> None:
    """Visits `first` to `last` - 1 have the angles of the one before; the first one's are those of the last."""
    order = list(range(14))
    for m in range(first, last):
        order[m] = (m - 1) % 14
    readings = with_angles(clean(m900ib, plan), order)
    found = said(m900ib, readings, stated)
    late = [f for f in found if f.name == "late_angles"]
    assert len(late) == 1, [(f.name, f.words) for f in found]
    assert set(late[0].rows) == set(readings.line[3 * first : 3 * last].tolist())


@NOISE
def test_one_pose_with_the_angles_of_the_one_before(m900ib: Experiment, plan: Plan, stated: bool) -> None:
    order = list(range(14))
    order[6] = 5
    readings = with_angles(clean(m900ib, plan), order)
    finding = only(said(m900ib, readings, stated), "late_angles")
    assert finding.rows == tuple(readings.line[18:21])


def test_two_visits_are_too_few_to_look_for_late_angles(r2000ic: Experiment, real: Readings) -> None:
    two = replace(real, use=np.arange(len(real)) < 2)
    assert late_angles(linearized(r2000ic.with_(fit=("joint_compliance[joint_2]",)), two), 0.01) is None


def test_masking_restores_the_fit(m900ib: Experiment, plan: Plan) -> None:
    readings = clean(m900ib, plan)
    wrong = spoilt(readings, [5], np.array([[0.0, 2e-3, 0.0]]))
    found = wrong_in(m900ib, wrong)
    repaired = without(wrong, found)
    assert repaired.use.sum() == len(readings.use) - 1
    assert wrong.use.all()  # a copy: nothing is deleted
    keep = FitOptions(keep_all=True)
    p, before = identify(m900ib, repaired, options=keep).p_value, identify(m900ib, wrong, options=keep).p_value
    assert p is not None
    assert before is not None
    assert before < 1e-3 < p


def test_the_real_readings_have_their_known_outliers(r2000ic: Experiment, real: Readings) -> None:
    """Readings 11 and 17 of the R-2000iC are the ones that every analysis of this set finds apart."""
    found = wrong_in(r2000ic, real)
    assert all(f.name == "gross" for f in found)
    assert {real.pose[int(np.flatnonzero(f.mask)[0])] for f in found} <= {"11", "17"}


def test_readings_that_tell_nothing_are_no_fit_and_screening_goes_on(r2000ic: Experiment, real: Readings) -> None:
    """The same parameter by two springs is told as one; a parameter that nothing moves is none to try changes on."""
    twin = build_effects({"effect": "offaxis_compliance", "joints": ["joint_2"], "axes": "all"}, r2000ic.robot.facts)
    added = tuple(p for e in twin for p in e.parameters(r2000ic.robot.facts))
    wide = r2000ic.with_(effects=twin, parameters=added, fit=("joint_compliance", "offaxis_compliance"))
    fit = linearized(wide, real)
    assert fit.fit.Q.shape[1] < len(wide.fit_names())
    zero = spoilt(real, [4], -real.value[4])
    assert [f.name for f in wrong_in(wide, zero)][:1] == ["unread"]
    blind = real.with_poses(replace(real.poses, wrench=np.zeros_like(real.poses.wrench)))
    with pytest.raises(NotIdentifiable, match="joint_compliance"):
        linearized(r2000ic, blind)
    assert wrong_in(r2000ic, blind) == ()


@pytest.mark.parametrize("words", [["check"], ["identify", "--clean"], ["diagnose"]], ids=lambda words: words[0])
def test_readings_that_nothing_contradicts_are_no_fault(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two rows give six numbers for six springs: no degree of freedom is left."""
    lines = (example("r2000ic") / "readings.csv").read_text().splitlines()
    table = [line for line in lines if not line.startswith("#")]
    (tmp_path / "few.csv").write_text("\n".join([table[0], table[3], table[20]]) + "\n")
    command = [words[0], str(example("r2000ic") / "experiment.yaml"), str(tmp_path / "few.csv"), *words[1:]]
    monkeypatch.setattr("sys.argv", ["qsf", *command])
    try:
        main()
        code = 0
    except SystemExit as stop:
        code = stop.code or 0
    assert code == (1 if words[0] == "check" else 2), capsys.readouterr().err
