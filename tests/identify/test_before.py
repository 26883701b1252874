"""What *before* means: the values before any of these readings was used, across folders of extensions and nominals."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from qsframework.cli.main import app
from qsframework.errors import InputError
from qsframework.experiment import load_experiment, read_readings
from qsframework.experiment.observations import values_before
from qsframework.plugin import Parameter

HIDDEN = Path(__file__).resolve().parents[2] / "examples" / "hidden_effect"


def run(*arguments: object) -> str:
    result = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_the_oldest_value_that_no_reading_at_hand_has_changed() -> None:
    p = Parameter("c", "m", nominal=3.0, earlier=((1.0, ("a",)), (2.0, ("b", "c"))))
    assert [p.before([used]) for used in ("a", "b", "d")] == [1.0, 2.0, 3.0]
    assert p.before(["c", "a"]) == 1.0
    assert p.before([]) == 3.0
    assert p.identified_by(["d"]).earlier == (*p.earlier, (3.0, ("d",)))
    assert p.identified_by(["b"]) is p, "again by the same readings: what stood before them stays"
    assert p.identified_by([]) is p


def test_the_documented_way_ends_in_a_certificate_with_the_gain_of_all_steps(tmp_path: Path) -> None:
    """Diagnosis, extension, fit, nominal values, fit again: each step says what was before the readings."""
    given = shutil.copytree(HIDDEN, tmp_path / "given")
    extended, nominal = tmp_path / "ext" / "experiment.yaml", tmp_path / "nominal.yaml"
    run("diagnose", given / "experiment.yaml", "--extend", tmp_path / "ext")
    said = run("identify", extended, "--json", tmp_path / "fit.json", "--nominal", nominal)
    own = run("identify", given / "experiment.yaml", "--json", tmp_path / "own.json")
    before = [re.search(r"[\d.]+(?= → )", text) for text in (said, own)]
    assert before[0] is not None
    assert before[1] is not None
    assert before[0][0] == before[1][0], "before is the arm as it was before these readings, extended or not"
    shutil.copy(nominal, tmp_path / "ext" / "robot" / "nominal.yaml")
    again = run("identify", extended, "--json", tmp_path / "again.json")
    assert before[0][0] in again.splitlines()[0]
    run("certificate", extended, tmp_path / "again.json", "--halves", 3, "-o", tmp_path / "c.html")
    assert "before" in (tmp_path / "c.html").read_text(encoding="utf-8")
    experiment = load_experiment(extended)
    readings = read_readings(given / "readings.csv", experiment)
    first = load_experiment(given / "experiment.yaml").model()
    found = dict(zip(experiment.model().names, values_before(experiment.model(), readings), strict=True))
    for name, value in zip(first.names, first.nominal, strict=True):
        np.testing.assert_allclose(found[name], value, rtol=1e-12)
    assert all(found[n] == 0.0 for n in found.keys() - {*first.names})


def test_a_stage_that_says_nothing_is_refused(tmp_path: Path) -> None:
    given = shutil.copytree(HIDDEN, tmp_path / "given")
    with (given / "experiment.yaml").open("a", encoding="utf-8") as file:
        file.write("nominal: n.yaml\n")
    (given / "n.yaml").write_text("joint_compliance[joint_1]: {value_rad/(N m): 1e-7, earlier: [{value_m: 1}]}\n")
    with pytest.raises(InputError, match=re.escape("earlier is a list of value_rad/(N m) and readings")):
        load_experiment(given / "experiment.yaml")
