"""Wrong fits by kind x every verb that uses one: each is refused with the spoilt thing named, the sound one is not."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.errors import InputError
from qsframework.fits import read_fit
from qsframework.robot import load_robot
from qsframework.uses.robot_from_fit import with_fit

ROOT = Path(__file__).resolve().parents[2]
TARGETS = "target,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,fx_N,fy_N,fz_N\na,10,20,-10,5,60,0,0,0,-1500\n"
SECOND, FIFTH = "joint_compliance[joint_2]", "joint_compliance[joint_5]"


def run(*arguments: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, [str(a) for a in arguments])
    return done.exit_code, " ".join(f"{done.output} {done.exception or ''}".split())


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign in its own folder: robot, experiment, readings, and the fit that was made of them."""
    folder = tmp_path_factory.mktemp("sound")
    shutil.copytree(ROOT / "robots" / "fanuc_m900ib", folder / "rb")
    text = (ROOT / "examples" / "m900ib" / "experiment.yaml").read_text()
    (folder / "e.yaml").write_text(text.replace("robot: fanuc_m900ib", "robot: ./rb\ndata: r.csv"))
    (folder / "t.csv").write_text(TARGETS)
    assert run("design", folder / "e.yaml", "--candidates", 300, "-o", folder / "p.csv")[0] == 0
    assert run("simulate", folder / "e.yaml", folder / "p.csv", "--truth", "drawn", "-o", folder / "r.csv")[0] == 0
    without_sigma(folder / "r.csv")
    assert run("identify", folder / "e.yaml", "--json", folder / "fit.json")[0] == 0
    return folder


def without_sigma(path: Path) -> None:
    """Leave the noise to the experiment."""
    head, *lines = [line.split(",") for line in path.read_text().splitlines() if not line.startswith("#")]
    kept = [i for i, name in enumerate(head) if "sigma" not in name]
    path.write_text("".join(",".join(row[i] for i in kept) + "\n" for row in (head, *lines)))


def verbs(folder: Path) -> Iterator[tuple[str, tuple[object, ...], Path]]:
    """Every verb that uses a fit, and what it writes."""
    e, fit = folder / "e.yaml", folder / "fit.json"
    yield "compensate", (e, fit, folder / "t.csv", "-o", folder / "c.csv"), folder / "c.csv"
    yield "certificate", (e, fit, "--halves", 2, "-o", folder / "c.html"), folder / "c.html"
    yield "kinematics", (e, fit, "--urdf", folder / "k.urdf"), folder / "k.urdf"
    yield "show", (e, fit, "--html", folder / "s.html"), folder / "s.html"


@contextmanager
def edited(path: Path) -> Generator[dict[str, Any]]:
    content = json.loads(path.read_text())
    yield content
    path.write_text(json.dumps(content))


def text(name: str, old: str, new: str) -> Callable[[Path], None]:
    """A change of one of the campaign's files."""

    def change(folder: Path) -> None:
        before = (folder / name).read_text()
        assert re.search(old, before), (name, old)
        (folder / name).write_text(re.sub(old, new, before, count=1))

    return change


def stored(change: Callable[[dict[str, Any]], None]) -> Callable[[Path], None]:
    """A change of the fit's file."""

    def spoil(folder: Path) -> None:
        with edited(folder / "fit.json") as fit:
            change(fit)

    return spoil


def both(fit: dict[str, Any], values: dict[str, float]) -> None:
    for name, value in values.items():
        fit["estimates"][name]["value"] = fit["model_values"][name] = value


def swapped(fit: dict[str, Any]) -> None:
    both(fit, {SECOND: fit["model_values"][FIFTH], FIFTH: fit["model_values"][SECOND]})


def reordered(fit: dict[str, Any]) -> None:
    fit["parameters"] = [*fit["parameters"][1:], fit["parameters"][0]]


def scaled(key: str, factor: float) -> Callable[[dict[str, Any]], None]:
    return lambda fit: fit.update({key: (np.asarray(fit[key]) * factor).tolist()})


def exchanged(fit: dict[str, Any]) -> None:
    """Rows and columns of two parameters in the covariance."""
    order = [1, 0, *range(2, len(fit["covariance"]))]
    fit["covariance"] = np.asarray(fit["covariance"])[np.ix_(order, order)].tolist()


def other_name(folder: Path) -> None:
    text("rb/robot.yaml", "name: fanuc_m900ib", "name: other")(folder)


def another_row(folder: Path) -> None:
    lines = (folder / "r.csv").read_text().splitlines()
    (folder / "r.csv").write_text("\n".join(lines[:-3]) + "\n")


