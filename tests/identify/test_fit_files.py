"""Result files: what is written is read back, and a robot can be loaded from it."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.cli.demo import read_as_relative
from qsframework.elastostatics import Model, make_model
from qsframework.errors import InputError
from qsframework.estimation import FitOptions
from qsframework.experiment import (
    Experiment,
    LoadUncertainty,
    Readings,
    load_experiment,
    make_plan,
    read_readings,
    simulate,
)
from qsframework.fits import Fit, identify, read_fit, write_fit, write_nominal
from qsframework.fits.io import result_files, write_campaign, write_urdf
from qsframework.plugin import Poses, build_effects
from qsframework.robot import load_robot
from tests.identify.arm import random_poses

LINEAR, BOUNDS = FitOptions(linear=True, keep_all=True), FitOptions(linear=True, bounds=True, keep_all=True)


def test_a_fit_is_read_back(r2000ic: Experiment, real: Readings, tmp_path: Path) -> None:
    fit = identify(r2000ic, real, options=LINEAR)
    stored = read_fit(write_fit(fit, tmp_path / "fit.json"))
    assert stored.names == fit.names
    assert np.array_equal(stored.values, [e.value for e in fit.estimates])
    assert np.array_equal(stored.sd, [e.sd for e in fit.estimates])
    assert np.array_equal(stored.covariance, fit.covariance)
    assert np.array_equal(stored.x_of(fit.model), fit.x)
    assert (stored.method, stored.sigma_source, stored.dof) == ("one-step", "estimated", fit.dof)
    assert stored.sigma == fit.sigma
    assert stored.linear
    assert stored.account.is_of(real)
    assert stored.account.has_used(real.of_rows(np.arange(5)))
    assert not stored.account.has_used(real.with_values(real.value + 1e-4))


def test_an_sd_that_is_not_quoted_stays_unquoted(r2000ic: Experiment, real: Readings, tmp_path: Path) -> None:
    fit = identify(read_as_relative(r2000ic, "joint_3"), real, options=BOUNDS)
    stored = read_fit(write_fit(fit, tmp_path / "fit.json"))
    assert np.isnan(stored.sd[4])
    with pytest.raises(InputError, match="the fit is of another model"):
        stored.x_of(_with(r2000ic, {"effect": "joint_offset", "joint": "joint_1"}).model())


def test_all_problems_of_a_fit_file_at_once(r2000ic: Experiment, real: Readings, tmp_path: Path) -> None:
    content = identify(r2000ic, real, options=LINEAR).as_json()
    content["dof"] = "many"
    del content["chi2"]
    content["estimates"]["joint_compliance[joint_1]"]["value"] = None
    path = tmp_path / "fit.json"
    path.write_text(json.dumps(content, indent=2))
    with pytest.raises(InputError) as caught:
        read_fit(path)
    said = str(caught.value)
    assert "dof" in said
    assert "chi2" in said
    assert "joint_compliance[joint_1].value" in said
    content = identify(r2000ic, real, options=LINEAR).as_json()
    content["covariance"] = content["covariance"][:-1]
    content["parameters"][0] = "joint_compliance[joint_9]"
    path.write_text(json.dumps(content, indent=2))
    with pytest.raises(InputError) as caught:
        read_fit(path)
    assert len(caught.value.problems) == 2
    assert all(p.line for p in caught.value.problems)


def test_a_robot_loads_with_the_identified_values(r2000ic: Experiment, real: Readings, tmp_path: Path) -> None:
    """Each is known to the noise, to the load and to what was held."""
    fit = identify(r2000ic.with_(load_uncertainty=LoadUncertainty(0.1, 0.0)), real, options=LINEAR)
    folder = tmp_path / "robot"
    shutil.copytree(r2000ic.robot.folder, folder)
    write_nominal(fit, folder / "nominal.yaml", r2000ic.robot)
    loaded = {p.name: p for p in load_robot(folder).parameters}
    for e, sd in zip(fit.estimates, fit.sd_total, strict=True):
        assert loaded[e.name].nominal == pytest.approx(e.value, rel=1e-12)
        assert loaded[e.name].sd == pytest.approx(sd, rel=1e-12)
        assert sd > e.sd
        assert "identified, one-step, readings sha256" in loaded[e.name].source
    wrong = identify(read_as_relative(r2000ic, "joint_3"), real, options=LINEAR)
    with pytest.raises(InputError, match=r"joint_compliance\[joint_5\] beyond its bounds"):
        write_nominal(wrong, folder / "nominal.yaml", r2000ic.robot)


@pytest.mark.parametrize(("number", "hint"), [(2, "A newer qsframework wrote it"), (0, ""), (True, ""), ("one", "")])
def test_a_file_of_an_unknown_format_is_refused_before_it_is_read(
    number: object, hint: str, r2000ic: Experiment, real: Readings, tmp_path: Path
) -> None:
    content = identify(r2000ic, real, options=LINEAR).as_json()
    assert content["format"] == 1
    content["format"] = number
    del content["chi2"]
    path = tmp_path / "fit.json"
    path.write_text(json.dumps(content, indent=2))
    with pytest.raises(InputError, match="of a format that this qsframework does not read") as caught:
        read_fit(path)
    assert hint in str(caught.value)
    assert caught.value.problems[0].line == content_line(path, '"format"')


def test_a_file_without_a_format_is_of_the_first(r2000ic: Experiment, real: Readings, tmp_path: Path) -> None:
    content = identify(r2000ic, real, options=LINEAR).as_json()
    del content["format"]
    path = tmp_path / "fit.json"
    path.write_text(json.dumps(content))
    assert read_fit(path).dof == content["dof"]


def content_line(path: Path, text: str) -> int:
    return next(i for i, line in enumerate(path.read_text().splitlines(), 1) if text in line)


def _with(experiment: Experiment, *entries: dict[str, object]) -> Experiment:
    facts = experiment.robot.facts
    effects = tuple(e for entry in entries for e in build_effects(entry, facts))
    more = tuple(p for e in effects for p in e.parameters(facts))
    return experiment.with_(effects=(*experiment.effects, *effects), parameters=(*experiment.parameters, *more))


GEOMETRY = (
    {"effect": "joint_placement", "joint": "joint_2"},
    {"effect": "joint_placement", "joint": "joint_5"},
    {"effect": "joint_offset", "joint": "joint_4"},
)


def test_the_corrected_urdf_moves_as_the_corrected_model(r2000ic: Experiment, tmp_path: Path) -> None:
    """Unloaded positions of three points of the flange: the written robot's own against the corrected model's."""
    experiment = _with(r2000ic, *GEOMETRY, {"effect": "encoder_eccentricity", "joint": "joint_6"})
    model = experiment.model()
    rng = np.random.default_rng(0)
    x = model.nominal
    moved = [i for i, n in enumerate(model.names) if n.startswith(("joint_placement", "joint_offset"))]
    x[moved] = rng.normal(size=len(moved)) * 5e-3
    x[[i for i, n in enumerate(model.names) if n.startswith("encoder")]] = 1e-3
    folder = tmp_path / "robot"
    shutil.copytree(r2000ic.robot.folder, folder)
    left = write_urdf(r2000ic.robot, model, x, folder / "corrected.urdf")
    assert left == ("encoder_eccentricity[joint_6]",)
    text = (folder / "robot.yaml").read_text()
    (line,) = (part for part in text.splitlines() if part.startswith("urdf:"))
    (folder / "robot.yaml").write_text(text.replace(line, "urdf: corrected.urdf"))
    robot = load_robot(folder)
    q = rng.uniform(-1.0, 1.0, (20, 6))
    poses = Poses(q, q, np.zeros((20, 6)))

    def points(source: Experiment, effects: tuple[dict[str, object], ...]) -> Model:
        bare = _with(source.with_(effects=(), parameters=()), *effects)
        sites = [(f"m{i}", source.site("link_6", 0.3 * np.eye(3)[i])) for i in range(3)]
        return make_model(source.robot.facts, bare.effects, bare.parameters, source.load_site, sites, np.zeros(3))

    true = points(r2000ic, GEOMETRY)
    values = dict(zip(model.names, x, strict=True))
    expected = true.positions(poses, np.array([values[n] for n in true.names]))
    written = points(r2000ic.with_(robot=robot), ())
    assert np.abs(expected - points(r2000ic, ()).positions(poses)).max() > 1e-3
    assert np.allclose(written.positions(poses), expected, atol=1e-12)


def test_an_offset_through_a_loop_is_refused(m900ib: Experiment, tmp_path: Path) -> None:
    experiment = _with(m900ib, {"effect": "joint_offset", "joint": "joint_2"})
    x = experiment.model().nominal
    x[experiment.model().index(["joint_offset[joint_2]"])] = 1e-3
    with pytest.raises(InputError, match="passes through a closed loop"):
        write_urdf(m900ib.robot, experiment.model(), x, tmp_path / "out.urdf")
    assert not (tmp_path / "out.urdf").exists()


def test_a_campaigns_parameters_are_not_the_robots(r2000ic: Experiment, real: Readings, tmp_path: Path) -> None:
    scaled = _with(r2000ic, {"effect": "marker_offset", "marker": r2000ic.markers[0].name})
    fit = identify(scaled, real, options=LINEAR)
    fit = replace(fit, estimates=(replace(fit.estimates[0], name="load_scale"), *fit.estimates[1:]))
    path = write_nominal(fit, tmp_path / "nominal.yaml", r2000ic.robot)
    assert "# Identified too, but not the robot's: load_scale" in path.read_text()


def test_a_covariance_that_is_not_symmetric_is_refused(r2000ic: Experiment, real: Readings, tmp_path: Path) -> None:
    content = identify(r2000ic, real, options=LINEAR).as_json()
    content["covariance"][0][1] *= 2.0
    path = tmp_path / "fit.json"
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match="covariance is not symmetric"):
        read_fit(path)


def test_values_that_were_not_identified_stay_in_the_nominal_file(m900ib: Experiment, tmp_path: Path) -> None:
    """The balancer's spring, known and not fitted, with its own source; and it loads."""
    poses = random_poses(m900ib, 1, 8)
    fit = identify(m900ib, simulate(m900ib, make_plan(poses, ["pull"] * 8)).readings, options=LINEAR)
    folder = tmp_path / "robot"
    shutil.copytree(m900ib.robot.folder, folder)
    write_nominal(fit, folder / "nominal.yaml", m900ib.robot)
    before = {p.name: p for p in m900ib.robot.parameters}
    after = {p.name: p for p in load_robot(folder).parameters}
    assert set(after) == set(before)
    for name, p in after.items():
        found = next((e for e in fit.estimates if e.name == name), None)
        assert p.nominal == pytest.approx(found.value if found else before[name].nominal, rel=1e-12)
        assert p.source == before[name].source if found is None else p.source.startswith("identified, one-step")


