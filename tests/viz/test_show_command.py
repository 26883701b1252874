"""`qsf show` from the command line: its page, its server, and what it says about bad input."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from headless import unpacked

from qsframework.cli.identify import FitFiles, run_identify
from qsframework.cli.show import Shown, make_scene, run_show
from qsframework.errors import InputError, QsfError
from qsframework.estimation import FitOptions
from qsframework.experiment import Experiment, Plan, example, make_plan, write_plan, write_readings
from qsframework.fits import read_fit
from qsframework.plugin import Poses
from qsframework.robot import load_robot
from qsframework.uses import stiffness_at
from tests.diagnose.cases import candidates, day_of_positions

M900IB = example("m900ib") / "experiment.yaml"
R2000IC = example("r2000ic") / "experiment.yaml"


def a_plan(experiment: Experiment, degrees: list[float]) -> Plan:
    pendant = np.deg2rad([degrees])
    wrench = np.array([[0.0, 0, -1000, 0, 0, 0]])
    return make_plan(Poses(pendant, experiment.robot.controller.to_joints(pendant), wrench), ["weight"])


@pytest.fixture(scope="module")
def plan(m900ib: Experiment, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("plan") / "plan.csv"
    write_plan(path, a_plan(m900ib, [10.0, 20.0, -10.0, 0.0, 40.0, 0.0]), m900ib)
    return path


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fit") / "fit.json"
    subprocess.run(
        [sys.executable, "-m", "qsframework", "identify", str(R2000IC), "--json", str(path)],
        check=True,
        capture_output=True,
    )
    return path


def test_a_page_of_a_robot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run_show(Shown(subject="fanuc_m900ib"), tmp_path / "robot.html", 7000)
    assert "scene:" in capsys.readouterr().out
    assert "MeshCat.Viewer" in (tmp_path / "robot.html").read_text()


def test_a_robot_can_be_a_path(root: Path) -> None:
    scene = make_scene(Shown(subject=str(root / "robots" / "ur10" / "robot.yaml"), load="0,0,-100", point="0,0,50"))
    assert scene.title.startswith("Universal Robots UR10")
    assert "deflected" in scene.layers


def test_a_plan_is_shown(plan: Path) -> None:
    scene = make_scene(Shown(subject=str(M900IB), plan=plan))
    assert scene.steps[0][1].startswith("p01 (weight), the load point moves")
    assert (
        make_scene(Shown(subject="fanuc_m900ib", plan=plan)).steps[0][0] == "poses/0"
    )  # a robot by itself takes plans too


def test_a_fit_brings_its_values_and_residuals(fit: Path, plan: Path) -> None:
    scene = make_scene(Shown(subject=str(R2000IC), fit=fit))
    assert len(scene.layers["residuals"]) == len(scene.steps) == 40
    stored = read_fit(fit)
    rms = 1e3 * stored.sigma * float(np.sqrt(stored.chi2 / (stored.dof + len(stored.names))))
    told = next(note for note in scene.notes if note.startswith("Purple"))
    # The note speaks of the shown poses, those with the largest residuals: a little more than the fit's own RMS.
    assert rms <= float(told.split("axis ")[1].split(" mm")[0]) < 1.1 * rms
    assert not any("not of the readings" in note for note in scene.notes)


def test_a_fit_with_one_pose_lets_its_residuals_float(fit: Path) -> None:
    scene = make_scene(Shown(subject=str(R2000IC), fit=fit, pose="0,0,0,0,30,0", load="0,0,-1000"))
    assert scene.layers["residuals"] == ["residuals"]
    assert "deflected" in scene.layers


def test_other_readings_than_the_fits_are_told(fit: Path, tmp_path: Path) -> None:
    lines = (example("r2000ic") / "readings.csv").read_text().splitlines()
    (tmp_path / "few.csv").write_text("\n".join(lines[:-3]) + "\n")
    scene = make_scene(Shown(subject=str(R2000IC), fit=fit, data=tmp_path / "few.csv"))
    assert not any("not of the readings" in note for note in scene.notes), "a part of them is known again"
    other = [f"{line}1" if line[:1].isdigit() else line for line in lines]
    (tmp_path / "other.csv").write_text("\n".join(other) + "\n")
    scene = make_scene(Shown(subject=str(R2000IC), fit=fit, data=tmp_path / "other.csv"))
    assert any("The fit is not of the readings in" in note and "other.csv" in note for note in scene.notes)


def test_residuals_of_a_day_of_positions(
    m900ib: Experiment, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Loaded minus unloaded positions, as `qsf identify` fits them where it is to find springs only."""
    states, fit = tmp_path / "states.csv", tmp_path / "fit.json"
    model = m900ib.model()
    write_readings(states, day_of_positions(model, model.nominal, candidates()[:6], 1), m900ib)
    run_identify(FitFiles(experiment=m900ib.path, data=(states,), json=fit), None, FitOptions(), clean=False)
    scene = make_scene(Shown(subject=str(M900IB), fit=fit, data=states))
    assert len(scene.layers["residuals"]) == len(scene.steps) == 12
    assert not any("not of the readings" in note for note in scene.notes)
    capsys.readouterr()
    run_show(Shown(subject=str(M900IB), fit=fit), tmp_path / "d.html", 7000)
    assert "No residual vectors: the experiment names no readings; name a file of them too." in capsys.readouterr().out


