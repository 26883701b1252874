"""An effect named by `file:` runs only with trust, and then works as an installed one."""

from __future__ import annotations

import multiprocessing
import pickle
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from qsframework.cli.app import app, every_command, main
from qsframework.diagnoses import diagnose
from qsframework.errors import InputError
from qsframework.experiment import (
    example,
    load_experiment,
    make_plan,
    read_readings,
    simulate,
    write_readings,
)
from qsframework.experiment.plan import read_plan
from qsframework.fits import identify
from qsframework.plugin.trusted import trusted, trusting
from qsframework.report.extended import write_extended
from qsframework.report.words.diagnosis import diagnosis_words
from qsframework.robot import load_robot
from qsframework.robot.named_files import entry_effects

EFFECT = '''"""A pedestal that gives, and a mark that this file was run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from qsframework.plugin import Parameter, Spring, VirtualJoint, place

Path(__file__).with_name("was_run").write_text("yes")


@dataclass(frozen=True)
class SoftGround(Spring):
    """The pedestal turns about one base axis under the moment there."""

    axis: str = place()
    check = "The floor."

    @classmethod
    def places(cls, robot, markers=()):
        return tuple(cls(axis) for axis in "xyz")

    def parameters(self, robot):
        return (Parameter(self.name, "rad/(N m)", typical=2e-8, sd=2e-8, lower=0.0),)

    def virtual_joints(self, robot):
        return (VirtualJoint(robot.base, self.axis, "rotation"),)
'''
ENTRY = {"file": "soft_ground.py", "axis": "y"}
TRUE = 3e-8


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """An experiment that names an effect by its file, and a nominal value of it."""
    document = yaml.safe_load((example("m900ib") / "experiment.yaml").read_text())
    document |= {"effects": [ENTRY], "nominal": "campaign.yaml", "noise": {"sigma_mm": 0.01}}
    document["fit"] = ["joint_compliance", "soft_ground"]
    (tmp_path / "experiment.yaml").write_text(yaml.safe_dump(document))
    (tmp_path / "campaign.yaml").write_text("soft_ground[y]:\n  value_rad/(N m): 3.0e-8\n")
    (tmp_path / "soft_ground.py").write_text(EFFECT)
    shutil.copy(example("m900ib") / "table5.csv", tmp_path / "plan.csv")
    return tmp_path / "experiment.yaml"


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """A robot whose effect is a file."""
    folder = tmp_path / "robot"
    shutil.copytree(Path(__file__).parent / "small", folder)
    text = (folder / "robot.yaml").read_text()
    (folder / "robot.yaml").write_text(text.replace("effects:\n", f"effects:\n  - {ENTRY}\n"))
    (folder / "soft_ground.py").write_text(EFFECT)
    return folder


def was_run(file: Path) -> bool:
    return file.with_name("was_run").exists()


def test_without_trust_nothing_runs_and_the_user_is_told_how(campaign: Path, robot: Path) -> None:
    for load, file in ((load_experiment, campaign), (load_robot, robot / "robot.yaml")):
        with pytest.raises(InputError) as caught:
            load(file)
        (problem,) = caught.value.problems
        assert problem.file == str(file)
        assert problem.line is not None
        for words in ("soft_ground.py", "run as you", "trust=True", "nothing of it was run"):
            assert words in str(problem)
        assert not was_run(file)


def test_with_trust_it_is_an_effect_like_others(campaign: Path, robot: Path) -> None:
    experiment = load_experiment(campaign, trust=True)
    assert [e.name for e in experiment.effects] == ["soft_ground[y]"]
    assert experiment.parameters[0].nominal == TRUE
    assert "soft_ground[y]" in [e.name for e in load_robot(robot, trust=True).effects]
    assert was_run(campaign)
    with pytest.raises(InputError, match="trust=True"):
        load_experiment(campaign)  # trust is for one call


def test_it_is_simulated_and_identified(campaign: Path) -> None:
    experiment = load_experiment(campaign, trust=True)
    plan = read_plan(campaign.with_name("plan.csv"), experiment)
    fitted = experiment.with_(fit=("soft_ground", "joint_compliance[joint_2]", "joint_compliance[joint_3]"))
    readings = simulate(fitted, plan, seed=1).readings
    without = simulate(fitted.with_(effects=(), parameters=(), fit=None), plan, seed=1).readings
    assert np.abs(readings.value - without.value).max() > 1e-4
    found = {e.name: e for e in identify(fitted, readings).estimates}["soft_ground[y]"]
    assert abs(found.value - TRUE) < 4.0 * found.sd
    assert found.sd < 0.2 * TRUE


