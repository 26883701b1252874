"""Displacements, positions, gauges and all of them in one fit: predicted right, and intervals that cover the truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.elastostatics.so3 import exponential
from qsframework.errors import InputError
from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Frame, Readings, load_experiment, make_plan, make_rows, simulate
from qsframework.experiment.readings import KINDS, joined
from qsframework.experiment.readings_file import read_readings
from qsframework.experiment.readings_table import write_readings
from qsframework.fits import identify
from qsframework.plugin import Array, Poses
from qsframework.report import error_tables
from tests.identify.arm import position_readings

ARM = """
robot: fanuc_m900ib
load: {point_mm: [150, 0, 200]}
markers:
  m1: {xyz_mm: [150, 250, 250]}
  m2: {xyz_mm: [400, -150, 150]}
  floor: {xyz_mm: [2500, 300, 0], link: LINK}
noise: {displacement_sigma_mm: 0.03, position_sigma_mm: 0.02, gauge_sigma_mm: 0.01}
fit: [joint_compliance]
"""
COUNT = 8
CAMPAIGNS = 25
LINEAR = FitOptions(linear=True, keep_all=True)
TRACKER = Frame("", exponential(np.array([0.3, -1.2, 2.0])), np.array([1.0, -2.0, 0.5]))
ALONG = np.array([[0.0, 0.0, 2.0], [1.0, 1.0, 0.0], [0.3, -2.0, 0.5]])
"""Directions of three dial gauges, of any length."""


@pytest.fixture(scope="module")
def arm(m900ib: Experiment, tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    file = tmp_path_factory.mktemp("arm") / "experiment.yaml"
    file.write_text(ARM.replace("LINK", m900ib.robot.facts.links[0]))
    return load_experiment(file)


@pytest.fixture(scope="module")
def poses(arm: Experiment) -> Poses:
    controller = arm.robot.controller
    pendant = np.random.default_rng(5).uniform(controller.lower, controller.upper, (COUNT, 6)) * 0.6
    return Poses(pendant, controller.to_joints(pendant), np.tile([0.0, 1500.0, -4000.0, 0, 0, 0], (COUNT, 1)))


def displaced_of(arm: Experiment, poses: Poses) -> Readings:
    readings = simulate(arm.with_(noise=replace(arm.noise, sigma=3e-5)), make_plan(poses, ["pull"] * COUNT)).readings
    return replace(readings, use=readings.marker < 2)


def positions_of(arm: Experiment, poses: Poses) -> Readings:
    both = np.stack([arm.model().positions(poses, None, flag) for flag in (False, True)], axis=1)
    seen = TRACKER.apply(both.reshape(2 * COUNT, -1, 3))
    twice, loaded = poses.take(np.repeat(np.arange(COUNT), 2)), np.tile([False, True], COUNT)
    readings = position_readings(twice, loaded, seen, 2e-5, pose=[f"t{i // 2}" for i in range(2 * COUNT)])
    return replace(readings, use=readings.marker < 2)


def gauges_of(arm: Experiment, poses: Poses, folder: Path) -> Readings:
    """Three dials and a draw-wire on each marker at every pose, read from a file of displacements."""
    head = [
        "pose",
        *(f"q{k + 1}_deg" for k in range(6)),
        "fx_N",
        "fy_N",
        "fz_N",
        "marker",
        "gauge_mm",
        "ux",
        "uy",
        "uz",
    ]
    rows = [",".join([*head, "to_marker"])]
    for i in range(COUNT):
        start = [f"g{i}", *np.degrees(poses.pendant[i]).tolist(), *poses.wrench[i, :3].tolist()]
        for marker in ("m1", "m2"):
            rows += [",".join(map(str, [*start, marker, 0.1, *u, ""])) for u in ALONG.tolist()]
            rows.append(",".join(map(str, [*start, marker, 0.1, "", "", "", "floor"])))
    (folder / "g.csv").write_text("\n".join(rows) + "\n")
    return read_readings(folder / "g.csv", arm)


@pytest.fixture(scope="module")
def kinds(arm: Experiment, poses: Poses, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Readings]:
    folder = tmp_path_factory.mktemp("gauges")
    out = {
        "displacement": displaced_of(arm, poses),
        "position": positions_of(arm, poses),
        "gauge": gauges_of(arm, poses, folder),
    }
    return out | {"mixed": joined(list(out.values()))}


def exact_of(arm: Experiment, readings: Readings, linear: bool = False) -> Array:
    rows = make_rows(readings)
    frames = (TRACKER,) * len(rows.estimated)
    return rows.predict(arm.model(), arm.model().nominal, frames, linear)


def campaign(arm: Experiment, readings: Readings, seed: int) -> Readings:
    """Readings of the linear model with noise as it is stated."""
    rows = make_rows(readings)
    value = np.array(readings.value)
    noise = rows.sigma * np.random.default_rng([3, seed]).standard_normal((len(rows.keep), 3))
    value[rows.keep] = exact_of(arm, readings, linear=True) + noise
    return readings.with_values(value)


def test_gauges_say_what_they_measure(arm: Experiment, poses: Poses, kinds: dict[str, Readings]) -> None:
    """Along its unit vector; and the change of a distance: both from the equilibria themselves."""
    readings = kinds["gauge"]
    assert readings.is_gauge.all()
    assert np.unique(readings.sigma).tolist() == [1e-5]
    found = exact_of(arm, readings)
    assert np.isfinite(readings.value).sum() == len(readings)
    before, after = (arm.model().positions(poses, None, flag) for flag in (False, True))
    i = 0
    for n in range(COUNT):
        for k in range(2):
            for u in ALONG:
                assert found[i, 0] == pytest.approx(u @ (after - before)[n, k] / np.linalg.norm(u), abs=1e-12)
                i += 1
            apart = [float(np.linalg.norm(p[n, k] - p[n, 2])) for p in (before, after)]
            assert found[i, 0] == pytest.approx(apart[1] - apart[0], abs=1e-12)
            i += 1
    assert i == len(readings)
    assert np.abs(found[:, 0]).max() > 1e-3


def test_each_kind_has_errors_of_its_own(arm: Experiment, kinds: dict[str, Readings]) -> None:
    """A gross row of each kind is unseen in the table of its kind, and in no other."""
    readings = campaign(arm, kinds["mixed"], 5)
    value, at = np.array(readings.value), {k: int(np.flatnonzero(readings.kind == k)[7]) for k in KINDS}
    for row in at.values():
        value[row] += 2e-3
    fit = identify(arm, readings.with_values(value))
    assert sorted(fit.missed_kind.tolist()) == sorted(KINDS)
    found = {t.header[0]: dict(t.rows) for t in error_tables(fit)}
    assert set(found) == {"displacements, 3D RMS", "gauges, 3D RMS", "positions, 3D RMS"}
    for kind, name in zip(("position", "displacement", "gauge"), found, strict=True):
        own, norm = fit.kind == kind, 1.0 if kind == "gauge" else 3.0
        square = norm * np.nanmean(np.square(fit.residuals[own]))
        assert float(found[name]["identified"]) == pytest.approx(1e3 * np.sqrt(square), abs=6e-5)
        left = np.concatenate([fit.left_out[own], fit.missed[fit.missed_kind == kind]])
        square = norm * np.nanmean(np.square(left))
        assert float(found[name]["held-out (leave one pose out)"]) == pytest.approx(1e3 * np.sqrt(square), abs=6e-5)
        clean = float(found[name]["the same without masked rows"])
        assert clean < 0.1 < 1.5 * float(found[name]["held-out (leave one pose out)"])


@pytest.mark.parametrize("linear", [True, False])
@pytest.mark.parametrize("kind", ["displacement", "position", "gauge", "mixed"])
def test_derivatives_against_finite_differences(
    arm: Experiment, kinds: dict[str, Readings], kind: str, linear: bool
) -> None:
    rows = make_rows(kinds[kind])
    model, names = arm.model(), arm.fit_names()
    x, frames = model.nominal, (TRACKER,) * len(rows.estimated)
    J = rows.rates(model, x, frames, names, linear)[1]
    for i, name in enumerate(names):
        step = np.zeros(len(x))
        step[model.index([name])] = 1e-2 * x[model.index([name])]
        ends = [rows.predict(model, x + s * step, frames, linear) for s in (1.0, -1.0)]
        slope = (ends[0] - ends[1]) / (2.0 * step.max())
        assert np.allclose(J[:, :, 6 * len(frames) + i], slope, rtol=1e-4, atol=1e-5 * np.abs(slope).max()), name
    for i in range(6 * len(frames)):
        motion = 1e-5 * np.eye(6)[i]
        ends = [rows.predict(model, x, (TRACKER.moved(s * motion),), linear) for s in (1.0, -1.0)]
        assert np.allclose(J[:, :, i], (ends[0] - ends[1]) / 2e-5, atol=1e-6)


@pytest.mark.parametrize("kind", ["displacement", "position", "gauge", "mixed"])
def test_intervals_cover_the_truth(arm: Experiment, kinds: dict[str, Readings], kind: str) -> None:
    """95 % intervals of 25 campaigns of each kind hold the truth in 90 to 99 % of cases; chi-square is its own.

    Of 150 intervals that are all a third too short 81 % would, and fewer than 90 % in 997 of 1,000 such tests.
    """
    truth, inside, squares, dof = arm.model().nominal, [], [], 0
    for seed in range(CAMPAIGNS):
        fit = identify(arm, campaign(arm, kinds[kind], seed), options=LINEAR)
        own = [e for e in fit.estimates if not e.name.startswith("frame")]
        assert [e.name for e in own] == list(arm.fit_names())
        at = fit.model.index([e.name for e in own])
        inside.append([abs(e.value - truth[i]) < 1.96 * e.sd for e, i in zip(own, at, strict=True)])
        squares.append(fit.chi2)
        dof = fit.dof
    assert 0.90 <= np.mean(inside) <= 0.99
    assert abs(np.mean(squares) - dof) < 4.0 * np.sqrt(2.0 * dof / CAMPAIGNS)


def test_together_they_tell_more_than_each_alone(arm: Experiment, kinds: dict[str, Readings]) -> None:
    """Information adds: no frame is shared between the kinds here, so that even the sums are exact."""
    fits = {k: identify(arm, campaign(arm, r, 1), options=LINEAR) for k, r in kinds.items()}
    size = arm.model().nominal[arm.model().index(arm.fit_names())]
    told = {}
    for k, fit in fits.items():
        at = [fit.names.index(n) for n in arm.fit_names()]
        told[k] = np.linalg.inv(fit.covariance[np.ix_(at, at)] / np.outer(size, size))
    alone = told["displacement"] + told["position"] + told["gauge"]
    assert np.allclose(told["mixed"], alone, rtol=1e-3, atol=1e-3 * np.abs(alone).max())


def test_the_equilibrium_is_found_again_from_every_kind(arm: Experiment, kinds: dict[str, Readings]) -> None:
    """Without noise, by the default model: from gauges along and between too."""
    for kind, readings in kinds.items():
        value = np.array(readings.value)
        value[make_rows(readings).keep] = exact_of(arm, readings)
        start = arm.with_(parameters=arm.parameters)
        robot = replace(
            start.robot,
            parameters=tuple(
                replace(p, nominal=1.2 * p.nominal) if p.name.startswith("joint_compliance") else p
                for p in start.robot.parameters
            ),
        )
        fit = identify(start.with_(robot=robot), readings.with_values(value), options=FitOptions(keep_all=True))
        assert np.allclose(fit.x, arm.model().nominal, rtol=2e-4), kind


def test_a_file_of_gauges_is_written_and_read_again(
    arm: Experiment, kinds: dict[str, Readings], tmp_path: Path
) -> None:
    made = campaign(arm, kinds["gauge"], 0)
    write_readings(tmp_path / "g.csv", made, arm)
    again = read_readings(tmp_path / "g.csv", arm)
    assert again.axes is not None
    assert made.axes is not None
    assert np.allclose(again.value[:, 0], made.value[:, 0], rtol=1e-9)
    assert np.allclose(again.axes[:, 0], made.axes[:, 0], atol=1e-12)
    assert again.to.tolist() == made.to.tolist()
    lone = (tmp_path / "g.csv").read_text().replace(",floor,", ",,")
    (tmp_path / "g.csv").write_text(lone)
    with pytest.raises(InputError, match="the gauge has no direction"):
        read_readings(tmp_path / "g.csv", arm)


def test_single_axes_may_be_missing(arm: Experiment, kinds: dict[str, Readings]) -> None:
    """What was not measured counts nowhere: as if its sigma were without limit, and left-out errors are refits'."""
    readings = campaign(arm, kinds["displacement"], 4)
    value, sigma = np.array(readings.value), np.array(readings.sigma)
    gone = np.random.default_rng(0).random(value.shape) < 0.25
    gone[readings.marker == 0, 0] = False  # some axis of every row stays
    gone[readings.marker == 1, 2] = False
    value[gone], sigma[gone] = np.nan, 1e3
    fit = identify(arm, replace(readings, value=value), options=LINEAR)
    loose = identify(arm, replace(readings, sigma=sigma), options=LINEAR)
    count = int((~gone[readings.use]).sum())
    assert fit.dof == count - 6
    assert loose.dof == int(readings.use.sum()) * 3 - 6
    assert np.allclose(fit.x, loose.x, rtol=1e-6)
    assert np.allclose(fit.covariance, loose.covariance, rtol=1e-6)
    assert np.array_equal(np.isnan(fit.residuals), gone[readings.use])
    assert np.array_equal(np.isnan(fit.studentised), gone[readings.use])
    out = readings.plus[readings.use] == 3
    rest = identify(arm, replace(readings, value=value, use=readings.use & (readings.plus != 3)), options=LINEAR)
    predicted, measured = rest.predict(replace(readings, value=value))
    assert np.allclose(fit.left_out[out], (measured - predicted)[out], rtol=1e-5, atol=1e-10, equal_nan=True)


