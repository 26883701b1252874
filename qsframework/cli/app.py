"""Commands of `qsf`. Every import of the library is inside a command: `qsf --help` loads none of it."""

from __future__ import annotations

import errno
import gc
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from qsframework.cli.declared import Values, expanded
from qsframework.cli.files import DesignFiles, DiagnoseFiles, FitFiles
from qsframework.cli.help import Command, CommandGroup
from qsframework.cli.options import GONE, Anyway, DaskAddress, ExperimentFile, Jobs, Json, Report, Trust
from qsframework.cli.printing import held_back
from qsframework.cli.refusals import USAGE, print_errors, print_usage, told
from qsframework.cli.stop import Stopped, listening
from qsframework.cli.work import COMMANDS
from qsframework.diagnoses.options import DiagnoseOptions
from qsframework.errors import InputError, Problem, QsfError, refuse
from qsframework.estimation.options import FitOptions, Linear
from qsframework.experiment.options import ReadAs, Truth
from qsframework.fits.options import Halves
from qsframework.option import Option, Seed
from qsframework.plans.options import DesignOptions

app = typer.Typer(
    name="qsf",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    cls=CommandGroup,
)


def command(function: Callable[..., None], name: str | None = None) -> Callable[..., None]:
    """Register a command."""
    app.command(name, cls=Command)(expanded(function))
    return function


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        print(f"qsframework {version('qsframework')}")
        raise typer.Exit


@app.callback()
def whole(
    shown: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_version, is_eager=True)
    ] = False,
    trust: Trust = False,
) -> None:
    """Elastostatic calibration of heavy, quasi-serial industrial robots."""


@command
def demo(
    output: Annotated[Path, Option("Folder for the results.", short="o")] = Path("qsf-demo"),
    seed: Seed = 0,
    json: Json = None,
) -> None:
    """Example from readings to report: identify, design, simulate."""
    from qsframework.cli.demo import run_demo

    run_demo(output, seed, json)


@command
def robots(json: Json = None, report: Report = None, trust: Trust = False) -> None:
    """List the robots that an experiment can use."""
    from qsframework.cli.robots import list_robots

    list_robots(json, report)


@command
def check(
    files: Annotated[
        list[Path], typer.Argument(help="robot.yaml, experiment.yaml with its readings, or a robot's name")
    ],
    conformance: Annotated[bool, Option("Test the robots throughout, including a small simulated campaign.")] = False,
    json: Json = None,
    report: Report = None,
    trust: Trust = False,
) -> None:
    """Check robots, experiments and readings; lists all problems. Exit code 1: something is to be looked at."""
    from qsframework.cli.check import check_files, run_conformance

    look = check_files(files, json, report)
    if conformance:
        run_conformance(files)
    if look:
        raise typer.Exit(1)


@command
def stiffness(
    robot: Annotated[str, typer.Argument(help="A robot's name or folder.", show_default=False)],
    pose: Annotated[str, Option("Pendant angles, deg, or mm: J1,J2,...", shown=False)],
    load: Annotated[str, Option("Force, N, base frame: fx,fy,fz[,mx,my,mz with moments in Nm].")],
    point: Annotated[str, Option("Where the load acts, mm, flange frame.")] = "0,0,0",
    json: Json = None,
    report: Report = None,
    trust: Trust = False,
) -> None:
    """Deflection under a load, spring by spring; Cartesian stiffness."""
    from qsframework.cli.stiffness import run_stiffness

    run_stiffness(robot, pose, load, point, json, report)


