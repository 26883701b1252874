"""Each defect planted in simulated positions is found with its rows; clean positions are left alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.cli.check import check_files
from qsframework.cli.identify import FitFiles, How, run_identify
from qsframework.errors import InputError
from qsframework.experiment import Experiment, StateReadings, load_experiment, read_states, write_states
from qsframework.identify import check_positions, identify_positions, masked
from qsframework.identify.frames import Frame, rotation
from qsframework.identify.hygiene import Finding
from qsframework.identify.tools import first_shape, judged, tools
from qsframework.plugin import Array, Poses

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
    Frame("a", rotation(np.array([0.3, -1.2, 2.0])), np.array([1.0, -2.0, 0.5])),
    Frame("b", rotation(np.array([-0.1, 0.2, -0.4])), np.array([-3.0, 0.4, 1.5])),
]
NOISE = pytest.mark.parametrize("stated", [True, False])


def arm_of(folder: Path, more: str = "") -> Experiment:
    (folder / "experiment.yaml").write_text(ARM.replace("MORE\n", more))
    return load_experiment(folder / "experiment.yaml")


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    return arm_of(tmp_path_factory.mktemp("arm"))


def unstated(experiment: Experiment, stated: bool) -> Experiment:
    return experiment if stated else experiment.with_(noise=replace(experiment.noise, sigma=None))


def clean(experiment: Experiment, seed: int = 0, exact: dict[int, Array] | None = None) -> StateReadings:
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
        model = experiment.model()
        x = model.nominal
        at = np.where(loaded[:, None, None], model.positions(poses, x, True), model.positions(poses, x, False))
        exact[K] = np.concatenate([TRACKERS[s == "b"].apply(p) for s, p in zip(series, at, strict=True)])
    noise = SIGMA * np.random.default_rng([1, seed]).standard_normal(exact[K].shape)
    ones, rows = np.ones(COUNT, dtype=np.intp), COUNT * K
    return StateReadings(
        poses, loaded, tuple(str(m // 2) for m in range(COUNT)), ("",) * COUNT, tuple(series), ones, ones,
        np.repeat(np.arange(COUNT), K), np.tile(np.arange(K), COUNT), exact[K] + noise, np.full(rows, np.nan),
        np.ones(rows, dtype=bool), np.arange(2, 2 + rows), None, None,
    )  # fmt: skip


def moved(states: StateReadings, to: list[int], source: list[int]) -> StateReadings:
    position = np.array(states.position)
    position[to] = position[source]
    return replace(states, position=position)


def shifted(states: StateReadings, rows: list[int], by: Array) -> StateReadings:
    position = np.array(states.position)
    position[rows] += by
    return replace(states, position=position)


def only(found: tuple[Finding, ...], kind: str) -> Finding:
    assert [f.kind for f in found] == [kind], [(f.kind, f.words) for f in found]
    return found[0]


@NOISE
def test_clean_distances_are_left_alone_and_moved_markers_found(arm: Experiment, stated: bool) -> None:
    """At a level of 5 % in two series; a shift of 12 sigma is found, and its marker named, nearly always."""
    exact: dict[int, Array] = {}
    experiment = unstated(arm, stated)
    wrong = found = named = 0
    count = 150
    for seed in range(count):
        states = clean(experiment, seed, exact)
        wrong += any(judged(tool, 0.05 / 2)[1].any() for tool in tools(experiment, states))
        position = states.position.reshape(COUNT, 3, 3)
        away = position[7, 1] - position[7].mean(axis=0)
        spoilt = shifted(states, [22], 12.0 * SIGMA * away / np.linalg.norm(away))
        bad = [judged(tool, 0.005)[1] for tool in tools(experiment, spoilt)]
        found += bool(bad[0][7])
        named += bool(bad[0].sum() == 1 and not bad[1].any())
    assert wrong / count <= 0.05 + 3.0 * np.sqrt(0.05 * 0.95 / count)
    assert found / count > 0.95
    assert named / count > 0.9


@NOISE
def test_clean_positions_are_left_alone(arm: Experiment, stated: bool) -> None:
    assert sum(bool(check_positions(unstated(arm, stated), clean(arm, seed))) for seed in range(4)) == 0


def test_the_shape_is_the_tools_though_a_third_of_the_states_is_wrong(arm: Experiment) -> None:
    rng = np.random.default_rng(0)
    states = clean(arm)
    rows = [3 * m for m in (0, 3, 7, 11)]
    spoilt = shifted(states, rows, 0.01 * rng.standard_normal((4, 3)))
    tool = next(tools(arm, spoilt))
    xyz = np.array([m.xyz for m in arm.markers])
    far = lambda p: np.linalg.norm(p[[0, 1, 2]] - p[[1, 2, 0]], axis=1)  # noqa: E731
    assert far(first_shape(tool)) == pytest.approx(far(xyz), abs=4.0 * SIGMA)
    shape, bad = judged(tool, 0.01)
    assert np.flatnonzero(bad).tolist() == [0, 3, 7, 11]
    assert far(shape.points) == pytest.approx(far(xyz), abs=3.0 * SIGMA)
    assert shape.dof(tool).tolist() == [3] * 12


@NOISE
def test_a_zero_and_a_copied_row(arm: Experiment, stated: bool) -> None:
    states = moved(clean(arm), [20], [12])
    states = shifted(states, [7], -states.position[7])
    found = check_positions(unstated(arm, stated), states)
    assert [(f.kind, f.rows) for f in found] == [("zero", (9,)), ("duplicate", (22,))]
    assert "the position is exactly zero" in found[0].words
    assert "as in row 14" in found[1].words


@NOISE
def test_markers_exchanged_in_a_state(arm: Experiment, stated: bool) -> None:
    experiment = unstated(arm, stated)
    finding = only(check_positions(experiment, moved(clean(arm), [9, 11], [11, 9])), "swapped markers")
    assert finding.rows == (11, 13)
    assert "m1 and m3 are exchanged" in finding.words
    around = only(check_positions(experiment, moved(clean(arm), [9, 10, 11], [10, 11, 9])), "swapped markers")
    assert around.rows == (11, 12, 13)
    assert "m1, m2 and m3" in around.words


def test_markers_exchanged_everywhere(arm: Experiment) -> None:
    states = clean(arm)
    marker = np.array([1, 0, 2])[states.marker]
    found = check_positions(arm, replace(states, marker=marker))
    assert {f.kind for f in found} == {"swapped markers"}
    assert "m1 and m2 are exchanged in all states" in found[0].words
    assert sum(int(f.mask.sum()) for f in found) == 2 * COUNT


@NOISE
def test_a_tool_that_was_touched(arm: Experiment, stated: bool) -> None:
    """One marker knocked by 0.3 mm is named alone; two of them make the whole state wrong."""
    states = clean(arm)
    place = states.position[12:15]
    along = (place[1] - place[0]) / np.linalg.norm(place[1] - place[0])
    experiment = unstated(arm, stated)
    far = (place[1] - place[[0, 2]].mean(axis=0)) / np.linalg.norm(place[1] - place[[0, 2]].mean(axis=0))
    finding = only(check_positions(experiment, shifted(states, [13], 0.3e-3 * far)), "tool")
    assert finding.rows == (15,)
    assert "marker m2 is not where it was on the tool" in finding.words
    assert "row 15 (pose 2)" in finding.words
    assert "mm longer than in the other states" in finding.words
    off = 0.3e-3 * np.stack([-along, along, 2.0 * far])
    finding = only(check_positions(experiment, shifted(states, [12, 13, 14], off)), "tool")
    assert finding.rows == (14, 15, 16)


def test_what_distances_cannot_see_the_fit_does(tmp_path: Path) -> None:
    """Two markers whose exchange keeps all distances, and a state with wrong angles: all its rows are gross."""
    arm = arm_of(tmp_path)
    twin = arm.with_(markers=tuple(replace(m, xyz=x) for m, x in zip(
        arm.markers, np.array([[0.2, 0.25, 0.1], [0.2, -0.25, 0.1], [0.4, 0.0, -0.1]]), strict=True)))  # fmt: skip
    states = clean(twin)
    finding = only(check_positions(twin, moved(states, [9, 10], [10, 9])), "swapped markers")
    assert finding.rows == (11, 12)
    assert "the positions are right then" in finding.words
    found = check_positions(twin, shifted(states, [30, 31, 32], np.array([0.0, 0.003, 0.0])))
    assert [f.kind for f in found] == ["gross"] * 3
    assert [f.rows for f in found] == [(32,), (33,), (34,)]
    assert "off where the fit of the other readings puts it" in found[0].words


def test_five_markers_and_one_that_is_hidden_at_times(tmp_path: Path) -> None:
    arm = arm_of(tmp_path, "  m4: {xyz_mm: [0, 100, -120]}\n  m5: {xyz_mm: [-80, 200, 60]}\n")
    states = clean(arm)
    use = states.use.copy()
    use[[4, 9, 60]] = False
    states = replace(states, use=use)
    assert not check_positions(arm, states)
    finding = only(check_positions(arm, moved(states, [20, 21, 23], [21, 23, 20])), "swapped markers")
    assert finding.rows == (22, 23, 25)


def test_the_command_masks_and_the_truth_comes_back(
    arm: Experiment, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    states = clean(arm)
    far = states.position[13] - states.position[[12, 14]].mean(axis=0)
    spoilt = moved(shifted(states, [13], 4e-4 * far / np.linalg.norm(far)), [9, 11], [11, 9])
    found = check_positions(arm, spoilt)
    assert [f.kind for f in found] == ["swapped markers", "tool"]
    assert masked(spoilt, found).use.sum() == len(states.use) - 3
    assert spoilt.use.all()
    write_states(tmp_path / "s.csv", spoilt, arm)
    run_identify(FitFiles(arm.path, tmp_path / "s.csv"), How(clean=True))
    said = capsys.readouterr().out
    assert "masked, swapped markers: rows" in said
    assert "masked, tool: row" in said
    assert "The residuals agree with the stated noise" in said
    whole = identify_positions(arm, states)
    again = identify_positions(arm, masked(spoilt, found))
    for a, b in zip(again.estimates, whole.estimates, strict=True):
        assert abs(a.value - b.value) < 1.5 * b.sd, a.name


def test_real_positions_of_one_marker() -> None:
    """Series B holds two positions twice, one row after the other at other angles, and two that are 2 mm off."""
    experiment = load_experiment(UR10 / "experiment.yaml")
    states = read_states(UR10 / "series_b.csv", experiment)
    found = check_positions(experiment, states)
    named = [(f.kind, states.pose[states.measurement[int(np.flatnonzero(f.mask)[0])]]) for f in found]
    assert named == [("duplicate", "533"), ("duplicate", "1064"), ("gross", "855"), ("gross", "856")]
    assert np.array_equal(states.position[states.rows == 536], states.position[states.rows == 535])


def test_qsf_check_says_it(arm: Experiment, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_states(tmp_path / "s.csv", moved(clean(arm), [9, 11], [11, 9]), arm)
    text = Path(str(arm.path)).read_text() + "data: s.csv\n"
    (tmp_path / "experiment.yaml").write_text(text)
    check_files([tmp_path / "experiment.yaml"], None)
    said = capsys.readouterr().out
    assert "ok, but look at what is marked with !" in said
    assert "! swapped markers: rows " in said
    write_states(tmp_path / "s.csv", clean(arm), arm)
    check_files([tmp_path / "experiment.yaml"], None)
    assert "swapped" not in capsys.readouterr().out


def test_no_fit_no_gross_errors(arm: Experiment) -> None:
    states = clean(arm)
    few = replace(states, use=states.measurement < 8)
    lost = replace(few, series=("", *few.series[1:]))
    with pytest.raises(InputError):
        identify_positions(arm, lost)
    assert check_positions(arm, lost) == ()