UR10 = Path(__file__).parents[2] / "examples" / "ur10"


@pytest.fixture(scope="module")
def ur10() -> Fit:
    """Zeros, placements, sag and the target: all of them of effects of the experiment."""
    experiment = load_experiment(UR10 / "experiment.yaml")
    return identify(experiment, read_readings(UR10 / "series_b.csv", experiment, "positions"), options=LINEAR)


def test_identified_values_that_are_not_the_robots_are_read_by_an_experiment(ur10: Fit, tmp_path: Path) -> None:
    experiment = load_experiment(UR10 / "experiment.yaml")
    said = result_files(ur10, experiment.robot, tmp_path / "n.yaml")
    count = len(ur10.names)
    assert said[0] == f"nominal values: {tmp_path / 'n.yaml'}, with 0 of {count} identified values"
    assert f"{count - 6} identified values, in {tmp_path / 'n_campaign.yaml'}" in said[1]
    assert "6 of the tracker's frame" in said[2]
    text = (UR10 / "experiment.yaml").read_text()
    (tmp_path / "experiment.yaml").write_text(text + "nominal: n_campaign.yaml\n")
    again = {p.name: p for p in load_experiment(tmp_path / "experiment.yaml").parameters}
    for e, sd in zip(ur10.estimates[6:], ur10.sd_total[6:], strict=True):
        assert again[e.name].nominal == pytest.approx(e.value, rel=1e-12)
        assert again[e.name].sd == pytest.approx(sd, rel=1e-12)
    nominal = load_experiment(tmp_path / "experiment.yaml").model().nominal
    arm = np.isin(ur10.model.names, [p.name for p in experiment.robot.parameters])  # rigid here
    assert nominal[~arm] == pytest.approx(ur10.x[~arm], rel=1e-12, abs=1e-15)


