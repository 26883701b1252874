"""`qsf diagnose` of a plan: what it would show."""

from __future__ import annotations

from pathlib import Path

from qsframework.cli.commands import beside, distinct_outputs, load_campaign, write_json
from qsframework.cli.printing import print_folded, print_notes, print_table, print_verdict
from qsframework.cli.progress import progress
from qsframework.errors import NotIdentifiable
from qsframework.experiment import read_plan
from qsframework.work import HERE, Work


def run_foresight(
    experiment: Path,
    plan: Path,
    json: Path | None = None,
    report: Path | None = None,
    seed: int = 0,
    work: Work = HERE,
    *,
    verbose: bool = False,
) -> None:
    """Print, before anything is measured, what a plan would detect and name, and what stays invisible."""
    from qsframework.diagnoses import forecast
    from qsframework.elastostatics import range_notes
    from qsframework.information import predicted_uncertainties
    from qsframework.report.plan_section import predicted_table
    from qsframework.report.power_section import kinds_table, pair_table, power_section, size_table
    from qsframework.report.result_json import foresight_json
    from qsframework.report.words.forecast import foresight_verdict, foresight_words

    campaign = load_campaign(experiment)
    distinct_outputs([json, report], [experiment, plan, beside(plan, ".json")])
    planned = read_plan(plan, campaign)
    predicted = predicted_uncertainties(campaign, planned)
    uncertainties = predicted_table(predicted)
    with progress() as tell:
        try:
            found = forecast(campaign, planned, seed=seed, progress=tell, work=work)
        except NotIdentifiable:
            print_table(uncertainties.header, uncertainties.rows)  # it shows what the plan does tell
            raise
    verdict = foresight_verdict(found)
    print_verdict(verdict)
    print_table(uncertainties.header, uncertainties.rows)
    for table in (size_table(found), pair_table(found)) if verbose else (kinds_table(found),):
        if table.rows:
            print_table(table.header, table.rows)
    print_folded(*foresight_words(found, hidden=verbose)[1:])
    if not verbose:
        print("`--verbose` lists every cause with its smallest size, its alternatives and why it is not seen.")
    print_notes(range_notes(campaign.model(), planned.poses, planned.pose))
    print(f"next: measure the plan, then qsf diagnose {experiment} readings.csv")
    if json is not None:
        write_json(json, {"fitted": [p.as_json() for p in predicted], **foresight_json(found)})
    if report is not None:
        from qsframework.report import Section, write_report
        from qsframework.report.plan_section import plan_view
        from qsframework.report.provenance import EQUILIBRIUM, INFORMATION, LINEAR, computed

        sections = (
            Section("Predicted uncertainty of the fitted parameters", (uncertainties,)),
            power_section(found),
            Section("The plan", (plan_view(campaign, planned),)),
            computed(campaign, [experiment, plan], seed, (EQUILIBRIUM, INFORMATION, LINEAR)),
        )
        title = f"Before measuring: {campaign.robot.title}"
        print(f"report: {write_report(report, title, sections, verdict)}")
