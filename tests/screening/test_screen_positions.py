"""Each defect planted in simulated positions is found with its rows; clean positions are left alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.cli.check import check_files
from qsframework.cli.identify import FitFiles, run_identify
from qsframework.elastostatics.so3 import exponential
from qsframework.errors import InputError, NotIdentifiable
from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Frame, Readings, load_experiment, read_readings, write_readings
from qsframework.fits import identify
from qsframework.hypotheses.catalogue.rigidity import first_shape, judged, tools
from qsframework.plugin import Array, Poses
from qsframework.screening import Mistake, adopted, find_mistakes
from tests.identify.arm import copied, position_readings, settled, spoilt, with_sigma, without, wrong_in

UR10 = Path(__file__).parents[2] / "examples" / "ur10"
SIGMA = 2e-5
ARM = """
robot: fanuc_m900ib
load: {point_mm: [281, 0, 243]}
markers:
  m1: {xyz_mm: [150, 250, 250]}
  m2: {xyz_mm: [400, -150, 150]}
  m3: {xyz_mm: [150, -150, -250]}
MORE
noise: {sigma_mm: 0.02}
effects:
  - {effect: joint_offset, joints: [joint_2, joint_4]}
fit: [joint_compliance, joint_offset]
"""
COUNT = 24
TRACKERS = [
    Frame("a", exponential(np.array([0.3, -1.2, 2.0])), np.array([1.0, -2.0, 0.5])),
    Frame("b", exponential(np.array([-0.1, 0.2, -0.4])), np.array([-3.0, 0.4, 1.5])),
]
NOISE = pytest.mark.parametrize("stated", [True, False])


def arm_of(folder: Path, more: str = "") -> Experiment:
    (folder / "experiment.yaml").write_text(ARM.replace("MORE\n", more))
    return load_experiment(folder / "experiment.yaml")


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    return arm_of(tmp_path_factory.mktemp("arm"))


def given(states: Readings, stated: bool) -> Readings:
    """The noise stated, or known to nobody."""
    return states if stated else with_sigma(states, None)


def clean(experiment: Experiment, seed: int = 0, exact: dict[int, Array] | None = None) -> Readings:
    """12 poses, each unloaded and loaded, in two series; `exact` remembers the exact places."""
    rng = np.random.default_rng(3)
    controller = experiment.robot.controller
    pendant = np.repeat(rng.uniform(controller.lower, controller.upper, (COUNT // 2, 6)) * 0.6, 2, axis=0)
    loaded = np.tile([False, True], COUNT // 2)
    wrench = np.where(loaded[:, None], [0.0, 1500.0, -3000.0, 0.0, 0.0, 0.0], 0.0)
    poses = Poses(pendant, controller.to_joints(pendant), wrench)
    series = ["a" if m < COUNT // 2 else "b" for m in range(COUNT)]
    K = len(experiment.markers)
    exact = {} if exact is None else exact
    if K not in exact:
        at = settled(experiment.model(), poses, loaded)
        exact[K] = np.stack([TRACKERS[s == "b"].apply(p) for s, p in zip(series, at, strict=True)])
    noise = SIGMA * np.random.default_rng([1, seed]).standard_normal(exact[K].shape)
    return position_readings(
        poses, loaded, exact[K] + noise, SIGMA, pose=[str(m // 2) for m in range(COUNT)], series=series
    )


def only(found: tuple[Mistake, ...], kind: str) -> Mistake:
    assert [f.name for f in found] == [kind], [(f.name, f.words) for f in found]
    return found[0]


@NOISE
def test_clean_distances_are_left_alone_and_moved_markers_found(arm: Experiment, stated: bool) -> None:
    """At a level of 5 % in two series; a shift of 12 sigma is found, and its marker named, nearly always."""
    exact: dict[int, Array] = {}
    wrong = found = named = 0
    count = 80
    for seed in range(count):
        states = given(clean(arm, seed, exact), stated)
        wrong += any(judged(tool, 0.05 / 2)[1].any() for tool in tools(arm, states))
        position = states.value.reshape(COUNT, 3, 3)
        away = position[7, 1] - position[7].mean(axis=0)
        knocked = spoilt(states, [22], 12.0 * SIGMA * away / np.linalg.norm(away))
        bad = [judged(tool, 0.005)[1] for tool in tools(arm, knocked)]
        found += bool(bad[0][7])
        named += bool(bad[0].sum() == 1 and not bad[1].any())
    assert wrong / count <= 0.05 + 3.0 * np.sqrt(0.05 * 0.95 / count)
    assert found / count > 0.95
    assert named / count > 0.9


@NOISE
def test_clean_positions_are_left_alone(arm: Experiment, stated: bool) -> None:
    assert sum(bool(wrong_in(arm, given(clean(arm, seed), stated))) for seed in range(4)) == 0


def test_the_shape_is_the_tools_though_a_third_of_the_states_is_wrong(arm: Experiment) -> None:
    rng = np.random.default_rng(0)
    states = clean(arm)
    rows = [3 * m for m in (0, 3, 7, 11)]
    wrong = spoilt(states, rows, 0.01 * rng.standard_normal((4, 3)))
    tool = next(tools(arm, wrong))
    xyz = np.array([m.xyz for m in arm.markers])
    far = lambda p: np.linalg.norm(p[[0, 1, 2]] - p[[1, 2, 0]], axis=1)  # noqa: E731
    assert far(first_shape(tool)) == pytest.approx(far(xyz), abs=4.0 * SIGMA)
    shape, bad = judged(tool, 0.01)
    assert np.flatnonzero(bad).tolist() == [0, 3, 7, 11]
    assert far(shape.points) == pytest.approx(far(xyz), abs=3.0 * SIGMA)
    assert shape.dof(tool).tolist() == [3] * 12


@NOISE
def test_a_zero_and_a_copied_row(arm: Experiment, stated: bool) -> None:
    states = copied(clean(arm), [20], [12])
    states = spoilt(states, [7], -states.value[7])
    found = wrong_in(arm, given(states, stated))
    assert [(f.name, f.rows) for f in found] == [("unread", (9,)), ("repeated_readings", (22,))]
    assert "the position is exactly zero" in found[0].words
    assert "as in row 14" in found[1].words


@NOISE
def test_markers_exchanged_in_a_state(arm: Experiment, stated: bool) -> None:
    finding = only(wrong_in(arm, given(copied(clean(arm), [9, 11], [11, 9]), stated)), "swapped_markers")
    assert finding.rows == (11, 13)
    assert "m1 and m3 are exchanged" in finding.words
    around = only(wrong_in(arm, given(copied(clean(arm), [9, 10, 11], [10, 11, 9]), stated)), "swapped_markers")
    assert around.rows == (11, 12, 13)
    assert "m1, m2 and m3" in around.words


def test_markers_exchanged_everywhere(arm: Experiment) -> None:
    states = clean(arm)
    marker = np.array([1, 0, 2])[states.marker]
    found = wrong_in(arm, replace(states, marker=marker))
    assert {f.name for f in found} == {"swapped_markers"}
    assert "m1 and m2 are exchanged in all states" in found[0].words
    assert sum(int(np.sum(f.mask)) for f in found) == 2 * COUNT


@NOISE
def test_a_tool_that_was_touched(arm: Experiment, stated: bool) -> None:
    """One marker knocked by 0.3 mm is named alone; two of them make the whole state wrong."""
    states = clean(arm)
    place = states.value[12:15]
    along = (place[1] - place[0]) / np.linalg.norm(place[1] - place[0])
    far = (place[1] - place[[0, 2]].mean(axis=0)) / np.linalg.norm(place[1] - place[[0, 2]].mean(axis=0))
    finding = only(wrong_in(arm, given(spoilt(states, [13], 0.3e-3 * far), stated)), "tool")
    assert finding.rows == (15,)
    assert "marker m2 is not where it was on the tool" in finding.words
    assert "row 15 (pose 2)" in finding.words
    assert "mm longer than in the other states" in finding.words
    off = 0.3e-3 * np.stack([-along, along, 2.0 * far])
    finding = only(wrong_in(arm, given(spoilt(states, [12, 13, 14], off), stated)), "tool")
    assert finding.rows == (14, 15, 16)


def test_what_distances_cannot_see_the_fit_does(tmp_path: Path) -> None:
    """Two markers whose exchange keeps all distances, and a state with wrong angles: all its rows are gross."""
    arm = arm_of(tmp_path)
    twin = arm.with_(
        markers=tuple(
            replace(m, xyz=x)
            for m, x in zip(arm.markers, np.array([[0.2, 0.25, 0.1], [0.2, -0.25, 0.1], [0.4, 0.0, -0.1]]), strict=True)
        )
    )
    states = clean(twin)
    finding = only(wrong_in(twin, copied(states, [9, 10], [10, 9])), "swapped_markers")
    assert finding.rows == (11, 12)
    assert "the readings fit far better if exchanged" in finding.words
    found = wrong_in(twin, spoilt(states, [30, 31, 32], np.array([0.0, 0.003, 0.0])))
    assert [f.name for f in found] == ["gross"] * 3
    assert [f.rows for f in found] == [(32,), (33,), (34,)]
    assert "sds off what the other readings say" in found[0].words


def test_five_markers_and_one_that_is_hidden_at_times(tmp_path: Path) -> None:
    arm = arm_of(tmp_path, "  m4: {xyz_mm: [0, 100, -120]}\n  m5: {xyz_mm: [-80, 200, 60]}\n")
    states = clean(arm)
    use = states.use.copy()
    use[[4, 9, 60]] = False
    states = replace(states, use=use)
    assert not wrong_in(arm, states)
    finding = only(wrong_in(arm, copied(states, [20, 21, 23], [21, 23, 20])), "swapped_markers")
    assert finding.rows == (22, 23, 25)


def test_the_command_masks_and_the_truth_comes_back(
    arm: Experiment, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    states = clean(arm)
    far = states.value[13] - states.value[[12, 14]].mean(axis=0)
    wrong = copied(spoilt(states, [13], 4e-4 * far / np.linalg.norm(far)), [9, 11], [11, 9])
    found = wrong_in(arm, wrong)
    assert [f.name for f in found] == ["swapped_markers", "tool"]
    assert without(wrong, found).use.sum() == len(states.use) - 3
    assert wrong.use.all()
    write_readings(tmp_path / "s.csv", wrong, arm)
    files = FitFiles(experiment=arm.path, data=(tmp_path / "s.csv",), states="positions")
    run_identify(files, None, FitOptions(), True)
    said = capsys.readouterr().out
    assert "masked, swapped markers: rows" in said
    assert "masked, tool: row" in said
    assert "The residuals agree with the stated noise" in said
    keep = FitOptions(keep_all=True)
    whole, again = identify(arm, states, options=keep), identify(arm, without(wrong, found), options=keep)
    for a, b in zip(again.estimates, whole.estimates, strict=True):
        assert abs(a.value - b.value) < 1.5 * b.sd, a.name


def test_real_positions_of_one_marker() -> None:
    """Series B holds two positions twice, one row after the other at other angles, and two that are 2 mm off."""
    experiment = load_experiment(UR10 / "experiment.yaml")
    states = read_readings(UR10 / "series_b.csv", experiment, "positions")
    found = wrong_in(experiment, states)
    named = [(f.name.partition("[")[0], states.pose[int(np.flatnonzero(f.mask)[0])]) for f in found]
    assert named == [("repeated_readings", "533"), ("repeated_readings", "1064"), ("gross", "855"), ("gross", "856")]
    assert np.array_equal(states.value[states.line == 536], states.value[states.line == 535])


def test_qsf_check_says_it(arm: Experiment, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_readings(tmp_path / "s.csv", copied(clean(arm), [9, 11], [11, 9]), arm)
    text = Path(str(arm.path)).read_text() + "data: s.csv\n"
    (tmp_path / "experiment.yaml").write_text(text)
    check_files([tmp_path / "experiment.yaml"], None)
    said = capsys.readouterr().out
    assert "ok, but look at what is marked with !" in said
    assert "! swapped markers: rows " in said
    write_readings(tmp_path / "s.csv", clean(arm), arm)
    check_files([tmp_path / "experiment.yaml"], None)
    assert "swapped" not in capsys.readouterr().out


def test_loaded_positions_alone_are_positions(
    arm: Experiment, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """No loaded row has an unloaded one: a fit reads positions, and so does the check; read as differences, each lacks
    its partner."""
    states = clean(arm)
    write_readings(tmp_path / "s.csv", states.masked(~states.states.loaded[states.plus]), arm)
    text = Path(str(arm.path)).read_text() + "data: s.csv\n"
    (tmp_path / "experiment.yaml").write_text(text)
    check_files([tmp_path / "experiment.yaml"], None)
    assert ", ok" in capsys.readouterr().out
    (tmp_path / "experiment.yaml").write_text(text + "states: differences\n")
    with pytest.raises(InputError, match="no unloaded one to be measured against"):
        check_files([tmp_path / "experiment.yaml"], None)


def test_no_fit_no_gross_errors(arm: Experiment) -> None:
    """States of one pose tell no fit; what needs none is looked for all the same."""
    states = clean(arm)
    few = replace(states, use=states.plus < 2)
    with pytest.raises(NotIdentifiable, match="of one pose"):
        identify(arm, few)
    assert wrong_in(arm, few) == ()
    assert [f.name for f in wrong_in(arm, spoilt(few, [1], -few.value[1]))] == ["unread"]


def test_the_table_of_a_day_names_what_the_day_did(tmp_path: Path) -> None:
    """Springs alone fitted, the tool 1 mm and all angles 0.03 deg off: one pose of five, 2 deg off, is vouched for by
    its three visits, and the other poses fit no better than to millimetres."""
    day = UR10.parent / "day"
    words = ["day", str(day / "experiment.yaml"), str(day / "plan.csv"), "--watch", str(day / "exports"), "--once"]
    words += ["--cycles", "1", "--no-half", "--repeat-share", "0", "-o", str(tmp_path)]
    said = CliRunner().invoke(app, words, input="keep\nkeep\n", catch_exceptions=False).output
    assert "q3 is +2.04 deg from the plan" in said
    table = tmp_path / "readings.csv"
    lines = [line[:-1] + "1" if line.startswith("p06") else line for line in table.read_text().splitlines()]
    table.write_text("\n".join(lines) + "\n")
    experiment = replace(load_experiment(day / "experiment.yaml"), states="positions")
    (one,) = adopted(find_mistakes(experiment, read_readings([table], experiment)))
    assert one.name == "angle[p06/q3]"
    assert len(one.rows) == 9
    assert np.isclose(np.rad2deg(one.meant - one.found), 2.0, atol=0.1)
