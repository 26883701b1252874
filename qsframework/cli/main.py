"""Commands of `qsf`. Every import of the library is inside a command: `qsf --help` loads none of it."""

from __future__ import annotations

import errno
import gc
import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from qsframework.cli.help import Command, Group
from qsframework.cli.options import Anyway, DaskAddress, ExperimentFile, Jobs, Json, Report, Seed, Trust
from qsframework.cli.printing import held_back
from qsframework.cli.stop import Stopped, listening
from qsframework.cli.work import add_commands
from qsframework.errors import InputError, Problem, QsfError
from qsframework.terminal import folded, printable, width

app = typer.Typer(
    name="qsf",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    cls=Group,
)
command = partial(app.command, cls=Command)

Files = Annotated[
    list[Path] | None,
    typer.Argument(metavar="[READINGS]...", help="Files of readings (default: the experiment's own)."),
]
Linear = Annotated[
    bool,
    typer.Option("--linear", help="Balance the load at the undeflected pose, as the paper does."),
]
States = Annotated[
    str | None,
    typer.Option(help="Read files of states as 'differences' (loaded minus unloaded) or 'positions'."),
]


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        print(f"qsframework {version('qsframework')}")
        raise typer.Exit


@app.callback()
def whole(
    told: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_version, is_eager=True)
    ] = False,
    trust: Trust = False,
) -> None:
    """Elastostatic calibration of heavy, quasi-serial industrial robots."""


@command()
def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")] = Path("qsf-demo"),
    seed: Seed = 0,
    json: Json = None,
) -> None:
    """Example from readings to report: identify, design, simulate."""
    from qsframework.cli.demo import run_demo

    run_demo(output, seed, json)


@command()
def robots(json: Json = None, report: Report = None, trust: Trust = False) -> None:
    """List the robots that an experiment can use."""
    from qsframework.cli.robots import list_robots

    list_robots(json, report)


@command()
def check(
    files: Annotated[list[Path], typer.Argument(help="robot.yaml, experiment.yaml or a robot's name")],
    conformance: Annotated[
        bool, typer.Option("--conformance", help="Test the robots throughout, including a small simulated campaign.")
    ] = False,
    json: Json = None,
    report: Report = None,
    trust: Trust = False,
) -> None:
    """Check robots, experiments and readings; lists all problems."""
    from qsframework.cli.check import check_files

    check_files(files, json, report)
    if conformance:
        from qsframework.cli.new import run_conformance

        run_conformance(files)


@command()
def stiffness(
    robot: Annotated[str, typer.Argument(help="A robot's name or folder.", show_default=False)],
    pose: Annotated[str, typer.Option(help="Pendant angles, deg, or mm: J1,J2,...", show_default=False)],
    load: Annotated[str, typer.Option(help="Force, N, base frame: fx,fy,fz[,mx,my,mz with moments in Nm].")],
    point: Annotated[str, typer.Option(help="Where the load acts, mm, flange frame.")] = "0,0,0",
    json: Json = None,
    report: Report = None,
    trust: Trust = False,
) -> None:
    """Deflection under a load, spring by spring; Cartesian stiffness."""
    from qsframework.cli.stiffness import run_stiffness

    run_stiffness(robot, pose, load, point, json, report)


@command()
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
    pose: Annotated[str | None, typer.Option(help="Pendant angles, deg, or mm: J1,J2,... instead of a plan.")] = None,
    load: Annotated[str | None, typer.Option(help="Force, N, base frame: fx,fy,fz[,mx,my,mz in Nm].")] = None,
    point: Annotated[str | None, typer.Option(help="Where the load acts on a robot, mm, flange frame.")] = None,
    scale: Annotated[float, typer.Option(help="Magnification of deflections, ellipsoids and residuals.")] = 100,
    html: Annotated[Path | None, typer.Option(help="Write one self-contained page instead of serving.")] = None,
    port: Annotated[int, typer.Option(help="Port on this machine; 0 takes any free one.")] = 7000,
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


