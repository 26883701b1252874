"""From a diagnosis to a certificate: each step says by what the model was extended and what that gains; what has come
apart meanwhile is said, with what to do."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from remembered import diagnose
from typer.testing import CliRunner

from qsf_day.run import certificate_of
from qsframework.cli.app import app
from qsframework.errors import InputError
from qsframework.experiment import load_experiment, read_readings

pytestmark = pytest.mark.usefixtures("diagnosed_once")

ROOT = Path(__file__).resolve().parents[2]
ADDED = {
    "hidden_effect": "joint_hardening[joint_3]",
    "unknown_effect": "learned[j5/j4]",
    "mixed": "base_compliance[ry]",
}
TARGETS = "target,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,fx_N,fy_N,fz_N\nt1,10,20,-10,30,40,0,0,0,-1000\n"


def run(*arguments: object) -> str:
    done = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False, env={"COLUMNS": "1000"})
    assert done.exit_code == 0, done.output
    return " ".join(done.output.split())


def refused(*arguments: object) -> str:
    done = CliRunner().invoke(app, [str(a) for a in arguments])
    assert isinstance(done.exception, InputError), done.output
    return str(done.exception)


def chain(folder: Path, name: str) -> dict[str, str]:
    """What every step says, from the readings of an example to the certificate."""
    given = shutil.copytree(ROOT / "examples" / name, folder / "given") / "experiment.yaml"
    extended, fit, targets = folder / "ext" / "experiment.yaml", folder / "f.json", folder / "t.csv"
    targets.write_text(TARGETS)
    return {
        "diagnose": run("diagnose", given, "--extend", folder / "ext"),
        "identify": run("identify", extended, "--json", fit),
        "validate": run("validate", extended, fit, "--halves", 2),
        "compensate": run("compensate", extended, fit, targets, "-o", folder / "c.csv"),
        "certificate": run("certificate", extended, fit, "--halves", 2, "-o", folder / "c.html"),
    }


Chains = Callable[[str], tuple[Path, dict[str, str]]]


@pytest.fixture(scope="module")
def chains(tmp_path_factory: pytest.TempPathFactory) -> Chains:
    """The folder of an example's chain and what its steps said, made once."""

    @cache
    def made(name: str) -> tuple[Path, dict[str, str]]:
        folder = tmp_path_factory.mktemp(name)
        return folder, chain(folder, name)

    return made


@pytest.mark.parametrize("name", ADDED)
def test_from_a_diagnosis_to_a_certificate(name: str, chains: Chains) -> None:
    folder, said = chains(name)
    first = re.search(r"The model is extended by (.*?): held-out error ([\d.]+) → ([\d.]+) mm", said["diagnose"])
    assert first is not None
    assert first[1] == ADDED[name], "what is fitted besides was there before"
    assert float(first[3]) < 0.8 * float(first[2])
    for step in ("identify", "validate", "compensate", "certificate"):
        assert f"extended by what a diagnosis of readings found: {ADDED[name]}" in said[step], step
    assert re.search(r"[\d.]+ → [\d.]+ mm", said["identify"]), "the gain of all, before and after"
    assert ADDED[name] in (folder / "c.html").read_text(encoding="utf-8")
    if name == "mixed":
        return  # its own fit is refused as that of the hidden effect
    own = folder / "own.json"
    run("identify", folder / "given" / "experiment.yaml", "--json", own)
    arguments = ("certificate", folder / "given" / "experiment.yaml", own, "--halves", 2, "-o", folder / "own.html")
    if name == "unknown_effect":  # a law that was learned is no cause by name
        assert "with an empirical correction, the held-out error (3D RMS) is 0.054 mm instead of 0.088 mm" in run(
            *arguments
        )
        return
    words = refused(*arguments)
    assert f"the readings name what the fit does not have, {ADDED[name]}" in words
    assert f"Let `qsf diagnose {folder / 'given' / 'experiment.yaml'}` write the extended robot" in words
    assert not (folder / "own.html").exists()


@pytest.fixture
def hidden(chains: Chains) -> Path:
    """An extended robot with its fit, and the readings that both are from."""
    return chains("hidden_effect")[0]


def test_what_has_come_apart_is_said_with_what_to_do(hidden: Path, tmp_path: Path) -> None:
    """An extended folder away from its base, readings that are gone, a robot edited since."""
    away = shutil.copytree(hidden / "ext", tmp_path / "elsewhere" / "ext")
    words = refused("identify", away / "experiment.yaml")
    assert "../given/readings.csv: no such file" in words
    assert f"`data:` of {away / 'experiment.yaml'} names it: change it there if the folder was moved, or give" in words
    told = run("compensate", away / "experiment.yaml", hidden / "f.json", hidden / "t.csv", "-o", tmp_path / "c.csv")
    assert "that the fit explains its readings was not checked: ../given/readings.csv is not here" in told
    assert "put it beside the experiment" in told
    shutil.copy(hidden / "given" / "readings.csv", away)
    told = run("compensate", away / "experiment.yaml", hidden / "f.json", hidden / "t.csv", "-o", tmp_path / "c.csv")
    assert "was not checked" not in told
    text = (away / "robot" / "robot.yaml").read_text()
    (away / "robot" / "robot.yaml").write_text(text.replace("lever_m: 0.75", "lever_m: 0.7"))
    words = refused(
        "compensate", away / "experiment.yaml", hidden / "f.json", hidden / "t.csv", "-o", tmp_path / "c.csv"
    )
    assert "the effects of the robot are described otherwise now than when it was made" in words
    assert "Identify again" in words


def test_the_fit_of_the_base_is_not_one_of_the_extension(hidden: Path, tmp_path: Path) -> None:
    """Two accounts that disagree."""
    own = tmp_path / "own.json"
    run("identify", hidden / "given" / "experiment.yaml", "--json", own)
    words = refused("certificate", hidden / "ext" / "experiment.yaml", own, "-o", tmp_path / "c.html")
    assert "the effects of the robot are described otherwise now" in words


def test_the_end_of_the_day_certifies_the_extended_fit_or_says_why_not(tmp_path: Path) -> None:
    experiment = load_experiment(ROOT / "examples" / "hidden_effect" / "experiment.yaml")
    readings = read_readings(experiment.data, experiment)
    found = diagnose(experiment, readings, repeats=1)
    extended, certified = certificate_of(experiment, readings, found, tmp_path)
    assert extended.startswith("extended/: The model is extended by joint_hardening[joint_3]: ")
    assert certified.startswith("certificate.html: ")
    assert "joint_hardening[joint_3]" in (tmp_path / "certificate.html").read_text(encoding="utf-8")
    (tmp_path / "extended" / "mine.txt").write_text("")
    with pytest.raises(InputError, match="holds other files"):
        certificate_of(experiment, readings, found, tmp_path)
