"""Rows slipped by one, rounded angles, radians, columns counted from zero, exchanged loads, a reflector's constant.

Each is named by the one search behind check, identify and the diagnosis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from clean_tables import loaded, write_clean
from independent import Campaign, Setting
from independent_arm import ARMS

from qsframework.diagnoses import diagnose
from qsframework.errors import NotConverged
from qsframework.experiment import Experiment, Readings, read_readings
from qsframework.fits import identify
from qsframework.hypotheses.linearized import at_solution
from qsframework.plugin import Array
from qsframework.report.words.headline import headline
from qsframework.screening import adopted, find_mistakes


def shown(experiment: Experiment, readings: Readings, pendant: Array) -> Readings:
    q = experiment.robot.controller.to_joints(pendant)
    return readings.with_poses(replace(readings.poses, pendant=pendant, q=q))


def slipped(experiment: Experiment, readings: Readings, first: int, by: int) -> Readings:
    """From pose `first` on the angles of the pose so many before."""
    names = list(dict.fromkeys(readings.states.pose))
    of = {n: names[min(i - by, len(names) - 1)] if i >= first else n for i, n in enumerate(names)}
    at = {n: readings.states.pose.index(n) for n in names}
    order = [at[of[n]] if names.index(n) >= first else s for s, n in enumerate(readings.states.pose)]
    return shown(experiment, readings, readings.poses.pendant[order])


@pytest.mark.parametrize("kind", ["displacements", "positions"])
def test_rows_that_stand_twice_count_once(folder: Path, tmp_path: Path, kind: str) -> None:
    """A copy of the file changes nothing and is said by every verb."""
    experiment, once = loaded(folder / kind)
    (source,) = experiment.data
    again = tmp_path / "again.csv"
    again.write_text(source.read_text())
    both = read_readings([source, again], experiment)
    (found,) = adopted(find_mistakes(experiment, both))
    assert (found.name, found.file, len(found.rows)) == ("doubled_rows", "again.csv", len(once))
    fit, alone = identify(experiment, both), identify(experiment, once)
    np.testing.assert_array_equal(fit.covariance, alone.covariance)
    assert [one.file for one in fit.gross] == [1]
    assert [c.name for c in diagnose(experiment, both, repeats=1).conventions] == ["doubled_rows"]


@pytest.mark.parametrize("kind", ["displacements", "positions"])
@pytest.mark.parametrize("by", [1, -1])
def test_rows_slipped_by_one(folder: Path, kind: str, by: int) -> None:
    """Also where a pose has two states, which slip together."""
    experiment, right = loaded(folder / kind)
    found = adopted(find_mistakes(experiment, slipped(experiment, right, 8, by)))
    assert [c.name for c in found] == ["late_angles"]
    assert ("one pose late" if by > 0 else "one pose early") in found[0].words
    own = right.line[[i for i, p in enumerate(right.pose) if int(p[1:]) >= 9]]
    assert set(own.tolist()) - set(found[0].rows) <= set(own[-6:].tolist())
    fit = at_solution(found[0].experiment, found[0].readings)
    assert fit < 1.2 * at_solution(experiment, right)


@pytest.mark.parametrize(("step", "said"), [(1.0, "1 deg"), (0.5, "0.5 deg")])
def test_rounded_angles_hide_every_cause(folder: Path, step: float, said: str) -> None:
    experiment, right = loaded(folder / "positions")
    grid = np.deg2rad(step)
    wrong = shown(experiment, right, np.round(right.poses.pendant / grid) * grid)
    told = diagnose(experiment, wrong, repeats=1)
    assert [f.name for f in told.findings] == ["angles_rounded"]
    assert headline(told).startswith(f"Wrong in the table: the angles are rounded to {said}")
    assert told.learned is None
    assert told.leftovers == ()


def test_whole_degrees_that_the_robot_was_sent_to_are_no_mistake(tmp_path: Path) -> None:
    """Poses are commanded in whole degrees, and the readings fit."""
    setting = Setting(ARMS["heavy"], 24, 3, "positions", fit="springs", loads="many")
    whole = np.deg2rad(np.round(np.rad2deg(Campaign(setting).visits[1].shown[::2])))
    write_clean(replace(setting, plan=whole[:24]), tmp_path)
    assert adopted(find_mistakes(*loaded(tmp_path))) == ()


CHANGED: dict[str, tuple[str, Callable[[Array], Array]]] = {
    "all angles in radians": ("column_unit", lambda q: q * np.pi / 180.0),
    "counted from zero": ("joint_columns", lambda q: np.roll(q, -1, axis=1)),
}


@pytest.mark.parametrize("kind", ["displacements", "positions"])
@pytest.mark.parametrize("what", CHANGED)
def test_columns_of_angles(folder: Path, kind: str, what: str) -> None:
    experiment, right = loaded(folder / kind)
    name, change = CHANGED[what]
    wrong = shown(experiment, right, change(right.poses.pendant))
    if experiment.robot.controller.outside(right.poses.pendant).any():
        pytest.fail("the campaign itself leaves the limits")
    found = adopted(find_mistakes(experiment, wrong))
    assert [c.name for c in found] == [name]
    assert np.allclose(found[0].readings.poses.q, right.poses.q)


def test_loads_of_two_poses_are_one_mistake(folder: Path) -> None:
    experiment, right = loaded(folder / "displacements")
    wrench, names = right.poses.wrench.copy(), list(right.states.pose)
    one = names.index("p04")
    two = next(i for i, w in enumerate(wrench) if w.any() and not np.allclose(w, wrench[one]))
    wrench[[one, two]] = wrench[[two, one]]
    found = adopted(find_mistakes(experiment, right.with_poses(replace(right.poses, wrench=wrench))))
    assert [c.name.partition("[")[0] for c in found] == ["loads_exchanged"]
    assert "the loads of poses" in found[0].words
    assert np.allclose(found[0].readings.poses.wrench, right.poses.wrench)


def test_the_constant_of_a_reflector(folder: Path) -> None:
    """The difference between a 1.5-inch and a 0.5-inch one."""
    experiment, right = loaded(folder / "positions")
    value = right.value.copy()
    own = right.marker == 1
    value[own] += 12.7e-3 * value[own] / np.linalg.norm(value[own], axis=1, keepdims=True)
    found = adopted(find_mistakes(experiment, right.with_values(value)))
    assert [c.name for c in found] == ["marker_constant"]
    assert np.isclose(found[0].value, 12.7e-3, atol=0.1e-3)
    assert "as between 1.5-inch and 0.5-inch ones" in found[0].words
    assert np.allclose(found[0].readings.value[own], right.value[own], atol=1e-4)


def test_nominal_geometry_that_is_off_is_no_exchange_of_markers(folder: Path) -> None:
    """Nests 5 to 15 mm off where the file has them: never called exchanged."""
    experiment, right = loaded(folder / "positions")
    rng = np.random.default_rng(0)
    for _ in range(5):
        off = rng.normal(size=(len(experiment.markers), 3))
        off *= rng.uniform(5e-3, 15e-3, (len(off), 1)) / np.linalg.norm(off, axis=1, keepdims=True)
        markers = tuple(replace(m, xyz=np.asarray(m.xyz) + d) for m, d in zip(experiment.markers, off, strict=True))
        found = find_mistakes(experiment.with_(markers=markers), right)
        assert not [c.name for c in found if c.compelling and "exchanged" in c.words]


def test_a_fit_that_misses_says_what_is_wrong_in_the_table(folder: Path) -> None:
    experiment, right = loaded(folder / "positions")
    wrong = shown(experiment, right, np.deg2rad(np.round(np.rad2deg(right.poses.pendant))))
    (found,) = identify(experiment, wrong).account.findings
    assert found.words.startswith("the angles are rounded")
    assert not identify(experiment, right).account.findings


def test_a_fit_that_does_not_settle_says_so_too(folder: Path) -> None:
    experiment, right = loaded(folder / "positions")
    with pytest.raises(NotConverged, match=r"Wrong in the table: .* one pose late"):
        identify(experiment, slipped(experiment, right, 8, 1))