def test_positions_of_an_unloaded_arm_have_residual_vectors(m900ib: Experiment, tmp_path: Path) -> None:
    """Absolute positions in a frame that the fit found: what they miss is drawn, as of any reading."""
    states, fit = tmp_path / "states.csv", tmp_path / "fit.json"
    model = m900ib.model()
    day = day_of_positions(model, model.nominal, candidates()[:6], 1, turned=(0.3, -0.1, 2.0), origin=(1.0, -2.0, 0.5))
    write_readings(states, day, m900ib)
    files = FitFiles(experiment=m900ib.path, data=(states,), json=fit, states="positions")
    run_identify(files, None, FitOptions(), clean=False)
    unloaded = tmp_path / "unloaded.csv"
    write_readings(unloaded, replace(day, use=~day.states.loaded[day.plus]), m900ib)
    scene = make_scene(Shown(subject=str(M900IB), fit=fit, data=unloaded))
    assert len(scene.layers["residuals"]) == len(scene.steps) == 6
    told = next(note for note in scene.notes if note.startswith("Purple"))
    assert 0.015 < float(told.split("axis ")[1].split(" mm")[0]) < 0.025  # the noise, 0.02 mm


@pytest.mark.parametrize(
    ("shown", "words"),
    [
        (Shown(subject="fanuc_m900i"), "unknown robot 'fanuc_m900i'.*fanuc_m900ib"),
        (Shown(subject="nowhere.yaml"), "unknown robot 'nowhere.yaml'"),
        (Shown(subject="fanuc_m900ib", scale=0.0), "--scale 0: allowed: a number above 0"),
        (Shown(subject="fanuc_m900ib", scale=-1.0), "--scale -1"),
        (
            Shown(subject="fanuc_m900ib", pose="0,95,0,0,0,0"),
            "joint_2 is outside its limits; found 95 deg; allowed: -64 to 90",
        ),
        (Shown(subject="fanuc_m900ib", pose="0,0,0"), "--pose: found 3 numbers"),
        (Shown(subject="fanuc_m900ib", load="0,0"), "--load: found 2 numbers"),
        (Shown(subject="fanuc_m900ib", load="a,b,c"), "--load: found 'a,b,c'"),
        (Shown(subject=str(M900IB), point="0,0,0"), "--point is for a robot by itself"),
        (Shown(subject=str(M900IB), data=Path("readings.csv")), "name a fit.json too"),
        (Shown(subject=str(M900IB), plan=Path("nowhere.csv")), "nowhere.csv"),
        (Shown(subject=str(M900IB), fit=Path("nowhere.json")), "nowhere.json"),
    ],
)
def test_bad_input_says_what_to_do(shown: Shown, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make_scene(shown)


def test_a_plan_of_another_robot_is_refused(plan: Path) -> None:
    with pytest.raises(InputError, match="fanuc_m900ib"):
        make_scene(Shown(subject=str(R2000IC), plan=plan))


def test_a_fit_of_another_robot_is_refused(fit: Path) -> None:
    with pytest.raises(InputError, match="the fit is of another robot; found fanuc_r2000ic; allowed: fanuc_m900ib"):
        make_scene(Shown(subject=str(M900IB), fit=fit))


def test_a_plan_keeps_its_own_pose(plan: Path) -> None:
    with pytest.raises(InputError, match="leave out --pose and --load"):
        make_scene(Shown(subject=str(M900IB), plan=plan, pose="0,0,0,0,0,0"))


def test_the_page_does_not_overwrite_its_input(plan: Path) -> None:
    with pytest.raises(QsfError, match=r"plan\.csv"):
        run_show(Shown(subject=str(M900IB), plan=plan), plan, 7000)


def test_bad_input_ends_with_code_two() -> None:
    run = subprocess.run(
        [sys.executable, "-m", "qsframework", "show", "fanuc_m900ib", "--scale", "0"], capture_output=True, text=True
    )
    assert run.returncode == 2
    assert run.stderr.startswith("error: --scale 0")


def test_the_stiffness_report_holds_the_scene_of_its_load(tmp_path: Path) -> None:
    from html.parser import HTMLParser

    from qsframework.cli.stiffness import run_stiffness

    class Frames(HTMLParser):
        pages: list[str]

        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            if tag == "iframe":
                self.pages.append(unpacked(dict(attrs)["data-page"] or ""))

    report = tmp_path / "stiffness.html"
    run_stiffness("fanuc_m900ib", "0,20,-10,30,40,0", "0,0,-4000", "150,0,200", None, report)
    frames = Frames()
    frames.pages = []
    frames.feed(report.read_text())
    (page,) = frames.pages
    size = 1e3 * float(
        np.linalg.norm(
            stiffness_at(
                load_robot("fanuc_m900ib"),
                np.deg2rad([0.0, 20, -10, 30, 40, 0]),
                np.array([0.0, 0, -4000, 0, 0, 0]),
                np.array([0.15, 0.0, 0.2]),
            ).full
        )
    )
    assert f"the load point moves {size:.3f} mm" in page


def test_the_pages_example_runs(root: Path, plan: Path, tmp_path: Path) -> None:
    (code,) = re.findall(r"```python\n(.*?)```", (root / "docs" / "show.md").read_text(), re.S)
    (tmp_path / "experiment.yaml").write_text(M900IB.read_text())
    (tmp_path / "plan.csv").write_text(plan.read_text())
    subprocess.run([sys.executable, "-W", "ignore::ResourceWarning", "-c", code], cwd=tmp_path, check=True)
    assert "x 200" in (tmp_path / "scene.html").read_text()


def test_it_serves_until_it_is_stopped() -> None:
    environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
    command = [sys.executable, "-m", "qsframework", "show", "ur10", "--port", "0"]
    run = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        assert run.stdout is not None
        assert run.stdout.readline().startswith("Ctrl-C ends qsf show")
        address = run.stdout.readline().split()[0]
        assert address.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(address, timeout=300) as answer:
            page = answer.read().decode()
        assert "Universal Robots UR10" in page
        assert '"watch":"/changed"' in page
    finally:
        run.send_signal(signal.SIGINT)
        assert run.wait(timeout=300) == 0
        if run.stdout is not None:
            run.stdout.close()