@command()
def design(
    experiment: ExperimentFile,
    poses: Annotated[
        int | None,
        typer.Option(
            "-n", "--poses", help="Number of poses; the most with --for.", min=1, max=10_000, rich_help_panel="Plan"
        ),
    ] = None,
    task: Annotated[
        Path | None, typer.Option("--for", help="task.yaml: the smallest plan for the points of its path.")
    ] = None,
    accuracy_mm: Annotated[
        float | None, typer.Option(help="With --for: required accuracy of the tool there, k = 2.", min=0.0)
    ] = None,
    budget: Annotated[float | None, typer.Option(help="Total cost instead of -n, by the loads' `cost`.")] = None,
    repeats: Annotated[bool, typer.Option("--repeats", help="Allow a pose to be measured more than once.")] = False,
    taken: Annotated[list[Path] | None, typer.Option(help="Readings or a plan already taken (repeat).")] = None,
    criterion: Annotated[
        str,
        typer.Option(
            help="I: mean error of the tip after compensation; G: the largest one; D, A, E, O3: of the parameters; "
            "Ds, L: of the parameters of --interest.",
            rich_help_panel="Criterion",
        ),
    ] = "I",
    interest: Annotated[
        list[str] | None, typer.Option(help="A parameter of interest for Ds and L (repeat the option).")
    ] = None,
    test_poses: Annotated[
        Path | None, typer.Option(help="For I and G: plan file with the poses and loads of the work.")
    ] = None,
    prior: Annotated[
        bool, typer.Option("--prior", help="Use the stated sd of each parameter as prior information.")
    ] = False,
    samples: Annotated[
        int, typer.Option(help="Draws of the parameters that the plan must serve.", min=1, max=1000)
    ] = 1,
    worst: Annotated[bool, typer.Option("--worst", help="Minimax over the samples instead of their mean.")] = False,
    candidates: Annotated[
        str,
        typer.Option(
            help="How many poses to draw, 'grid:5' for 5 angles of each joint, or a file of poses.",
            rich_help_panel="Search",
        ),
    ] = "1000",
    efficiency: Annotated[float, typer.Option(help="Efficiency that must be certified.", min=0.0, max=1.0)] = 0.9999,
    solver: Annotated[str, typer.Option(help="'columns', or 'cvxpy' as the reference.")] = "columns",
    polish: Annotated[bool, typer.Option(help="Refine the angles continuously, off the candidates.")] = True,
    output: Annotated[Path, typer.Option("-o", "--output", help="The plan.", rich_help_panel="Output")] = Path(
        "plan.csv"
    ),
    verbose: Annotated[bool, typer.Option("--verbose", help="Print how many poses each constraint excludes.")] = False,
    jobs: Jobs = 1,
    dask: DaskAddress = None,
    seed: Seed = 0,
    json: Json = None,
    report: Report = None,
    trust: Trust = False,
) -> None:
    """Select optimal measurement poses, with a certificate."""
    from qsframework.cli.design import DesignFiles, run_design
    from qsframework.design import DesignOptions
    from qsframework.work import Work

    options = DesignOptions(
        criterion=criterion,
        interest=tuple(interest or ()),
        repeats=repeats,
        efficiency=efficiency,
        prior=prior,
        samples=samples,
        worst=worst,
        budget=budget,
        solver=solver,
        polish=polish,
    )
    run_design(
        DesignFiles(
            experiment=experiment,
            candidates=candidates,
            taken=tuple(taken or ()),
            test_poses=test_poses,
            output=output,
            json=json,
            report=report,
            task=task,
        ),
        poses,
        options,
        seed,
        Work(jobs, dask),
        verbose,
        accuracy=None if accuracy_mm is None else 1e-3 * accuracy_mm,
    )


@command()
def simulate(
    experiment: ExperimentFile,
    plan: Annotated[
        Path, typer.Argument(help="plan.csv, or readings.csv, whose rows are simulated anew.", show_default=False)
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="The readings.")] = Path("readings.csv"),
    truth: Annotated[
        str, typer.Option(help="'nominal' values, or 'drawn': by stated sds or typical sizes.")
    ] = "nominal",
    linear: Linear = False,
    seed: Seed = 0,
    json: Json = None,
    report: Report = None,
    trust: Trust = False,
) -> None:
    """Simulate the readings of a plan, with seeded noise."""
    from qsframework.cli.simulate import run_simulate

    run_simulate(experiment, plan, output, truth, seed, json, linear, report)


