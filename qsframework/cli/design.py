"""`qsf design`: what the command reads, prints and writes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from qsframework.cli.commands import beside, distinct_outputs, load_campaign, write_json
from qsframework.cli.files import DesignFiles
from qsframework.cli.identify import ROWS
from qsframework.cli.printing import print_folded, print_table, print_verdict
from qsframework.cli.progress import progress
from qsframework.elastostatics import range_notes
from qsframework.errors import InputError
from qsframework.experiment import Experiment, Plan, Readings, read_plan, read_readings, write_plan
from qsframework.experiment.prior import priors_of
from qsframework.information import predicted_sd
from qsframework.plans import (
    DesignOptions,
    design,
    equivalent_poses,
    generate_candidates,
    grid_candidates,
    joint_sd,
    plan_for,
    read_candidates,
)
from qsframework.plans.candidates import Candidates
from qsframework.plans.need import Needed
from qsframework.plans.problem import counted_once
from qsframework.plugin import Array
from qsframework.report import certificate_text, sd_table, write_report
from qsframework.report.blocks import ReportTable
from qsframework.report.plan_section import margin_words, plan_sections
from qsframework.report.provenance import AFTER, EQUILIBRIUM, INFORMATION, computed
from qsframework.report.words.plan import need_words, plan_verdict, tip_words
from qsframework.work import Work

Tell = Callable[[str, int, int], None]


_POSES, _MOST = 12, 200
"""Poses of a plan where nobody says how many, and the most of one that is to reach an accuracy."""


def run_design(
    files: DesignFiles,
    poses: int | None,
    options: DesignOptions,
    seed: int,
    work: Work,
) -> None:
    """Design, write plan.csv and plan.json, print the predicted uncertainties of the plan."""
    experiment = load_campaign(files.experiment)
    outputs = [files.output, beside(files.output, ".json"), files.json, files.report]
    distinct_outputs(outputs, files.inputs())
    taken = [read_taken(path, experiment) for path in files.taken]
    test = None if files.test_poses is None else read_plan(files.test_poses, experiment).poses
    if (files.task is None) != (files.accuracy is None):
        raise InputError("--for and --accuracy-mm belong together: --for task.yaml --accuracy-mm 0.1")
    needed: Needed | None = None
    with progress() as tell:
        if files.task is not None and files.accuracy is not None:
            found, needed = _needed(
                files, files.task, files.accuracy, experiment, poses or _MOST, options, seed, tell, work
            )
            plan = needed.plan
        else:
            found = find_candidates(files.candidates, experiment, seed, tell, work)
            plan = design(
                experiment,
                poses or _POSES,
                candidates=found,
                seed=seed,
                progress=tell,
                options=options,
                test_poses=test,
                taken=taken,
                work=work,
            )
    write_plan(files.output, plan, experiment)
    sds = {"this plan": predicted_sd(experiment, plan, free=options.free)}
    if taken:
        sds["with what was taken"] = joint_sd(experiment, [plan, *counted_once(taken)[0]], free=options.free)
    table = _sd_table(experiment, plan, sds, options.free)
    verdict = plan_verdict(experiment, plan, sds["this plan"], needed is None or needed.enough, options.free)
    print_verdict(verdict)
    print_folded(*([] if needed is None else need_words(needed)))
    print_table(table.header, table.rows, most=None if files.verbose else ROWS)
    print_folded(f"{found.words() if files.verbose else found.summary}.")
    if not files.verbose and any(found.alone.values()):
        print("`--verbose` says which constraint excludes how many.")
    beyond = [f"Note: {n}." for n in range_notes(experiment.model(), plan.poses, plan.pose)]
    margin = margin_words(experiment)
    print_folded(certificate_text(plan), margin, *twin_words(experiment, plan), *beyond)
    print(f"plan: {files.output}")
    mixed = plan.of_positions.any() and not plan.of_positions.all()  # positions and displacements are two files
    simulated = "" if mixed else f", or try it: qsf simulate {files.experiment} {files.output}"
    if plan.of_positions.any():
        print(f"next: to the robot: qsf export {files.experiment} {files.output} --to FORMAT -o FILE{simulated}")
    else:
        print(f"next: measure each pose unloaded, then loaded{simulated}")
    if files.json is not None:
        certificate = plan.certificate.as_json() if plan.certificate else None
        content = {"plan": str(files.output), "certificate": certificate, "candidates": found.words()}
        write_json(files.json, content | ({} if needed is None else {"needed": needed.as_json()}))
    if files.report is not None:
        notes = (found.words(), margin, *tip_words(plan), *twin_words(experiment, plan), *beyond)
        sections = (
            *plan_sections(experiment, plan, table, notes),
            computed(experiment, files.inputs(), seed, (EQUILIBRIUM, INFORMATION, AFTER)),
        )
        print(f"report: {write_report(files.report, f'Measurement plan: {experiment.robot.title}', sections, verdict)}")


def _needed(
    files: DesignFiles,
    task: Path,
    accuracy: float,
    experiment: Experiment,
    most: int,
    options: DesignOptions,
    seed: int,
    tell: Tell,
    work: Work,
) -> tuple[Candidates, Needed]:
    """The smallest plan for a task. InputError where another option asks for something else, or the arm does not reach
    a point."""
    from qsframework.uses.inverse import standing, tool_of
    from qsframework.uses.task import load_task_path

    if files.test_poses is not None or files.taken or options.budget is not None:
        raise InputError(
            "--for conflicts with --test-poses, --taken and --budget: the task gives the places, and the fewest poses "
            "are sought"
        )
    robot, asked = experiment.robot, load_task_path(task)
    tool = tool_of(robot, asked.tool)
    points = standing(robot, experiment.model(), tool, asked, str(task), seed)
    found = find_candidates(files.candidates, experiment, seed, tell, work)
    needed = plan_for(
        experiment, points, tool.site, accuracy, found, most=most, seed=seed, options=options, progress=tell, work=work
    )
    return found, needed


def _sd_table(experiment: Experiment, plan: Plan, sds: Mapping[str, Array], free: bool) -> ReportTable:
    """The predicted sds, of positions without the parameters that no plan identifies, beside what is known before."""
    parameters, identified = experiment.fit_parameters(), plan.certificate.parameters if plan.certificate else ()
    model = experiment.model()
    before = priors_of(model).sd[model.index(experiment.fit_names())]
    if np.isfinite(before).any() and not free:
        sds = {"before": np.where(np.isfinite(before), before, np.nan), **sds}
    kept = [i for i, p in enumerate(parameters) if p.name in identified or not plan.of_positions.any()]
    return sd_table([parameters[i] for i in kept], {name: sd[kept] for name, sd in sds.items()})


def find_candidates(words: str, experiment: Experiment, seed: int, tell: Tell, work: Work) -> Candidates:
    """Candidates from a number, `grid:LEVELS`, or a file of poses."""
    if words.isdigit() and int(words) > 0:
        return generate_candidates(experiment, int(words), seed, partial(tell, "candidate poses"), work)
    if words.startswith("grid:") and words[5:].isdigit():
        return grid_candidates(experiment, int(words[5:]), partial(tell, "candidate poses"), work)
    if Path(words).suffix == ".csv":
        return read_candidates(experiment, Path(words))
    raise InputError(f"--candidates {words}: give a number, grid:LEVELS (grid:5) or a .csv file of poses")


def read_taken(path: Path, experiment: Experiment) -> Plan | Readings:
    """Readings or a plan: readings have a column `marker`."""
    from qsframework.cli.kinds import kind
    from qsframework.experiment.columns import check_ours

    check_ours(path, "the columns of a plan or of readings")
    return read_readings(path, experiment) if kind(path) == "readings" else read_plan(path, experiment)


def twin_words(experiment: Experiment, plan: Plan) -> list[str]:
    """Poses of the plan with equal information."""
    pairs = equivalent_poses(experiment, plan)
    return [f"{first} and {second} carry the same information: {symmetry}" for first, second, symmetry in pairs]
