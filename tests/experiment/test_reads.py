"""Reads without moving share the error of their visit: ten of them say as much as their mean, and no more."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import qsframework as qsf
from qsframework.errors import InputError
from qsframework.experiment import Experiment, load_experiment, read_readings
from qsframework.experiment.readings_table import readings_table

EXAMPLE = Path(__file__).parents[2] / "examples" / "hidden_effect"
READS = 10
SIGMA, SHARED = 0.03, 0.06
"""mm: of a read, and of what the markers of a visit share."""


def visited(path: Path, seed: int = 0) -> tuple[Path, ...]:
    """Ten reads at every visit, with an error of the visit: numbered as reads, as repeats, and their means."""
    experiment = load_experiment(EXAMPLE / "experiment.yaml")
    readings = read_readings(EXAMPLE / "readings.csv", experiment)
    header, rows = readings_table(readings.with_values(qsf.identify(experiment, readings).predicted), experiment)
    columns = [c for c in (*header, "read") if c != "sigma_mm"]
    at, pose, repeat = [header.index(f"d{a}_mm") for a in "xyz"], header.index("pose"), header.index("repeat")
    rng = np.random.default_rng(seed)
    own = {name: rng.normal(0.0, SHARED, 3) for name in dict.fromkeys(row[pose] for row in rows)}
    made: dict[str, list[list[str]]] = {"reads": [], "repeats": [], "means": []}
    for row in rows:
        exact = np.array([float(row[k]) for k in at]) + own[row[pose]]
        values = exact + rng.normal(0.0, SIGMA, (READS, 3))
        for name, many in (("reads", values), ("repeats", values), ("means", values.mean(axis=0)[None])):
            for n, value in enumerate(many, start=1):
                cells = dict(zip(header, row, strict=True))
                cells |= {header[k]: f"{v:.9f}" for k, v in zip(at, value, strict=True)}
                cells[header[repeat]] = str(n if name == "repeats" else 1)
                cells["read"] = str(n if name == "reads" else 1)
                made[name].append([cells[c] for c in columns])
    files = [path / f"{name}.csv" for name in made]
    for file, lines in zip(files, made.values(), strict=True):
        file.write_text("\n".join(",".join(line) for line in [columns, *lines]) + "\n")
    return tuple(files)


def with_noise(experiment: Experiment, sigma: float | None) -> Experiment:
    return experiment.with_(noise=replace(experiment.noise, sigma=sigma))


@pytest.mark.parametrize("stated", [True, False])
def test_ten_reads_of_a_visit_say_as_much_as_their_mean(tmp_path: Path, stated: bool) -> None:
    experiment = load_experiment(EXAMPLE / "experiment.yaml")
    reads, repeats, means = visited(tmp_path)
    sds: list[dict[str, float]] = []
    for file, sigma in ((reads, SIGMA), (means, SIGMA / np.sqrt(READS)), (repeats, SIGMA)):
        own = with_noise(experiment, 1e-3 * sigma if stated else None)
        fit = qsf.identify(own, read_readings(file, own))
        sds.append({e.name: e.sd for e in fit.estimates if np.isfinite(e.sd) and e.sd > 0.0})
    for name, sd in sds[0].items():
        assert sd == pytest.approx(sds[1][name], rel=0.1)
    if not stated:  # of a stated noise each visit has its part of it
        assert np.median([sds[2][name] / sd for name, sd in sds[0].items()]) < 0.6, "repeats are visits of their own"


@pytest.mark.parametrize("column", [True, False])
def test_reads_that_differ_by_less_than_the_stated_noise_share_the_rest(tmp_path: Path, column: bool) -> None:
    """The noise of a coordinate is stated, its visit's part included; reads differ by a third of it, as those of a
    tracker that stands on quiet ground: the mean of ten is hardly better than one of them, and the fit agrees."""
    experiment = with_noise(load_experiment(EXAMPLE / "experiment.yaml"), 1e-3 * SIGMA)
    readings = read_readings(EXAMPLE / "readings.csv", experiment)
    clean = readings.with_values(qsf.identify(experiment, readings).predicted)
    header, rows = readings_table(clean, experiment)
    columns = [c for c in header if c != "sigma_mm"]
    at, rng = [header.index(f"d{a}_mm") for a in "xyz"], np.random.default_rng(1)
    lines: dict[str, list[list[str]]] = {"one": [], "ten": []}
    for row in rows:
        mean = np.array([float(row[k]) for k in at]) + rng.normal(0.0, SIGMA, 3)
        ten = mean + rng.normal(0.0, SIGMA / 3.0, (READS, 3))
        for name, values in (("one", ten.mean(axis=0)[None]), ("ten", ten)):
            for n, value in enumerate(values, start=1):
                cells = dict(zip(header, row, strict=True))
                cells |= {header[k]: f"{v:.9f}" for k, v in zip(at, value, strict=True)}
                lines[name].append([*(cells[c] for c in columns), str(n), *([str(SIGMA)] if column else [])])
    fits: list[qsf.Fit] = []
    for name, own in lines.items():
        head = [*columns, "read", *(["sigma_mm"] if column else [])]
        (tmp_path / name).write_text("\n".join(",".join(line) for line in [head, *own]) + "\n")
        fits.append(qsf.identify(experiment, read_readings(tmp_path / name, experiment)))
    assert [e.sd for e in fits[1].estimates] == pytest.approx([e.sd for e in fits[0].estimates], rel=0.1)
    assert fits[1].p_value is not None
    assert 0.01 < fits[1].p_value < 0.99


def test_reads_are_one_row_with_their_mean_and_count(tmp_path: Path) -> None:
    experiment = load_experiment(EXAMPLE / "experiment.yaml")
    reads, _, means = visited(tmp_path)
    one, other = read_readings(reads, experiment), read_readings(means, experiment)
    assert np.allclose(one.value, other.value, atol=1e-12)
    assert one.reads is not None
    assert set(one.reads.tolist()) == {READS}
    fit = qsf.identify(experiment, one)
    assert (fit.account.reads, fit.account.visits) == (READS * len(one), len(set(one.pose)))


def spoilt(path: Path, old: str, new: str) -> Path:
    """The file of reads with one cell of its third row changed."""
    header, *rows = visited(path)[0].read_text().splitlines()
    cells = dict(zip(header.split(","), rows[2].split(","), strict=True))
    cells[old] = new
    rows[2] = ",".join(cells.values())
    file = path / "spoilt.csv"
    file.write_text("\n".join([header, *rows]) + "\n")
    return file


@pytest.mark.parametrize(
    ("column", "cell", "words"),
    [
        ("read", "2", ("read 2 of this marker at this visit stands here twice", "line 3", "column repeat")),
        ("q1_deg", "12.5", ("a read without moving has the angles and the load of line 2", "column repeat")),
        ("read", "0", ("column read", "1, 2, 3")),
        ("use", "maybe", ("column use",)),
    ],
)
def test_what_reads_cannot_be_is_said(tmp_path: Path, column: str, cell: str, words: tuple[str, ...]) -> None:
    experiment = load_experiment(EXAMPLE / "experiment.yaml")
    with pytest.raises(InputError) as error:
        read_readings(spoilt(tmp_path, column, cell), experiment)
    for word in words:
        assert word in str(error.value)


def test_a_read_that_is_not_used_does_not_count(tmp_path: Path) -> None:
    experiment = load_experiment(EXAMPLE / "experiment.yaml")
    readings = read_readings(spoilt(tmp_path, "use", "0"), experiment)
    assert readings.reads is not None
    assert sorted(set(readings.reads.tolist())) == [READS - 1, READS]
    assert readings.use.all()


def test_rows_that_stand_twice_are_told_of_repeats_and_of_reads(tmp_path: Path) -> None:
    experiment = load_experiment(EXAMPLE / "experiment.yaml")
    header, first, *rest = (EXAMPLE / "readings.csv").read_text().splitlines()
    while header.startswith("#"):
        header, first, *rest = first, *rest
    file = tmp_path / "twice.csv"
    file.write_text("\n".join([header, first, first, *rest]) + "\n")
    with pytest.raises(InputError, match=r"brought there again.* repeat; if it was read again without moving.* read"):
        read_readings(file, experiment)
