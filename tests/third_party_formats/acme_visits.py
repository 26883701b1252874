"""`qsf visits`: how often each load is hung in a plan."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from qsframework.cli import ExperimentFile, Json, PlanFile, Trust
from qsframework.option import Option, Options


@dataclass(frozen=True, kw_only=True)
class VisitsOptions(Options):
    """What is counted."""

    once: Annotated[bool, Option("Count a pose once, however often it is visited.")] = False


def visits(
    experiment: ExperimentFile, plan: PlanFile, options: VisitsOptions, json: Json = None, trust: Trust = False
) -> None:
    """Count the visits of a plan under each load."""
    from qsframework.cli import distinct_outputs, load_campaign, load_plan, print_table, write_json

    distinct_outputs([json], [experiment, plan])
    poses = load_plan(Path(plan), load_campaign(experiment))
    counts = Counter[str]()
    for load, repeats in zip(poses.load, poses.repeats, strict=True):
        counts[load] += 1 if options.once else repeats
    print_table(("load", "visits"), [(load, str(count)) for load, count in counts.items()])
    if json is not None:
        write_json(json, {"visits": dict(counts)})