@command
def show(
    subject: Annotated[str, typer.Argument(metavar="ROBOT|EXPERIMENT", help="A robot's name, or experiment.yaml.")],
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[FILES]...",
            help="plan.csv; fit.json: its values, and the residuals of its readings; other readings than the "
            "experiment's.",
            show_default=False,
        ),
    ] = None,
    pose: Annotated[str | None, Option("Pendant angles, deg, or mm: J1,J2,... instead of a plan.")] = None,
    load: Annotated[str | None, Option("Force, N, base frame: fx,fy,fz[,mx,my,mz in Nm].")] = None,
    point: Annotated[str | None, Option("Where the load acts on a robot, mm, flange frame.")] = None,
    scale: Annotated[float, Option("Magnification of deflections, ellipsoids and residuals.")] = 100,
    html: Annotated[Path | None, Option("Write one self-contained page instead of serving.")] = None,
    port: Annotated[int, Option("Port on this machine; 0 takes any free one.")] = 7000,
    anyway: Anyway = False,
    trust: Trust = False,
) -> None:
    """The robot in 3D: poses, loads, limits, deflection, residuals."""
    if html is None:
        print("Ctrl-C ends qsf show; the scene is being drawn", flush=True)  # before the libraries are loaded
    from qsframework.cli.kinds import sorted_out
    from qsframework.cli.show import Shown, run_show

    given = sorted_out(files or (), ("fit", "readings"), "plan")
    if len(given["plan"]) > 1:
        raise InputError(Problem("one plan is shown", found=", ".join(map(str, given["plan"]))))
    plan, fit, data = (next(iter(given[k]), None) for k in ("plan", "fit", "readings"))
    run_show(
        Shown(
            subject=subject,
            plan=plan,
            fit=fit,
            data=data,
            pose=pose,
            load=load,
            point=point,
            scale=scale,
            anyway=anyway,
        ),
        html,
        port,
    )


@command
def design(
    poses: Annotated[
        int | None,
        Option("Number of poses; the most with --for.", short="n", group="Plan", least=1, most=10_000),
    ] = None,
    *,
    options: DesignOptions,
    jobs: Jobs = 1,
    dask: DaskAddress = None,
    seed: Seed = 0,
    files: DesignFiles,
    trust: Trust = False,
) -> None:
    """Select optimal measurement poses, with a certificate."""
    from qsframework.cli.design import run_design
    from qsframework.work import Work

    run_design(files, poses, options, seed, Work(jobs, dask))


@command
def simulate(
    experiment: ExperimentFile,
    plan: Annotated[
        Path, typer.Argument(help="plan.csv, or readings.csv, whose rows are simulated anew.", show_default=False)
    ],
    output: Annotated[Path, Option("The readings.", short="o")] = Path("readings.csv"),
    truth: Truth = "nominal",
    linear: Linear = False,
    seed: Seed = 0,
    json: Json = None,
    report: Report = None,
    trust: Trust = False,
) -> None:
    """Simulate the readings of a plan, with seeded noise."""
    from qsframework.cli.simulate import run_simulate

    run_simulate(experiment, plan, output, truth, seed, json, linear, report)


@command
def identify(
    fit: Annotated[tuple[str, ...], Option("Estimate this parameter.", group="Estimation")] = (),
    *,
    options: FitOptions,
    clean: Annotated[bool, Option("Mask outliers and wrong rows before the fit, and list them.")] = False,
    files: FitFiles,
    trust: Trust = False,
) -> None:
    """Estimate the parameters from readings of any kind."""
    from qsframework.cli.identify import run_identify

    if clean and options.keep_all:
        raise InputError("--clean masks what --keep-all keeps; give one of them")
    run_identify(files, list(fit) or None, options, clean)


@command
def validate(
    experiment: ExperimentFile,
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FIT [READINGS]...",
            help="fit.json, and readings (default: the experiment's own).",
            show_default=False,
        ),
    ],
    halves: Halves = 0,
    states: ReadAs = None,
    seed: Seed = 0,
    json: Json = None,
    report: Report = None,
    anyway: Anyway = False,
    trust: Trust = False,
) -> None:
    """Errors of a fit at held-out readings."""
    from qsframework.cli.identify import run_validate
    from qsframework.cli.kinds import sorted_out, the_fit

    given = sorted_out(files, ("fit",), "readings")
    data = tuple(given["readings"])
    paths = FitFiles(experiment=experiment, data=data, json=json, report=report, states=states, anyway=anyway)
    run_validate(paths, the_fit(given, "validate EXPERIMENT fit.json [READINGS...]"), halves, seed)


