"""`qsf diagnose` of a plan, and the plan of a second day at the end of one: what they print and write."""

import json
from contextlib import redirect_stdout
from dataclasses import replace
from importlib import import_module
from io import StringIO

import numpy as np
import pytest

from qsf_day.run import SECOND_DAY, second_day
from qsframework.cli.diagnose_plan import run_foresight
from qsframework.diagnoses import forecast
from qsframework.errors import InputError
from qsframework.experiment import example, load_experiment, read_plan, write_plan
from qsframework.plans import design
from qsframework.report.power_section import angle_figure, pair_table, power_figure, power_section, size_table
from tests.diagnose.cases import hardened

FILE = example("m900ib") / "experiment.yaml"


@pytest.fixture(scope="module")
def experiment():
    return load_experiment(FILE)


@pytest.fixture(scope="module")
def plan_file(experiment, tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "plan.csv"
    write_plan(path, design(experiment, 12, "D", candidates=100), experiment)
    return path


@pytest.fixture(scope="module")
def judged(plan_file, tmp_path_factory):
    """The command's folder, what it said, and the forecast that it made."""
    made, folder = [], tmp_path_factory.mktemp("judged")
    with pytest.MonkeyPatch.context() as patched, redirect_stdout(StringIO()) as said:
        package = import_module("qsframework.diagnoses")
        patched.setattr(package, "forecast", lambda *given, **more: made.append(forecast(*given, **more)) or made[0])
        run_foresight(FILE, plan_file, folder / "f.json", folder / "f.html")
    return folder, said.getvalue(), made[0]


@pytest.fixture(scope="module")
def foresight(judged):
    return judged[2]


def test_the_plan_is_judged_before_it_is_measured(judged):
    folder, said, _ = judged
    assert "can be named" in said
    assert "smallest size detected" not in said
    assert "Only with the column temperature: thermal_expansion" in said
    content = json.loads((folder / "f.json").read_text())
    by_name = {c["id"]: c for c in content["causes"]}
    assert by_name["joint_hardening[joint_3]"]["sizes"][0]["detect"] > 0.0
    assert "that no library holds, the right place would be ranked first in" in " ".join(said.split())
    assert {"drive", "world"} <= {content["unknown"]["places"][0]["place"].split()[1], *_links(content)}
    page = (folder / "f.html").read_text()
    assert "What this plan would show" in page
    assert "Angles between causes" in page
    assert "Chance of detection" in page
    assert "http" not in page.split("<body>")[1].split("<script")[0]


def test_a_plan_is_judged_at_length_where_asked(plan_file, foresight, monkeypatch, capsys):
    monkeypatch.setattr(import_module("qsframework.diagnoses"), "forecast", lambda *given, **more: foresight)
    run_foresight(FILE, plan_file, verbose=True)
    said = " ".join(capsys.readouterr().out.split())
    assert "smallest size detected" in said
    assert "confounded with the fitted parameters" in said
    assert "separated from s" in said


def _links(content):
    return {m["link"] for m in content["unknown"]["mounts"]}


def test_outputs_must_differ_from_the_plan(plan_file):
    with pytest.raises(InputError, match="overwrite"):
        run_foresight(FILE, plan_file, plan_file)


def test_the_section_shows_every_cause_once(foresight):
    section = power_section(foresight)
    tables = [b for b in section.blocks if hasattr(b, "rows")]
    listed = [row[0] for row in tables[1].rows]
    every = [p.name for p in foresight.prospects]
    kinds = [(row[0], where) for row in tables[0].rows for cell in row[1:] if cell for where in cell.split(", ")]
    assert sorted(kind if where == "yes" else f"{kind}[{where}]" for kind, where in kinds) == sorted(every)
    for cell, _ in tables[-1].rows:
        kind, _, places = cell.partition(" ")
        listed += [f"{kind}[{where}]" if where else kind for where in places.split(", ")]
    assert sorted(listed) == sorted(every + [u.name for u in foresight.untested])
    assert len(pair_table(foresight).rows) == len(foresight.pairs) > 0
    assert all(len(row) == len(size_table(foresight).header) for row in size_table(foresight).rows)


def test_the_heat_map_puts_aliases_side_by_side(foresight):
    names = [p.name for p in foresight.prospects]
    figure = angle_figure(names, foresight.angles, "").figure
    labels = list(figure.data[0]["x"])
    assert len(labels) == np.isfinite(foresight.angles).any(axis=0).sum()
    for pair in foresight.pairs[:3]:
        assert abs(labels.index(pair.first) - labels.index(pair.second)) <= 2
    i, j = labels.index(foresight.pairs[-1].first), labels.index(foresight.pairs[-1].second)
    assert figure.data[0]["z"][i][j] == pytest.approx(np.rad2deg(foresight.pairs[-1].angle))


def test_the_power_curve_rises(foresight):
    curve = power_figure(foresight).data[0]
    assert curve["y"][0] < 1.0
    assert curve["y"][-1] > 99.0
    assert np.all(np.diff(curve["y"]) >= -1e-9)


def test_a_measuring_day_plans_the_next_one(tmp_path):
    """Where its diagnosis leaves something open; and where nothing can be planned, it says so and goes on."""
    found = hardened()
    after, said = second_day(found, tmp_path)
    assert after is not None
    assert len(read_plan(tmp_path / SECOND_DAY, found.experiment).pose) == 8
    assert "8 visits bring the chance of naming the right place" in said[0]
    nowhere = found.experiment.with_(constraints=replace(found.experiment.constraints, z_min=50.0))
    after, said = second_day(replace(found, experiment=nowhere), tmp_path / "none")
    assert after is None
    assert said[0].startswith("no plan of a second day: ")