def test_trust_lasts_as_long_as_its_context() -> None:
    assert not trusted(None)
    with trusting():
        assert trusted(None)
        assert not trusted(False)
    assert not trusted(None)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"file": "../soft_ground.py"}, "outside the folder"),
        ({"file": "/etc/passwd.py"}, "outside the folder"),
        ({"file": "linked.py"}, "outside the folder"),
        ({"file": "none.py"}, "does not exist"),
        ({"file": "."}, "must name a Python file"),
        ({"file": 3}, "must name a Python file"),
        ({"file": None}, "must name a Python file"),
        ({"file": "a\0.py"}, "a control character"),
        ({"file": "x" * 300 + ".py"}, "must name a Python file"),
        ({"file": "folder.py"}, "does not exist"),
        ({"file": "soft_ground.py", "effect": "hard_ground"}, "holds no effect 'hard_ground'"),
        ({"file": "soft_ground.py", "effect": 3}, "must be the name"),
        ({"file": "soft_ground.py", "axs": "y"}, "unknown key"),
        ({"file": "empty.py"}, "holds no effect"),
        ({"file": "two.py"}, "say which by `effect:`"),
        ({"file": "taken.py"}, "name of an installed one"),
        ({"file": "plain.py"}, "is no @dataclass"),
        ({"file": "broken.py"}, "line 2: cannot be run: SyntaxError"),
        ({"file": "fails.py"}, "line 3: cannot be run: ZeroDivisionError"),
        ({"file": "leaves.py"}, "cannot be run: SystemExit"),
        ({"file": "binary.py"}, "not UTF-8"),
        ({"file": "nul.py"}, "cannot be run"),
    ],
)
def test_wrong_files_are_refused_in_words(campaign: Path, entry: dict[str, object], words: str) -> None:
    folder = campaign.parent / "inner"
    folder.mkdir()
    head = EFFECT.partition("@dataclass")[0]
    body = "@dataclass" + EFFECT.partition("@dataclass")[2]
    for name, text in {
        "empty.py": "x = 1\n",
        "two.py": EFFECT + body.replace("SoftGround", "Other"),
        "soft_ground.py": EFFECT,
        "taken.py": head + body.replace("SoftGround", "BaseCompliance"),
        "plain.py": head + body.partition("\n")[2],
        "broken.py": "x = 1\ndef (\n",
        "fails.py": "x = 1\n\n1 / 0\n",
        "leaves.py": "raise SystemExit(0)\n",
        "nul.py": "x = 1\0\n",
    }.items():
        (folder / name).write_text(text)
    (folder / "binary.py").write_bytes(b"\xff\xfe\x00")
    (folder / "folder.py").mkdir()
    (folder / "linked.py").symlink_to(campaign.with_name("soft_ground.py"))
    document = yaml.safe_load(campaign.read_text()) | {"effects": [entry]}
    (folder / "experiment.yaml").write_text(yaml.safe_dump(document))
    (folder / "campaign.yaml").write_text("soft_ground[y]:\n  value_rad/(N m): 3.0e-8\n")
    with pytest.raises(InputError) as caught:
        load_experiment(folder / "experiment.yaml", trust=True)
    assert any(words in str(p) for p in caught.value.problems), str(caught.value)


def in_another_process(content: bytes) -> tuple[str, float]:
    effect = pickle.loads(content)
    return effect.name, effect.order


def test_another_process_makes_the_same_effect(campaign: Path) -> None:
    (effect,) = load_experiment(campaign, trust=True).effects
    assert pickle.loads(pickle.dumps(effect)) == effect
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.apply(in_another_process, (pickle.dumps(effect),)) == (effect.name, effect.order)