@command
def diagnose(
    experiment: ExperimentFile,
    files: Annotated[
        tuple[Path, ...],
        typer.Argument(
            metavar="[READINGS|PLAN]...",
            help="Readings (default: the experiment's own); or, before measuring, a plan: which causes it would detect "
            "and identify.",
            show_default=False,
        ),
    ] = (),
    *,
    options: DiagnoseOptions,
    typed: Annotated[Values, DiagnoseFiles],
    jobs: Jobs = 1,
    dask: DaskAddress = None,
    trust: Trust = False,
) -> None:
    """Find unmodelled effects, extend the model, measure the gain."""
    from qsframework.cli.diagnose import run_diagnose
    from qsframework.cli.kinds import sorted_out
    from qsframework.work import Work

    given = sorted_out(files, ("plan",), "readings")
    plan = next(iter(given.get("plan", ())), None)
    paths = DiagnoseFiles(**typed, experiment=experiment, data=tuple(given["readings"]), plan=plan)
    run_diagnose(paths, options, Work(jobs, dask))


for _name, _function in COMMANDS.items():
    command(_function, _name)


_PLUGINS = "PYDANTIC_DISABLE_PLUGINS"
"""Nobody's code is looked for to meddle with the models of our files: it would cost as much as they do."""
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Matrices of a few hundred rows make threads wait for each other: on two cores a diagnosis took twice as long."""

_GARBAGE = 50_000
"""New objects after which circles are looked for, of which a command makes few: the usual 700 cost it a twentieth."""


def main() -> None:
    """Run `qsf`; bad input ends with exit code 2 and a message that says what to do, Ctrl-C with 130 and one line."""
    gc.set_threshold(_GARBAGE)
    for name in _THREADS:  # read when numpy is loaded, which comes later
        os.environ.setdefault(name, "1")
    os.environ.setdefault(_PLUGINS, "__all__")
    try:
        with listening(), held_back():
            _refuse_gone(sys.argv[1:])
            _refuse_empty(sys.argv[1:])
            # app() would put a hook of its own where `listening` hears what compiled code loses
            sys.exit(typer.main.get_command(app)(standalone_mode=False))
    except Stopped as stopped:
        print("Interrupted. No partial files were left.", file=sys.stderr)
        sys.exit(stopped.code)
    except QsfError as error:
        print_errors(told(error))
        sys.exit(2)
    except USAGE as error:
        print_usage(error)
        sys.exit(2)
    except MemoryError:
        print_errors(["the memory ran out; fewer candidates, poses or jobs need less"])
        sys.exit(2)
    except BrokenPipeError:  # whoever read has seen enough, and the files are written
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        sys.exit(0)
    except OSError as error:
        if error.filename is not None:  # a name that is too long, a folder that nobody may read
            print_errors([f"{str(error.filename)[:_LONGEST]}: {error.strerror}"])
            sys.exit(2)
        if error.errno not in (errno.ENOSPC, errno.EIO):
            raise
        # the device behind standard output is full: Python would try it again at its end, and say so in its own words
        print_errors([f"the output cannot be printed: {error.strerror}"])
        os._exit(1)


def _refuse_gone(words: Sequence[str]) -> None:
    """InputError for options that the command has no longer."""
    asked = ((word, GONE.get(f"{words[0]} {word.partition('=')[0]}")) for word in words)
    refuse([Problem(f"no such option: {word}", hint=hint) for word, hint in asked if hint])


def _refuse_empty(words: Sequence[str]) -> None:
    """InputError for an option or an argument whose value is empty, which would be read as the folder `.`."""
    for option, before, word in zip(["", "qsf", *words], ["qsf", *words], words, strict=False):
        bare = word.startswith("--") and word.endswith("=")
        if bare or not word:
            after = f"{option} {before}" if option.startswith("-") else before
            named = word[:-1] if bare else before if before.startswith("-") else f"the argument after {after}"
            raise InputError(Problem(f"{named}: the value is empty", hint="Give it a value, or leave it out."))


_LONGEST = 200


def every_command() -> dict[str, Any]:
    """The commands of `qsf` and of installed packages, by name, as click has them."""
    group: Any = typer.main.get_command(app)
    return {name: group.get_command(None, name) for name in group.list_commands(None)}
