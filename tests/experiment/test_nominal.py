"""A campaign's own effects may have their values in a file."""

from __future__ import annotations

from pathlib import Path

import pytest

from qsframework.errors import InputError
from qsframework.experiment import example, load_experiment

SPEC = (example("r2000ic") / "experiment.yaml").read_text().replace("data: readings.csv\n", "")


def campaign(folder: Path, nominal: str) -> Path:
    path = folder / "experiment.yaml"
    path.write_text(SPEC + "effects:\n  - {effect: load_scale}\nnominal: campaign.yaml\n")
    (folder / "campaign.yaml").write_text(nominal)
    return path


def test_values_sds_and_sources_are_read(tmp_path: Path) -> None:
    path = campaign(
        tmp_path, "load_scale:\n  value_percent: 1.5\n  sd_percent: 10\n  source: the scale's certificate\n"
    )
    experiment = load_experiment(path)
    (p,) = experiment.parameters
    assert (p.nominal, p.source) == (pytest.approx(0.015), "the scale's certificate")
    assert p.sd == pytest.approx(0.0015)
    model = experiment.model()
    assert model.nominal[model.index(["load_scale"])[0]] == p.nominal


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("load_scal: {value: 0}\n", "no effect has the parameter 'load_scal'"),
        ("joint_compliance[joint_9]: {value_rad/(N m): 1.0e-7}\n", "no effect has the parameter"),
        ("joint_compliance[joint_1]: {value_rad/(N m): -1.0e-7}\n", "outside its bounds"),
        ("load_scale: {value: -2}\n", "outside its bounds"),
    ],
)
def test_problems_have_file_and_line(text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words) as caught:
        load_experiment(campaign(tmp_path, "# a comment\n" + text))
    (problem,) = caught.value.problems
    assert problem.file == str(tmp_path / "campaign.yaml")
    assert problem.line == 2


def test_values_of_the_robot_stand_in_place_of_its_own(tmp_path: Path) -> None:
    path = campaign(tmp_path, "joint_compliance[joint_2]: {value_urad/(N m): 0.7}\n")
    experiment, plain = load_experiment(path), load_experiment(example("r2000ic") / "experiment.yaml")
    here, there = experiment.model(), plain.model()
    at = here.index(["joint_compliance[joint_2]"])[0]
    assert here.nominal[at] == pytest.approx(7e-7)
    assert there.nominal[there.index(["joint_compliance[joint_2]"])[0]] != pytest.approx(7e-7)
    others = [n for n in there.names if n != "joint_compliance[joint_2]"]
    assert list(here.nominal[here.index(others)]) == list(there.nominal[there.index(others)])


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    path = campaign(tmp_path, "")
    (tmp_path / "campaign.yaml").unlink()
    with pytest.raises(InputError, match=r"campaign\.yaml: no such file|no such file"):
        load_experiment(path)
