"""What fuzzing whole commands found, each mended at its cause: see docs/results.md."""

from __future__ import annotations

import json
import re
from pathlib import Path

import command_lines
import pytest


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return command_lines.prepared(tmp_path_factory.mktemp("bench"))


REFUSED = {
    "simulate experiment.yaml '' -o x.csv": "error: the argument after experiment.yaml: the value is empty",
    "design experiment.yaml -n 4 '' --no-polish": "error: the argument after -n 4: the value is empty",
    "identify experiment.yaml readings.csv --fixed J --tied J,joint_compliance[shoulder]": "tied twice: J",
    "validate experiment.yaml fit.json --halves 2147483648": "--halves",
    "design experiment.yaml -n 100000000000000000000": "--poses",
    f"check experiment.yaml --json {'x' * 300}": "File name too long",
    "stiffness small --pose 0,500 --load 0,0,-100": "--pose",
    "show experiment.yaml fit.json gone.csv --html x.html": "gone.csv: no such file",
    "show small --html x.html --pose 0,500": "--pose",
    "certificate experiment.yaml fit.json --template experiment.yaml": "experiment.yaml would overwrite an input",
    "import experiment.yaml BLANK log.csv --plan plan.csv --unit mm": "error: ' ': no such file",
    "new arm --urdf small/small.urdf --payload 5e-324": "--payload",
    "compensate experiment.yaml fit.json a.csv b.csv -o x.csv": "compensate EXPERIMENT fit.json TARGETS",
}


@pytest.mark.parametrize("line", REFUSED)
def test_it_is_refused_in_words(bench: Path, line: str) -> None:
    named = {"''": "", "BLANK": " "}
    words = tuple(named.get(word, word) for word in line.replace("J", "joint_compliance[elbow]").split())
    code, _, error = command_lines.run(bench, words)
    assert code == 2, error
    assert REFUSED[line].replace("J", "joint_compliance[elbow]") in " ".join(error.split()), error


def test_a_pause_of_any_length_is_exported(bench: Path) -> None:
    """Controllers are told hundredths of a second; others were "not what the plan says"."""
    line = "export ur10.yaml ur10_plan.csv --to urscript -o x.script --pause 26.399275353049788"
    code, _, error = command_lines.run(bench, tuple(line.split()))
    assert code == 0, error
    assert "sleep(26.40)" in (bench / "x.script").read_text()


def test_an_arm_that_does_not_give_has_no_shares(bench: Path) -> None:
    """A division by zero before: the compliances of its springs are zero."""
    zero = "joint_compliance[{}]:\n  value_urad/(N m): 0\n  sd_urad/(N m): 0.1\n"
    (bench / "small2" / "nominal.yaml").write_text(zero.format("shoulder") + zero.format("elbow"))
    code, said, error = command_lines.run(bench, ("stiffness", "small2", "--pose", "10,-20", "--load", "0,0,-100"))
    assert code == 0, error
    assert "0.0000 mm" in said


def test_a_urdf_with_strange_tags_is_written_again(bench: Path) -> None:
    """A tag with a prefix that nobody explains is passed over when it is read, and was a traceback when written."""
    file = bench / "small" / "small.urdf"
    text = file.read_text()
    file.write_text(text.replace("</robot>", '<xacro:include filename="a"/></robot>'))
    code, _, error = command_lines.run(bench, ("kinematics", "experiment.yaml", "fit.json", "--urdf", "out.urdf"))
    file.write_text(text)
    assert code == 0, error
    assert "xacro" not in (bench / "out.urdf").read_text()


def test_a_chain_whose_link_is_gone_makes_no_robot(bench: Path) -> None:
    file = bench / "gone.urdf"
    text = (bench / "small" / "small.urdf").read_text()
    last = re.findall(r'<link name="(\w+)"', text)[-1]
    file.write_text(text.replace(f'<link name="{last}"', '<link name="other"'))
    code, _, error = command_lines.run(bench, ("new", "gone", "--urdf", "gone.urdf", "--base", "base"))
    assert code == 2, error
    assert "gone.urdf" in error


def test_a_fit_that_no_arm_has_is_refused_with_its_name(bench: Path) -> None:
    fit = json.loads((bench / "fit.json").read_text())
    fit["model_values"]["joint_compliance[elbow]"] = 1e17
    (bench / "far.json").write_text(json.dumps(fit))
    code, _, error = command_lines.run(bench, ("validate", "experiment.yaml", "far.json", "readings.csv"))
    assert code == 2
    assert "far.json: joint_compliance[elbow]; found 1e+17 rad/(N m); allowed: " in " ".join(error.split())