@command()
def identify(
    experiment: ExperimentFile,
    files: Files = None,
    fit: Annotated[
        list[str] | None,
        typer.Option(help="Estimate this parameter (repeat the option).", rich_help_panel="Estimation"),
    ] = None,
    method: Annotated[
        str, typer.Option(help="one-step, or two-step (a balanced joint angle by angle first).")
    ] = "one-step",
    linear: Linear = False,
    bounds: Annotated[bool, typer.Option("--bounds", help="Keep the parameters' bounds.")] = False,
    priors: Annotated[bool, typer.Option("--priors", help="Use stated values and sds as prior information.")] = False,
    loss: Annotated[str, typer.Option(help="linear, huber or soft_l1.")] = "linear",
    fixed: Annotated[list[str] | None, typer.Option(help="Hold this parameter at its value (repeat).")] = None,
    tied: Annotated[
        list[str] | None, typer.Option(help="NAME,NAME: keep the ratio of their nominal values (repeat).")
    ] = None,
    profile: Annotated[
        list[str] | None, typer.Option(help="Profile interval, 95 %, of this parameter (repeat).")
    ] = None,
    clean: Annotated[
        bool,
        typer.Option(
            "--clean", help="Mask outliers and wrong rows before the fit, and list them.", rich_help_panel="Readings"
        ),
    ] = False,
    keep_all: Annotated[bool, typer.Option("--keep-all", help="Mask no reading: outliers are used too.")] = False,
    shared_error: Annotated[
        bool,
        typer.Option("--shared-error", help="Estimate the repeatability error, which the markers of a visit share."),
    ] = False,
    states: States = None,
    nominal: Annotated[
        Path | None, typer.Option(help="Write a nominal.yaml with the identified values.", rich_help_panel="Output")
    ] = None,
    urdf: Annotated[Path | None, typer.Option(help="Write the robot's URDF with corrected joint origins.")] = None,
    compare: Annotated[
        Path | None, typer.Option(help="fit.json of an earlier campaign: lists the changes since.")
    ] = None,
    verbose: Annotated[bool, typer.Option("--verbose", help="Print all rows and columns of the tables.")] = False,
    json: Json = None,
    report: Report = None,
    anyway: Anyway = False,
    trust: Trust = False,
) -> None:
    """Estimate the parameters from readings of any kind."""
    from qsframework.cli.identify import FitFiles, run_identify
    from qsframework.estimation import FitOptions

    if clean and keep_all:
        raise InputError("--clean masks what --keep-all keeps; give one of them")
    groups = tuple(tuple(name.strip() for name in group.split(",")) for group in tied or ())
    options = FitOptions(
        method=method,
        linear=linear,
        bounds=bounds,
        priors=priors,
        loss=loss,
        fixed=tuple(fixed or ()),
        tied=groups,
        shared="pose" if shared_error else "",
        profile=tuple(profile or ()),
        keep_all=keep_all,
    )
    paths = FitFiles(
        experiment=experiment,
        data=tuple(files or ()),
        json=json,
        report=report,
        nominal=nominal,
        urdf=urdf,
        states=states,
        anyway=anyway,
        compare=compare,
        verbose=verbose,
    )
    run_identify(paths, fit, options, clean)


@command()
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
    halves: Annotated[
        int, typer.Option(help="Cross-validate: fit N random halves, report errors on the others.", min=0, max=1000)
    ] = 0,
    states: States = None,
    seed: Seed = 0,
    json: Json = None,
    report: Report = None,
    trust: Trust = False,
) -> None:
    """Errors of a fit at held-out readings."""
    from qsframework.cli.identify import FitFiles, run_validate
    from qsframework.cli.kinds import sorted_out, the_fit

    given = sorted_out(files, ("fit",), "readings")
    paths = FitFiles(experiment=experiment, data=tuple(given["readings"]), json=json, report=report, states=states)
    run_validate(paths, the_fit(given, "validate EXPERIMENT fit.json [READINGS...]"), halves, seed)