def test_an_axis_that_is_never_measured_in_positions(arm: Experiment, kinds: dict[str, Readings]) -> None:
    """Some rows whole, which tell the frame, and one axis of the others only."""
    readings = campaign(arm, kinds["position"], 5)
    value = np.array(readings.value)
    value[readings.plus >= 8, 1:] = np.nan
    fit = identify(arm, replace(readings, value=value), options=LINEAR)
    assert fit.dof == int(np.isfinite(value[readings.use]).sum()) - len(fit.estimates)
    truth = arm.model().nominal[arm.model().index(arm.fit_names())]
    z = [(e.value - t) / e.sd for e, t in zip(fit.estimates[6:], truth, strict=True)]
    assert np.abs(z).max() < 4.0


def test_what_the_worst_kind_lacks_is_expected(arm: Experiment, poses: Poses) -> None:
    """Displacements whose load hung elsewhere, beside positions that fit: the positions' error alone promised less."""
    elsewhere = arm.with_(load_point=np.array([0.15, 0.9, 0.2]))
    fit = identify(arm, joined([displaced_of(elsewhere, poses), positions_of(arm, poses)]), options=LINEAR)
    kinds = {kind: of["held_out"] for kind, of in fit.errors.items()}
    assert kinds["displacement"] > 1.5 * kinds["position"]
    assert fit.held_out_error == kinds["position"]
    assert fit.held_out_worst == kinds["displacement"]
    assert fit.lack > 0.9 * kinds["displacement"] * np.sqrt(1.0 - 1.0 / fit.widening)