KINDS: dict[str, tuple[Callable[[Path], None], str]] = {
    "one value": (stored(lambda f: f["estimates"][SECOND].update(value=1.4e-6)), "among the estimates"),
    "one value of the model": (stored(lambda f: f["model_values"].update({SECOND: 1.4e-6})), "in the model"),
    "ten times": (
        stored(lambda f: both(f, {SECOND: 10.0 * f["model_values"][SECOND]})),
        "joint_2. is .* readings give",
    ),
    "two springs": (stored(swapped), "joint_2. is .* readings give"),
    "order": (stored(reordered), "covariance|another order"),
    "covariance / 1e12": (stored(scaled("covariance", 1e-12)), "covariance is not the one"),
    "covariance, half": (stored(scaled("covariance", 0.5)), "covariance is not the one"),
    "covariance exchanged": (stored(exchanged), "covariance is not the one"),
    "covariance negative": (stored(scaled("covariance", -1.0)), "a variance would be below zero"),
    "sigma": (stored(scaled("sigma_m", 100.0)), "its noise is 3 mm"),
    "sum of squares": (stored(scaled("chi2", 0.5)), "its sum of squares is"),
    "degrees of freedom": (stored(lambda f: f.update(dof=f["dof"] + 40)), "its sum of squares is"),
    "held-out error": (stored(scaled("held_out_error_m", 0.1)), "its held-out error"),
    "hash": (stored(lambda f: f["account"]["files"][0].update(sha256="0" * 64)), "readings have changed since"),
    "no hash": (stored(lambda f: f["account"].update(files=[])), "it names no readings"),
    "linear": (stored(lambda f: f["options"].update(linear=True)), "readings give"),
    "unfitted value in the fit": (
        stored(lambda f: f["model_values"].update({"gravity_compensator[joint_2].stiffness": 3e5})),
        "stiffness was 300000 N/m when it was made and is 100000 N/m now",
    ),
    "nominal value": (
        text("rb/nominal.yaml", r"value_N/m: 1.0e5", "value_N/m: 3.0e5"),
        "stiffness was 100000 N/m when it was made and is 300000 N/m now",
    ),
    "convention": (
        text("rb/robot.yaml", "J3 . J2", "J3"),
        "joint angles .zero, sign, coupling. are described otherwise",
    ),
    "loop": (text("rb/robot.yaml", "lever_m: 0.75", "lever_m: 0.9"), "effects of the robot are described otherwise"),
    "an effect less": (
        text("rb/robot.yaml", r"  - \{effect: compensator_stiffness[^\n]*\n", ""),
        "effects of the robot are described otherwise|no effect has the parameter",
    ),
    "an effect more": (
        text("e.yaml", "noise:", "effects:\n  - {effect: load_scale}\nnoise:"),
        "effects of the experiment are described otherwise",
    ),
    "geometry": (
        text("rb/m900ib.urdf.xacro", r'xyz="\$\{d4\} 0 0"', 'xyz="${d4} 0.01 0"'),
        "geometry and masses are described otherwise",
    ),
    "marker": (text("e.yaml", r"xyz_mm: \[400,", "xyz_mm: [430,"), "markers are described otherwise"),
    "markers named otherwise": (text("e.yaml", r"  m1:", "  m9:"), "markers are described otherwise|m1|marker"),
    "load point": (text("e.yaml", r"point_mm: \[150,", "point_mm: [0,"), "load point and the load's uncertainty"),
    "load's uncertainty": (
        text("e.yaml", r"load: \{", "load_uncertainty: {scale_percent: 5}\nload: {"),
        "load point and the load's uncertainty",
    ),
    "noise": (text("e.yaml", "sigma_mm: 0.03", "sigma_mm: 3"), "its noise is 0.03 mm, and its readings have 3 mm"),
    "readings": (text("r.csv", r"(\np0?1,.*?,-?)(0\.\d)", r"\g<1>1\2"), "readings have changed since"),
    "fewer readings": (another_row, "readings have changed since"),
    "another robot": (other_name, "of another robot"),
    "an older format": (stored(lambda f: f.pop("account")), "key 'account' is missing"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_wrong_fit_is_refused_by_every_verb(sound: Path, kind: str, tmp_path: Path) -> None:
    folder = shutil.copytree(sound, tmp_path / "c")
    spoil, words = KINDS[kind]
    spoil(folder)
    for verb, arguments, out in verbs(folder):
        code, said = run(verb, *arguments)
        assert code != 0, verb
        assert re.search(words, said), (verb, said)
        assert not out.exists(), verb


def test_the_sound_one_is_used_by_every_verb_wherever_its_folder_stands(sound: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(sound, tmp_path / "moved")
    for verb, arguments, out in verbs(folder):
        code, said = run(verb, *arguments)
        if verb != "kinematics":  # nothing of geometry was identified
            assert code == 0, (verb, said)
            assert out.exists()
        assert "not to be trusted" not in said
        assert "used although" not in said


def test_readings_that_are_gone_are_said(sound: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(sound, tmp_path / "gone")
    with edited(folder / "fit.json") as fit:
        fit["account"]["files"][0]["path"] = "gone.csv"
    (folder / "r.csv").unlink()
    (folder / "e.yaml").write_text((folder / "e.yaml").read_text().replace("data: r.csv\n", ""))
    code, said = run("compensate", folder / "e.yaml", folder / "fit.json", folder / "t.csv", "-o", folder / "c.csv")
    assert code == 0, said
    assert "note: that the fit explains its readings was not checked: gone.csv is not here" in said


def test_a_comparison_asks_the_readings_where_the_experiment_is_beside_the_fit(sound: Path, tmp_path: Path) -> None:
    folder = shutil.copytree(sound, tmp_path / "c")
    robot, fit = load_robot(str(folder / "rb"), beside=folder), folder / "fit.json"
    assert not any("not checked" in note for note in with_fit(robot, read_fit(fit))[1])
    alone = shutil.copy(fit, tmp_path / "alone.json")
    assert "its experiment is not beside it. Put both into one folder" in " ".join(with_fit(robot, read_fit(alone))[1])
    stored(lambda f: both(f, {SECOND: 10.0 * f["model_values"][SECOND]}))(folder)
    with pytest.raises(InputError, match=r"joint_2. is .* readings give"):
        with_fit(robot, read_fit(fit))
    assert any("is used although" in note for note in with_fit(robot, read_fit(fit), anyway=True)[1])