def test_a_file_of_somebody_else_is_not_replaced(ur10: Fit, tmp_path: Path) -> None:
    robot = load_experiment(UR10 / "experiment.yaml").robot
    file = tmp_path / "c.yaml"
    assert len(write_campaign(ur10, file, robot)) == len(ur10.names) - 6
    assert write_campaign(ur10, file, robot), "its own file it replaces"
    file.write_text("joint_offset[joint_2]: {value_mrad: 1}\n")
    with pytest.raises(InputError, match="stands there and was not written by this command"):
        write_campaign(ur10, file, robot)
    assert file.read_text() == "joint_offset[joint_2]: {value_mrad: 1}\n"


def test_nothing_of_the_campaign(r2000ic: Experiment, real: Readings, tmp_path: Path) -> None:
    fit = identify(r2000ic, real, options=LINEAR)
    (said,) = result_files(fit, r2000ic.robot, tmp_path / "n.yaml")
    assert said.endswith("with 6 of 6 identified values")
    assert not (tmp_path / "n_campaign.yaml").exists()


def test_the_frames_of_a_fit_are_read_back(ur10: Fit, tmp_path: Path) -> None:
    """And what is no rotation is refused with its line."""
    path = write_fit(ur10, tmp_path / "fit.json")
    (frame,), (true,) = read_fit(path).frames, ur10.frames
    assert frame.series == true.series
    assert np.array_equal(frame.rotation, true.rotation)
    assert np.array_equal(frame.origin, true.origin)
    content = json.loads(path.read_text())
    content["frames"][true.series]["rotation"][0][0] += 0.1
    path.write_text(json.dumps(content, indent=2))
    with pytest.raises(InputError, match="is no rigid motion") as caught:
        read_fit(path)
    assert caught.value.problems[0].line == content_line(path, '"rotation"')