COMMANDS = {
    "check": ["check", "E"],
    "check a robot": ["check", "R/robot.yaml"],
    "stiffness": ["stiffness", "R", "--pose", "10,20", "--load", "0,0,-10"],
    "show": ["show", "E", "--html", "O/show.html"],
    "show a robot": ["show", "R", "--html", "O/show.html"],
    "simulate": ["simulate", "E", "plan.csv", "-o", "O/readings.csv"],
    "export": ["export", "E", "plan.csv", "--to", "csv", "-o", "O/p.csv"],
    "protocol": ["protocol", "E", "plan.csv", "-o", "O/s.html", "--readings", "O/r.csv"],
    "diagnose": ["diagnose", "E", "plan.csv"],
    "design": ["design", "E", "-n", "6", "--candidates", "60", "--efficiency", "0.9", "-o", "O/plan.csv"],
    "compensate": ["compensate", "E", "fit.json", "plan.csv"],
    "kinematics": ["kinematics", "E", "fit.json", "--dh", "O/dh.yaml"],
    "identify": ["identify", "E", "none.csv"],
    "validate": ["validate", "E", "fit.json", "none.csv"],
}
LET_IN = {
    "compensate": "fit.json",
    "kinematics": "fit.json",
    "identify": "none.csv",
    "validate": "fit.json",
    "export": "transmission angle",
}
"""Commands that are tried up to what they say of their next input."""


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_asks_for_trust(
    name: str, campaign: Path, robot: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(campaign.parent)
    words = [w.replace("O/", "out/") if w != "E" else str(campaign) for w in COMMANDS[name]]
    words = [str(robot) + w[1:] if w in ("R", "R/robot.yaml") else w for w in words]
    file = robot / "robot.yaml" if any(str(robot) in w for w in words) else campaign

    def run(*more: str) -> tuple[int, str]:
        monkeypatch.setattr("sys.argv", ["qsf", *words, *more])
        with pytest.raises(SystemExit) as caught:
            main()
        said = capsys.readouterr()
        code = caught.value.code
        return (code if isinstance(code, int) else 0), said.err + said.out

    code, told = run()
    assert code == 2
    assert "--trust" in told
    assert not was_run(file)
    code, told = run("--trust")
    assert was_run(file)
    assert (code, LET_IN[name] in told) == (2, True) if name in LET_IN else code == 0, told
    assert not trusted(None)


def test_every_command_that_loads_files_has_the_option() -> None:
    runner = CliRunner()
    without = {name for name, c in every_command().items() if not any("--trust" in p.opts for p in c.params)}
    # they read installed files only, write a robot without effects, or read nothing
    assert without == {"demo", "new"}
    assert runner.invoke(app, ["check", "--help"]).exit_code == 0


def test_it_is_diagnosed_and_extended(campaign: Path, tmp_path: Path) -> None:
    """Listed at x, where it does nothing, it is found at y, where it was hidden; the extension takes the file along."""
    document = yaml.safe_load((example("hidden_effect") / "experiment.yaml").read_text())
    document |= {"effects": [ENTRY | {"axis": "x"}], "fit": ["joint_compliance"], "data": "readings.csv"}
    campaign.write_text(yaml.safe_dump(document))
    experiment = load_experiment(campaign, trust=True)
    measured = read_readings(example("hidden_effect") / "readings.csv", experiment)
    loaded = measured.poses.take(np.flatnonzero(measured.states.loaded)[:12])
    plan = make_plan(loaded, [""] * len(loaded))
    (hidden,) = entry_effects(ENTRY, campaign.parent, experiment.robot.facts, trust=True)
    (parameter,) = hidden.parameters(experiment.robot.facts)
    true = experiment.with_(
        effects=(*experiment.effects, hidden), parameters=(*experiment.parameters, replace(parameter, nominal=1.5e-7))
    )
    write_readings(campaign.with_name("readings.csv"), simulate(true, plan, seed=2).readings, experiment)
    found = diagnose(experiment, read_readings(campaign.with_name("readings.csv"), experiment), seed=2)
    named = {name for f in found.findings for name in (f.name, *(r.name for r in f.alternatives))}
    assert "soft_ground[y]" in named, diagnosis_words(found)
    write_extended(found, tmp_path / "extended")
    assert (tmp_path / "extended" / "robot" / "effects" / "soft_ground.py").read_text() == EFFECT
    with pytest.raises(InputError, match="trust=True"):
        load_experiment(tmp_path / "extended" / "experiment.yaml")
    names = load_experiment(tmp_path / "extended" / "experiment.yaml", trust=True).model().names
    assert {"soft_ground[x]", found.findings[0].name} <= set(names)
