"""`qsf diagnose` of a plan, `--separate`, `--follow-up`: what a plan would show, which poses would show more."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from qsframework.cli.commands import beside, distinct_outputs, write_json
from qsframework.cli.design import read_taken
from qsframework.cli.printing import print_folded, print_table, print_verdict
from qsframework.cli.progress import progress
from qsframework.diagnose.result import Diagnosis
from qsframework.discriminate.follow_up import FollowUp, follow_up
from qsframework.errors import NotIdentifiable
from qsframework.experiment import Experiment, Plan, Readings, load_experiment, read_plan, write_plan
from qsframework.work import HERE, Work


def run_foresight(
    experiment: Path,
    plan: Path,
    json: Path | None = None,
    report: Path | None = None,
    seed: int = 0,
    work: Work = HERE,
) -> None:
    """Print, before anything is measured, what a plan would detect and name, and what stays invisible."""
    from qsframework.elastostatics import range_notes
    from qsframework.forecast.power import forecast
    from qsframework.information import predicted_uncertainties
    from qsframework.report.plan_section import predicted_table
    from qsframework.report.power_section import pair_table, power_section, size_table
    from qsframework.report.result_json import foresight_json
    from qsframework.report.words.forecast import foresight_verdict, foresight_words

    campaign = load_experiment(experiment)
    distinct_outputs([json, report], [experiment, plan, beside(plan, ".json")])
    planned = read_plan(plan, campaign)
    told = predicted_uncertainties(campaign, planned)
    known = predicted_table(told)
    with progress() as tell:
        try:
            found = forecast(campaign, planned, seed=seed, progress=tell, work=work)
        except NotIdentifiable:
            print_table(known.header, known.rows)  # it shows what the plan does tell
            raise
    verdict = foresight_verdict(found)
    print_verdict(verdict)
    print_table(known.header, known.rows)
    for table in (size_table(found), pair_table(found)):
        if table.rows:
            print_table(table.header, table.rows)
    for line in foresight_words(found):
        print_folded(line)
    for note in range_notes(campaign.model(), planned.poses, planned.pose):
        print_folded(f"note: {note}")
    print(f"next: measure the plan, then qsf diagnose {experiment} readings.csv")
    if json is not None:
        write_json(json, {"fitted": [p.as_json() for p in told], **foresight_json(found)})
    if report is not None:
        from qsframework.report import Section, write_report
        from qsframework.report.plan_section import plan_view
        from qsframework.report.provenance import EQUILIBRIUM, INFORMATION, LINEAR, computed

        sections = (
            Section("Predicted uncertainty of the fitted parameters", (known,)),
            power_section(found),
            Section("The plan", (plan_view(campaign, planned),)),
            computed(campaign, [experiment, plan], seed, (EQUILIBRIUM, INFORMATION, LINEAR)),
        )
        title = f"Before measuring: {campaign.robot.title}"
        print(f"report: {write_report(report, title, sections, verdict)}")


def run_separate(
    experiment: Path,
    taken: Sequence[Path],
    pair: tuple[str, str],
    count: int,
    output: Path,
    json: Path | None = None,
    seed: int = 0,
) -> None:
    """Design poses that tell two named causes apart, beside readings or plans taken already."""
    from qsframework.discriminate.pair import discriminate
    from qsframework.report.result_json import discrimination_json
    from qsframework.report.words.discrimination import discrimination_words

    campaign = load_experiment(experiment)
    distinct_outputs([output, beside(output, ".json"), json], [experiment, *taken])
    before = [read_taken(path, campaign) for path in taken]
    sigma = campaign.noise.sigma or _left_over(campaign, before)
    with progress() as tell:
        found = discriminate(campaign, before, pair[0], pair[1], count, sigma=sigma, seed=seed, progress=tell)
    for line in discrimination_words(found):
        print_folded(line)
    if found.useful:
        write_plan(output, found.plan, campaign)
        print(f"plan: {output}")
    if json is not None:
        write_json(json, discrimination_json(found))


def _left_over(experiment: Experiment, taken: Sequence[Plan | Readings]) -> float | None:
    """What a fit of the readings leaves, where nobody states the noise: more than the noise, on the safe side."""
    from qsframework.identify import identify

    for one in taken:
        if isinstance(one, Readings):
            sigma = identify(experiment, one).sigma
            print_folded(
                f"Nobody states the noise; what the fitted model leaves counts as noise: {1e3 * sigma:.3g} mm."
            )
            return sigma
    return None


def run_follow_up(
    diagnosis: Diagnosis, count: int, output: Path, without: Sequence[str] = (), seed: int = 0
) -> FollowUp:
    """Choose the visits that settle what a diagnosis leaves open, write them as a plan and say what they would tell."""
    from qsframework.report.words.discrimination import follow_up_words

    with progress() as tell:
        found = follow_up(diagnosis, count, without=without, seed=seed, progress=tell)
    write_plan(output, found.plan, diagnosis.experiment)
    for line in follow_up_words(found):
        print_folded(line)
    print(f"plan: {output}")
    print(f"next: qsf protocol {diagnosis.experiment.path} {output} -o sheet.html")
    return found
