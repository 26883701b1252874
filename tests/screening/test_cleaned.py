"""What --clean masks stands in fit.json and in the report, for displacements, positions and both in one fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from qsframework.cli.identify import FitFiles, run_identify
from qsframework.estimation import FitOptions
from qsframework.experiment import Readings, load_experiment, make_plan, simulate, write_readings
from qsframework.fits import FitRecord, identify, read_fit
from qsframework.plugin import Poses
from tests.identify.arm import arm_text, copied, position_readings, spoilt, wrong_in

ARM = arm_text("0.03", "fit: [joint_compliance]\n")
APART = ARM.replace("{sigma_mm: 0.03}", "{displacement_sigma_mm: 0.03, position_sigma_mm: 0.03}")
COUNT = 12


class Campaign:
    """One arm; readings of it with a zero and a copied row, positions with a marker that was knocked."""

    def __init__(self, folder: Path) -> None:
        self.file, self.apart = folder / "experiment.yaml", folder / "apart.yaml"
        self.file.write_text(ARM)
        self.apart.write_text(APART)
        self.arm = load_experiment(self.file)
        controller = self.arm.robot.controller
        pendant = np.random.default_rng(3).uniform(controller.lower, controller.upper, (COUNT, 6)) * 0.6
        wrench = np.tile([0.0, 2000.0, -4000.0, 0.0, 0.0, 0.0], (COUNT, 1))
        self.poses = Poses(pendant, controller.to_joints(pendant), wrench)
        self.clean = simulate(self.arm, make_plan(self.poses, ["pull"] * COUNT), seed=1).readings

    def displacements(self) -> Readings:
        return copied(spoilt(self.clean, [5], -self.clean.value[5]), [20], [10])

    def positions(self) -> Readings:
        seen = self.arm.model().positions(self.poses, loaded=True)
        seen = seen + 3e-5 * np.random.default_rng(2).standard_normal(seen.shape)
        along = seen[5, 1] - seen[5, 0]
        seen[5, 1] += 0.002 * along / np.linalg.norm(along)
        names = [f"p{i}" for i in range(COUNT)]
        return position_readings(self.poses, np.ones(COUNT, dtype=bool), seen, 3e-5, pose=names)


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    return Campaign(tmp_path_factory.mktemp("arm"))


def run(experiment: Path, folder: Path, *data: str, clean: bool = True) -> tuple[FitRecord, str]:
    """The stored fit and the report's text."""
    files = FitFiles(
        experiment=experiment,
        data=tuple(folder / d for d in data),
        json=folder / "fit.json",
        report=folder / "fit.html",
    )
    run_identify(files, None, FitOptions(), clean)
    return read_fit(folder / "fit.json"), (folder / "fit.html").read_text()


def test_what_was_masked_of_displacements_is_in_the_files(
    campaign: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_readings(tmp_path / "r.csv", campaign.displacements(), campaign.arm)
    stored, page = run(campaign.file, tmp_path, "r.csv")
    assert stored.cleaned is not None
    assert {(m.kind, m.rows, m.readings) for m in stored.cleaned} == {
        ("unread", (8,), "displacements"),
        ("repeated_readings", (23,), "displacements"),
    }
    assert stored.masked_rows == (8, 23)
    said = capsys.readouterr().out.replace("\n", " ")
    for one in stored.cleaned:
        assert one.words in said
        assert one.words in page
    assert "These rows were masked before the fit and are not used" in page
    stored, page = run(campaign.file, tmp_path, "r.csv", clean=False)
    assert stored.cleaned is None
    assert "These rows were masked before the fit" not in page


def test_what_was_masked_of_positions_is_in_the_files(campaign: Campaign, tmp_path: Path) -> None:
    write_readings(tmp_path / "s.csv", campaign.positions(), campaign.arm)
    stored, page = run(campaign.file, tmp_path, "s.csv")
    assert stored.cleaned is not None
    assert [(m.kind, m.rows, m.readings) for m in stored.cleaned] == [("tool", (19,), "positions")]
    assert stored.masked_rows == (19,)
    assert stored.cleaned[0].words in page
    stored, page = run(campaign.file, tmp_path, "s.csv", clean=False)
    assert stored.cleaned is None
    assert stored.masked_rows == (19,)  # the fit finds the same row
    assert "row 19 (pose p5)" in page


def test_both_kinds_in_one_fit_say_whose_rows_they_are(campaign: Campaign, tmp_path: Path) -> None:
    write_readings(tmp_path / "r.csv", campaign.displacements(), campaign.arm)
    write_readings(tmp_path / "s.csv", campaign.positions(), campaign.arm)
    stored, _ = run(campaign.apart, tmp_path, "r.csv", "s.csv")
    assert stored.cleaned is not None
    assert {(m.readings, *m.rows) for m in stored.cleaned} == {
        ("displacements", 8),
        ("displacements", 23),
        ("positions", 19),
    }


def test_readings_with_nothing_wrong_are_said_to_be_so(
    campaign: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not wrong_in(campaign.arm, campaign.clean)
    assert wrong_in(campaign.arm, campaign.positions())
    write_readings(tmp_path / "r.csv", campaign.clean, campaign.arm)
    stored, page = run(campaign.file, tmp_path, "r.csv")
    assert "the readings were looked through: no row is masked" in capsys.readouterr().out
    assert stored.cleaned == ()
    assert "none is masked" in page
    assert identify(campaign.arm, campaign.clean).as_json()["cleaned"] is None
