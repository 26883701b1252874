"""Two days of measuring: what the first leaves open the second one settles."""

from dataclasses import replace

import pytest

from qsframework.design import design
from qsframework.diagnose import diagnose
from qsframework.diagnose.linearization.candidates import find_causes
from qsframework.discriminate.follow_up import second_day
from qsframework.errors import InputError
from qsframework.experiment import example, load_experiment, read_readings, simulate, write_readings
from qsframework.forecast.power import forecast

TRUE, RIVAL = "link_compliance[link_2/ry]", "link_compliance[link_1/ry]"


@pytest.fixture(scope="module")
def experiment():
    found = load_experiment(example("m900ib") / "experiment.yaml")
    return found.with_(constraints=replace(found.constraints, joint_margin=0.0))  # poses up to the joints' limits


@pytest.fixture(scope="module")
def first_plan(experiment):
    return design(experiment, 12, "D", candidates=300, seed=3)


@pytest.fixture(scope="module")
def truth(experiment, first_plan):
    """The robot with a link that gives, half as much again as the first day detects."""
    cause = next(c for c in find_causes(experiment, experiment.fit_names(), first_plan.poses)[0] if c.name == TRUE)
    size = 1.5 * forecast(experiment, first_plan, exact=False).of(TRUE).sizes[0].detect
    p = replace(cause.effects[0].parameters(experiment.robot.facts)[0], nominal=size)
    return experiment.with_(effects=(*experiment.effects, cause.effects[0]), parameters=(*experiment.parameters, p))


def joined(days, experiment, folder):
    """Readings of several days, each from a file of its own."""
    files = [folder / f"day{i}.csv" for i in range(len(days))]
    for file, day in zip(files, days, strict=True):
        write_readings(file, day, experiment)
    return read_readings(files, experiment)


def test_the_second_day_settles_what_the_first_left_open(experiment, first_plan, truth, tmp_path):
    first = simulate(truth, first_plan, seed=2).readings
    before = diagnose(experiment, first, repeats=1)
    open_ = {before.findings[0].name, *(r.name for r in before.findings[0].rivals)}
    assert {TRUE, RIVAL} <= open_  # and what bends along the same links
    day = second_day(before, 12)
    contest = next(c for c in day.contests if {c.first, c.second} == {TRUE, RIVAL})
    assert contest.s_before < 2.0
    assert contest.s_after > 3.0 * contest.s_before
    after = diagnose(
        experiment, joined([first, simulate(truth, day.plan, seed=52).readings], experiment, tmp_path), repeats=1
    )
    (cause,) = after.findings
    left = {cause.name, *(r.name for r in cause.rivals)}
    assert TRUE in left
    assert left == {n for n in left if "link_2" in n}, "link 1 is out"


def test_nothing_named_leaves_nothing_to_separate(experiment, first_plan):
    quiet = diagnose(experiment, simulate(experiment, first_plan, seed=0).readings, repeats=1)
    assert quiet.verdict == "none"
    with pytest.raises(InputError, match="nothing is left to separate"):
        second_day(quiet)