@command()
def diagnose(
    experiment: ExperimentFile,
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[READINGS|PLAN]...",
            help="Readings (default: the experiment's own); or, before measuring, a plan: which causes it would detect "
            "and identify.",
            show_default=False,
        ),
    ] = None,
    level: Annotated[float, typer.Option(help="False-alarm probability.", rich_help_panel="Diagnosis")] = 0.02,
    verbose: Annotated[
        bool, typer.Option("--verbose", help="List all causes, also excluded and unobservable ones.")
    ] = False,
    extend: Annotated[
        Path | None,
        typer.Option(help="Folder for the extended robot and an experiment on it.", rich_help_panel="Extended model"),
    ] = None,
    extend_doubtful: Annotated[
        bool,
        typer.Option(
            "--extend-doubtful", help="Extend by doubtful causes too, which do not clearly reduce the held-out error."
        ),
    ] = False,
    follow_up: Annotated[
        int,
        typer.Option(
            "--follow-up",
            metavar="<N>",
            help="Plan N visits of a second day that decide what is open.",
            min=0,
            max=1000,
            show_default=False,
            rich_help_panel="Further poses",
        ),
    ] = 0,
    without: Annotated[
        list[str] | None,
        typer.Option(
            metavar="<LINK>",
            help="A link that nobody can mount a reflector on (world: the floor; gauges: no dial gauge); may stand "
            "more than once.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            help="The plan of --follow-up (follow-up.csv).",
            show_default=False,
        ),
    ] = None,
    jobs: Jobs = 1,
    dask: DaskAddress = None,
    seed: Seed = 0,
    json: Json = None,
    report: Report = None,
    trust: Trust = False,
) -> None:
    """Find unmodelled effects, extend the model, measure the gain."""
    from qsframework.cli.diagnose import Asked, DiagnoseFiles, run_diagnose
    from qsframework.cli.kinds import sorted_out
    from qsframework.work import Work

    given = sorted_out(files or (), ("plan",), "readings")
    paths = DiagnoseFiles(
        experiment=experiment,
        data=tuple(given["readings"]),
        json=json,
        report=report,
        extend=extend,
        doubtful=extend_doubtful,
        plan=next(iter(given.get("plan", ())), None),
        output=output,
    )
    asked = Asked(
        level=level,
        seed=seed,
        follow_up=follow_up,
        without=tuple(without or ()),
        verbose=verbose,
    )
    run_diagnose(paths, asked, Work(jobs, dask))


add_commands(app)


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
            _refuse_empty(sys.argv[1:])
            # app() would put a hook of its own where `listening` hears what compiled code loses
            typer.main.get_command(app)()
    except Stopped as stopped:
        print("stopped: the files written so far are whole", file=sys.stderr)
        sys.exit(stopped.code)
    except QsfError as error:
        lines = _told(error)
        shown = lines[:_MOST]
        if len(lines) > _MOST:
            shown.append(f"... and {len(lines) - _MOST} more problems")
        print("\n".join(folded(f"error: {printable(line)}", width(), "  ") for line in shown), file=sys.stderr)
        sys.exit(2)
    except MemoryError:
        print("error: the memory ran out; fewer candidates, poses or jobs need less", file=sys.stderr)
        sys.exit(2)
    except BrokenPipeError:  # whoever read has seen enough, and the files are written
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        sys.exit(0)
    except OSError as error:
        if error.filename is not None:  # a name that is too long, a folder that nobody may read
            print(f"error: {printable(str(error.filename))[:_LONGEST]}: {error.strerror}", file=sys.stderr)
            sys.exit(2)
        if error.errno not in (errno.ENOSPC, errno.EIO):
            raise
        # the device behind standard output is full: Python would try it again at its end, and say so in its own words
        print(f"error: the output cannot be printed: {error.strerror}", file=sys.stderr, flush=True)
        os._exit(1)


def _refuse_empty(words: Sequence[str]) -> None:
    """InputError for an option or an argument whose value is empty, which would be read as the folder `.`."""
    for before, word in zip(["", *words], words, strict=False):
        bare = word.startswith("--") and word.endswith("=")
        if bare or not word:
            named = word[:-1] if bare else before if before.startswith("-") else "an argument"
            raise InputError(Problem(f"{named}: the value is empty", hint="Give it a value, or leave it out."))


def _told(error: QsfError) -> list[str]:
    """The lines of an error, with the options that would mend its problems."""
    if not isinstance(error, InputError):
        return str(error).splitlines()
    said = (
        (str(p), "" if p.argument is None else f" (--{' '.join(p.argument)}".rstrip() + ")") for p in error.problems
    )
    return [line for text, option in said for line in f"{text}{option}".splitlines()]


_MOST, _LONGEST = 20, 200
