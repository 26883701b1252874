"""Profile intervals of fits: at their ends the best fit of the others is as much worse as the quantile allows."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import t
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.errors import InputError
from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Readings, example, make_plan, simulate
from qsframework.fits import identify
from tests.identify.arm import random_poses

BALANCER = "gravity_compensator[joint_2].stiffness"


@pytest.fixture(scope="module")
def simulated(m900ib: Experiment) -> tuple[Experiment, Readings]:
    """Ten poses under the side pull; the balancer's spring is hardly told."""
    poses = random_poses(m900ib, 1, 10, seed=5)
    return m900ib, simulate(m900ib, make_plan(poses, ["pull"] * 10), seed=2).readings


@pytest.mark.parametrize("linear", [True, False])
def test_outside_the_interval_of_a_fit_the_best_of_the_others_is_worse(
    simulated: tuple[Experiment, Readings], linear: bool
) -> None:
    """Held at the ends of its interval, the fit of all others has the chi-square that the quantile allows."""
    experiment, readings = simulated
    names = ("joint_compliance[joint_2]", "joint_compliance[joint_3]")
    fit = identify(experiment, readings, None, FitOptions(linear=linear, profile=names))
    assert tuple(i.name for i in fit.intervals) == names
    for interval in fit.intervals:
        estimate = next(e for e in fit.estimates if e.name == interval.name)
        assert interval.lower < estimate.value < interval.upper
        np.testing.assert_allclose(
            interval.linear, estimate.value + np.array([-1, 1]) * 1.959964 * estimate.sd, rtol=1e-6
        )
        for end in (interval.lower, interval.upper):
            held = at(experiment, interval.name, end)
            worse = identify(held, readings, fit.names, FitOptions(linear=linear, fixed=(interval.name,)))
            assert worse.chi2 - fit.chi2 == pytest.approx(3.841459, abs=1e-3)


def at(experiment: Experiment, name: str, value: float) -> Experiment:
    """The experiment with another nominal value of one parameter of its robot."""
    robot = experiment.robot
    parameters = tuple(replace(p, nominal=value) if p.name == name else p for p in robot.parameters)
    return experiment.with_(robot=replace(robot, parameters=parameters))


def test_an_interval_that_reaches_a_bound_in_a_fit(simulated: tuple[Experiment, Readings]) -> None:
    """These readings do not identify the balancer's spring: its interval reaches down to its bound, of no spring."""
    experiment, readings = simulated
    options = FitOptions(bounds=True, profile=(BALANCER,))
    fit = identify(experiment, readings, ("joint_compliance", BALANCER), options)
    (interval,) = fit.intervals
    assert interval.lower == 0.0
    assert interval.upper > experiment.model().nominal[experiment.model().index([BALANCER])[0]]
    assert interval.linear[0] < 0.0


def test_what_profiles_are_for(simulated: tuple[Experiment, Readings]) -> None:
    experiment, readings = simulated
    name = "joint_compliance[joint_2]"
    with pytest.raises(InputError, match="profile are for method one-step"):
        FitOptions(method="two-step", profile=(name,))
    with pytest.raises(InputError, match="no parameter 'joint_compliance'"):
        identify(experiment, readings, options=FitOptions(profile=("joint_compliance",)))
    with pytest.raises(InputError, match=r"joint_compliance\[joint_2\] is fixed: there is no interval|no parameter"):
        identify(experiment, readings, options=FitOptions(fixed=(name,), profile=(name,)))


def test_the_command_gives_the_intervals_that_are_asked_for(tmp_path: Path) -> None:
    """In a nearly linear model with estimated noise they are value +- t sd; positions have them too."""
    asked = ["--profile", "joint_compliance[joint_4]"]
    written = ["--linear", "--json", str(tmp_path / "fit.json"), "--report", str(tmp_path / "fit.html")]
    done = CliRunner().invoke(app, ["identify", str(example("r2000ic") / "experiment.yaml"), *asked, *written])
    assert done.exit_code == 0, done.output
    fit = json.loads((tmp_path / "fit.json").read_text())
    (found,) = fit["intervals"].values()
    estimate = fit["estimates"]["joint_compliance[joint_4]"]
    sides = np.array([-1, 1]) * t.ppf(0.975, fit["dof"]) * estimate["sd"]
    np.testing.assert_allclose([found["lower"], found["upper"]], estimate["value"] + sides, rtol=1e-4)
    assert "Profile intervals: within them" in done.output
    assert "Profile intervals: within them" in (tmp_path / "fit.html").read_text()
    ur10 = [str(example("ur10") / "experiment.yaml"), str(example("ur10") / "series_d.csv")]
    asked = ["--profile", "joint_offset[joint_2]", "--keep-all", "--linear"]
    done = CliRunner().invoke(app, ["identify", *ur10, *asked])
    assert done.exit_code == 0, done.output
    assert "Profile intervals: within them" in done.output
