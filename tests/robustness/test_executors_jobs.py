"""The library's own long jobs give the same bits on two processes as on one."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
from command_lines import CAMPAIGN, SMALL
from test_kill import TASK

from qsframework.cli import main
from qsframework.diagnoses import forecast
from qsframework.experiment import Experiment, Plan, load_experiment
from qsframework.plans import DesignOptions, design, generate_candidates
from qsframework.report.result_json import foresight_json
from qsframework.robot import load_robot
from qsframework.uses.compare import compare
from qsframework.uses.task import load_task
from qsframework.work import HERE, Work

Job = Callable[[Work], bytes]


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Experiment:
    """Of two joints: a forecast goes cause by cause, and those of a large arm are only more."""
    folder = tmp_path_factory.mktemp("arm")
    shutil.copytree(SMALL, folder / "small")
    (folder / "experiment.yaml").write_text(yaml.safe_dump(CAMPAIGN))
    return load_experiment(folder / "experiment.yaml")


@pytest.fixture(scope="module")
def plan(arm: Experiment) -> Plan:
    return design(arm, 6, candidates=60, options=DesignOptions(polish=False))


@pytest.fixture(params=["candidates", "design", "forecast", "comparison"])
def job(request: pytest.FixtureRequest, m900ib: Experiment, arm: Experiment, plan: Plan, tmp_path: Path) -> Job:
    (tmp_path / "task.yaml").write_text(TASK)
    task = load_task(tmp_path / "task.yaml")
    robots = [load_robot(name) for name in ("fanuc_m900ib", "ur10")]
    quick = DesignOptions(polish=False, starts=6)
    jobs: dict[str, Job] = {
        "candidates": lambda work: generate_candidates(m900ib, 9000, 3, work=work).pendant.tobytes(),
        "design": lambda work: bits_of(design(m900ib, 9, candidates=400, options=quick, work=work)),
        "forecast": lambda work: repr(foresight_json(forecast(arm, plan, work=work))).encode(),
        "comparison": lambda work: repr(compare(robots, task, work=work).as_json()).encode(),
    }
    return jobs[request.param]


def bits_of(plan: Plan) -> bytes:
    assert plan.certificate is not None
    return plan.pendant.tobytes() + repr((plan.load, plan.repeats, plan.certificate.as_json())).encode()


def test_the_same_bits_everywhere(job: Job) -> None:
    assert job(Work(2)) == job(HERE)


def test_options_that_exclude_each_other(
    root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    experiment = str(root / "examples" / "m900ib" / "experiment.yaml")
    monkeypatch.setattr("sys.argv", ["qsf", "design", experiment, "--jobs", "2", "--dask", "x"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    assert "give one of them" in capsys.readouterr().err


def test_the_option_that_kept_results_is_gone(
    root: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    experiment = str(root / "examples" / "m900ib" / "experiment.yaml")
    monkeypatch.setattr("sys.argv", ["qsf", "design", experiment, "--checkpoint", "kept"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    assert "No such option: --checkpoint" in capsys.readouterr().err
