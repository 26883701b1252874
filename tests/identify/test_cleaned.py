"""What --clean masks stands in fit.json and in the report, for displacements, positions and both in one fit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qsframework.cli.identify import FitFiles, How, run_identify
from qsframework.experiment import (
    Readings,
    StateReadings,
    load_experiment,
    make_plan,
    simulate,
    write_readings,
    write_states,
)
from qsframework.identify import check_positions, check_readings, identify, read_fit
from qsframework.plugin import Poses
from tests.identify.arm import arm_text

ARM = arm_text("0.03")
COUNT = 12


class Campaign:
    """One arm; readings of it with a zero and a copied row, positions with a marker that was knocked."""

    def __init__(self, folder: Path) -> None:
        self.file = folder / "experiment.yaml"
        self.file.write_text(ARM)
        self.arm = load_experiment(self.file)
        controller = self.arm.robot.controller
        pendant = np.random.default_rng(3).uniform(controller.lower, controller.upper, (COUNT, 6)) * 0.6
        wrench = np.tile([0.0, 2000.0, -4000.0, 0.0, 0.0, 0.0], (COUNT, 1))
        self.poses = Poses(pendant, controller.to_joints(pendant), wrench)
        self.clean = simulate(self.arm, make_plan(self.poses, ["pull"] * COUNT), seed=1).readings

    def displacements(self) -> Readings:
        d = np.array(self.clean.displacement)
        d[5], d[20] = 0.0, d[10]
        return replace(self.clean, displacement=d)

    def positions(self) -> StateReadings:
        model = self.arm.model()
        seen = model.positions(self.poses, model.nominal, True).reshape(-1, 3)
        seen = seen + 3e-5 * np.random.default_rng(2).standard_normal(seen.shape)
        seen[16] += 0.002 * (seen[16] - seen[15]) / np.linalg.norm(seen[16] - seen[15])
        ones, K = np.ones(COUNT, dtype=np.intp), 3
        return StateReadings(
            self.poses, np.ones(COUNT, dtype=bool), tuple(f"p{i}" for i in range(COUNT)), ("",) * COUNT, ("",) * COUNT,
            ones, ones, np.repeat(np.arange(COUNT), K), np.tile(np.arange(K), COUNT), seen,
            np.full(K * COUNT, np.nan), np.ones(K * COUNT, dtype=bool), np.arange(2, 2 + K * COUNT), None, None,
        )  # fmt: skip


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    return Campaign(tmp_path_factory.mktemp("arm"))


def test_what_was_masked_of_displacements_is_in_the_files(
    campaign: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = tmp_path / "r.csv"
    write_readings(data, campaign.displacements(), campaign.arm)
    files = FitFiles(campaign.file, data, tmp_path / "fit.json", tmp_path / "fit.html")
    run_identify(files, How(clean=True))
    stored = read_fit(tmp_path / "fit.json")
    assert stored.cleaned is not None
    assert {(m.kind, m.rows, m.readings) for m in stored.cleaned} == {
        ("zero", (8,), "displacements"), ("duplicate", (23,), "displacements")}  # fmt: skip
    assert stored.masked_rows == (8, 23)
    page = (tmp_path / "fit.html").read_text()
    said = capsys.readouterr().out.replace("\n", " ")
    for one in stored.cleaned:
        assert one.words in said
        assert one.words in page
    assert "masked before the fit (--clean)" in page
    run_identify(files, How())
    stored = read_fit(tmp_path / "fit.json")
    assert (stored.cleaned, stored.masked_rows) == (None, ())
    assert "masked before the fit" not in (tmp_path / "fit.html").read_text()


def test_what_was_masked_of_positions_is_in_the_files(campaign: Campaign, tmp_path: Path) -> None:
    data = tmp_path / "s.csv"
    write_states(data, campaign.positions(), campaign.arm)
    files = FitFiles(campaign.file, data, tmp_path / "fit.json", tmp_path / "fit.html")
    run_identify(files, How(clean=True))
    with_clean, page = read_fit(tmp_path / "fit.json"), (tmp_path / "fit.html").read_text()
    assert with_clean.cleaned is not None
    assert [(m.kind, m.rows) for m in with_clean.cleaned] == [("tool", (19,))]
    assert with_clean.masked_rows == (19,)
    assert with_clean.cleaned[0].words in page
    assert "Gross errors that the fit itself found, masked and not used: rows none." in page
    run_identify(files, How())
    without, page = read_fit(tmp_path / "fit.json"), (tmp_path / "fit.html").read_text()
    assert without.cleaned is None
    assert without.masked_rows == (19,)  # the fit finds the same row
    assert "Gross errors that the fit itself found, masked and not used: rows 19." in page


def test_both_kinds_in_one_fit_say_whose_rows_they_are(campaign: Campaign, tmp_path: Path) -> None:
    write_readings(tmp_path / "r.csv", campaign.displacements(), campaign.arm)
    write_states(tmp_path / "s.csv", campaign.positions(), campaign.arm)
    files = FitFiles(campaign.file, tmp_path / "r.csv", tmp_path / "fit.json", positions=tmp_path / "s.csv")
    run_identify(files, How(clean=True))
    stored = read_fit(tmp_path / "fit.json")
    assert stored.cleaned is not None
    assert {(m.readings, *m.rows) for m in stored.cleaned} == {
        ("displacements", 8), ("displacements", 23), ("positions", 19)}  # fmt: skip
    assert stored.masked_rows == (19,)


def test_readings_with_nothing_wrong_are_said_to_be_so(
    campaign: Campaign, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert not check_readings(campaign.arm, campaign.clean)
    assert check_positions(campaign.arm, campaign.positions())
    write_readings(tmp_path / "r.csv", campaign.clean, campaign.arm)
    files = FitFiles(campaign.file, tmp_path / "r.csv", tmp_path / "fit.json", tmp_path / "fit.html")
    run_identify(files, How(clean=True))
    assert "the displacements were looked through: no row is masked" in capsys.readouterr().out
    assert read_fit(tmp_path / "fit.json").cleaned == ()
    assert "none is masked" in (tmp_path / "fit.html").read_text()
    assert identify(campaign.arm, campaign.clean).as_json()["masked"] is None
