"""Commands of `qsf`. Every import of the library is inside a command: `qsf --help` loads none of it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from qsframework.errors import QsfError

app = typer.Typer(
    name="qsf",
    help="Elastostatic calibration of heavy, quasi-serial industrial robots.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)

ExperimentFile = Annotated[Path, typer.Argument(help="experiment.yaml", show_default=False)]
Json = Annotated[Path | None, typer.Option("--json", help="Write the result as JSON.")]
Report = Annotated[Path | None, typer.Option("--report", help="Write an HTML report.")]
Seed = Annotated[int, typer.Option(help="All randomness comes from this number.", min=0)]


@app.command()
def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")] = Path("qsf-demo"),
    seed: Seed = 0,
) -> None:
    """Real readings identified, a plan designed and tried in simulation, in one report."""
    from qsframework.cli.demo import run_demo

    run_demo(output, seed)


@app.command()
def robots(json: Json = None) -> None:
    """List the robots that can be named in an experiment."""
    from qsframework.cli.commands import list_robots

    list_robots(json)


@app.command()
def check(
    files: Annotated[list[Path], typer.Argument(help="robot.yaml, experiment.yaml or a robot's name")],
    json: Json = None,
) -> None:
    """Check robots and experiments, with the readings that they name; all problems at once."""
    from qsframework.cli.commands import check_files

    check_files(files, json)


@app.command()
def stiffness(
    robot: Annotated[str, typer.Argument(help="A robot's name or folder.", show_default=False)],
    pose: Annotated[str, typer.Option(help="Pendant angles, deg: J1,J2,...", show_default=False)],
    load: Annotated[str, typer.Option(help="Force, N, base frame: fx,fy,fz[,mx,my,mz with moments in Nm].")],
    point: Annotated[str, typer.Option(help="Where the load acts, mm, flange frame.")] = "0,0,0",
    json: Json = None,
    report: Report = None,
) -> None:
    """Deflection under a load, the share of each spring, and the Cartesian stiffness."""
    from qsframework.cli.stiffness import run_stiffness

    run_stiffness(robot, pose, load, point, json, report)


@app.command()
def design(
    experiment: ExperimentFile,
    poses: Annotated[int, typer.Option("-n", "--poses", help="Number of poses.", min=1)] = 12,
    criterion: Annotated[str, typer.Option(help="D, A or O3 (the paper's weighted criterion).")] = "A",
    candidates: Annotated[int, typer.Option(help="Poses to choose from.", min=1)] = 1000,
    repeats: Annotated[bool, typer.Option(help="Allow a pose to be measured more than once.")] = False,
    output: Annotated[Path, typer.Option("-o", "--output", help="The plan.")] = Path("plan.csv"),
    seed: Seed = 0,
    json: Json = None,
    report: Report = None,
) -> None:
    """Choose the poses that pin the parameters down best, with a certificate."""
    from qsframework.cli.commands import run_design

    run_design(experiment, poses, criterion, candidates, repeats, output, seed, json, report)


@app.command()
def simulate(
    experiment: ExperimentFile,
    plan: Annotated[Path, typer.Argument(help="plan.csv", show_default=False)],
    output: Annotated[Path, typer.Option("-o", "--output", help="The readings.")] = Path("readings.csv"),
    truth: Annotated[str, typer.Option(help="'nominal' values, or 'drawn' from the priors.")] = "nominal",
    seed: Seed = 0,
    json: Json = None,
) -> None:
    """Make readings of a plan, with seeded noise."""
    from qsframework.cli.commands import run_simulate

    run_simulate(experiment, plan, output, truth, seed, json)


@app.command()
def identify(
    experiment: ExperimentFile,
    data: Annotated[Path | None, typer.Option(help="Readings; the experiment's own if left out.")] = None,
    fit: Annotated[list[str] | None, typer.Option(help="Estimate this parameter (repeat the option).")] = None,
    json: Json = None,
    report: Report = None,
) -> None:
    """Estimate the parameters from readings."""
    from qsframework.cli.commands import run_identify

    run_identify(experiment, data, fit, json, report)


def main() -> None:
    """Run `qsf`; bad input ends with exit code 2 and a message that says what to do."""
    try:
        app()
    except QsfError as error:
        lines = str(error).splitlines()
        shown = lines[:_MOST]
        if len(lines) > _MOST:
            shown.append(f"... and {len(lines) - _MOST} more problems")
        print("\n".join(f"error: {line}" for line in shown), file=sys.stderr)
        sys.exit(2)


_MOST = 20
