"""The commands of `qsf` for work on the real robot. Each imports the library when it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from qsframework.cli.help import Command
from qsframework.cli.options import Anyway, DaskAddress, ExperimentFile, Jobs, Json, Report, Seed, Trust


def compensate(
    experiment: ExperimentFile,
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FIT TARGETS",
            help="fit.json, from qsf identify --json. Targets, CSV: q1_deg, ... or x_mm, y_mm, z_mm, rx_deg, ry_deg, "
            "rz_deg; and fx_N, fy_N, fz_N. Or a programme: .ls of FANUC, .src or .dat of KUKA, .mod of ABB, .script "
            "of Universal Robots.",
            show_default=False,
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="The corrected targets.")] = Path("corrected.csv"),
    reference: Annotated[
        str, typer.Option(help="Reference of the target: the rigid ('commanded') or the 'unloaded' arm.")
    ] = "commanded",
    load: Annotated[
        list[str] | None, typer.Option(help="Of a programme: fx,fy,fz[,mx,my,mz], or NAME=... of one point (repeat).")
    ] = None,
    keep: Annotated[
        list[str] | None,
        typer.Option(
            help="Leave this point, or 'line N' of a motion, uncorrected; refused: all refused ones (repeat)."
        ),
    ] = None,
    tool: Annotated[
        list[str] | None,
        typer.Option(help="Of a programme's poses: N=X,Y,Z,... of tool (or point) N on the flange (repeat)."),
    ] = None,
    frame: Annotated[
        list[str] | None,
        typer.Option(
            help="N=X,Y,Z,... of user frame (or point) N in the base frame, as the controller has it (repeat)."
        ),
    ] = None,
    start: Annotated[
        str | None, typer.Option(help="Pendant angles, deg, from which those of the first pose are searched.")
    ] = None,
    json: Json = None,
    report: Report = None,
    anyway: Anyway = False,
    trust: Trust = False,
) -> None:
    """Correct targets for deflection under load."""
    from qsframework.cli.compensate import CompensateFiles, ProgrammeTexts, run_compensate
    from qsframework.cli.kinds import sorted_out, the_fit
    from qsframework.errors import InputError, Problem

    given = sorted_out(files, ("fit",), "targets")
    usage = "compensate EXPERIMENT fit.json TARGETS"
    fit = the_fit(given, usage)
    if len(given["targets"]) != 1:
        found = ", ".join(map(str, given["targets"])) or "none"
        raise InputError(Problem(f"one file of targets is corrected: {usage}", found=found))
    (targets,) = given["targets"]
    options = ProgrammeTexts(tuple(load or ()), tuple(keep or ()), tuple(tool or ()), tuple(frame or ()), start)
    run_compensate(CompensateFiles(experiment, fit, targets, output, json, report), reference, options, anyway)


def kinematics(
    experiment: ExperimentFile,
    fit: Annotated[Path, typer.Argument(help="fit.json, from qsf identify --json", show_default=False)],
    urdf: Annotated[Path | None, typer.Option(help="Write the URDF with corrected joint origins.")] = None,
    dh: Annotated[Path | None, typer.Option(help="Write the Denavit-Hartenberg table, YAML.")] = None,
    mdh: Annotated[Path | None, typer.Option(help="Write the modified table (Craig), YAML.")] = None,
    hayati: Annotated[
        Path | None, typer.Option(help="Write the table with a fifth number for nearly parallel axes, YAML.")
    ] = None,
    ur: Annotated[Path | None, typer.Option(help="Write the kinematics of the Universal Robots driver, YAML.")] = None,
    offsets: Annotated[
        Path | None, typer.Option(help="Write the joints' offsets, CSV; in motor counts where robot.yaml states them.")
    ] = None,
    json: Json = None,
    anyway: Anyway = False,
    trust: Trust = False,
) -> None:
    """Write the fitted kinematics for other programs and controllers."""
    from qsframework.cli.kinematics import run_kinematics

    asked = {"urdf": urdf, "dh": dh, "mdh": mdh, "hayati": hayati, "ur": ur}
    run_kinematics(experiment, fit, {k: path for k, path in asked.items() if path is not None}, offsets, json, anyway)


def certificate(
    experiment: Annotated[Path | None, typer.Argument(help="experiment.yaml", show_default=False)] = None,
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="FIT [READINGS]...",
            help="fit.json, and held-out readings (default: random halves of its own).",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The page, for A4: .html, or .pdf by Chromium.")
    ] = Path("certificate.html"),
    meta: Annotated[Path | None, typer.Option(help="meta.yaml: who, when, serial numbers, tolerance.")] = None,
    template: Annotated[Path | None, typer.Option(help="Write a meta.yaml to fill in, and nothing else.")] = None,
    halves: Annotated[
        int, typer.Option(help="Random halves, where no held-out readings are given.", min=1, max=1000)
    ] = 10,
    seed: Seed = 0,
    anyway: Annotated[
        bool,
        typer.Option("--anyway", help="Certify although a diagnosis found an unmodelled effect; the page says so."),
    ] = False,
    trust: Trust = False,
) -> None:
    """Certificate of a robot's accuracy, with its uncertainties."""
    from qsframework.cli.certificate import run_certificate, write_template
    from qsframework.errors import InputError

    if template is not None:
        write_template(template, [p for p in (experiment, *(files or ()), meta) if p is not None])
    elif experiment is None:
        raise InputError("qsf certificate EXPERIMENT fit.json [READINGS...], or --template meta.yaml")
    else:
        from qsframework.cli.kinds import sorted_out, the_fit

        given = sorted_out(files or (), ("fit",), "readings")
        fit = the_fit(given, "certificate EXPERIMENT fit.json [READINGS...], or --template meta.yaml")
        run_certificate(experiment, fit, given["readings"], output, meta, halves, seed, anyway)


def export(
    files: Annotated[
        list[Path], typer.Argument(metavar="EXPERIMENT PLAN", help="experiment.yaml and plan.csv.", show_default=False)
    ],
    to: Annotated[
        str,
        typer.Option(help="fanuc-ls, krl, rapid, urscript or csv.", show_default=False, rich_help_panel="Programme"),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="The file; krl makes .src and .dat.")],
    tool: Annotated[
        str, typer.Option(help="Number or name of the controller's tool (default: 1 or tool0).", show_default=False)
    ] = "",
    frame: Annotated[
        str, typer.Option(help="Number or name of its user frame (default: 0 or wobj0).", show_default=False)
    ] = "",
    order: Annotated[
        str, typer.Option(help="shortest path, random (separates drift), or as in the plan.", rich_help_panel="Motion")
    ] = "shortest",
    speed: Annotated[int, typer.Option(help="Joint speed, percent of the maximum.", min=1, max=100)] = 10,
    pause: Annotated[float, typer.Option(help="Wait at each pose, s.")] = 10.0,
    hold: Annotated[bool, typer.Option("--hold", help="Wait for the start button instead.")] = False,
    home: Annotated[
        str | None, typer.Option(help="Pendant angles where the path starts and ends, deg, or mm: J1,J2,...")
    ] = None,
    repeat_share: Annotated[
        float, typer.Option(help="Fraction of the poses visited twice, as in qsf protocol.", min=0, max=1)
    ] = 0.0,
    seed: Seed = 0,
    json: Json = None,
    trust: Trust = False,
) -> None:
    """Write a plan as a robot programme, checked for collisions."""
    from qsframework.cli.export import ExportOptions, run_export
    from qsframework.cli.kinds import sorted_out
    from qsframework.errors import InputError, Problem

    given = sorted_out(files, ("experiment",), "plan")
    if [len(found) for found in given.values()] != [1, 1]:
        raise InputError(Problem("an experiment and a plan are needed", found=" ".join(map(str, files))))
    ((experiment,), (plan,)) = given.values()
    options = ExportOptions(
        to=to,
        order=order,
        speed=speed,
        pause=None if hold else pause,
        home=home,
        seed=seed,
        repeat_share=repeat_share,
        tool=tool,
        frame=frame,
    )
    run_export(plan, experiment, output, options, json)


Order = Annotated[str, typer.Option(help="random (separates drift), shortest, or as in the plan.")]
Cycles = Annotated[int, typer.Option(help="Loadings at each visit.", min=1, max=100)]
RepeatShare = Annotated[float, typer.Option(help="Fraction of the poses visited twice.", min=0, max=1)]
Drive = Annotated[str, typer.Option(help="What holds the arm during a reading: servo or brake.")]
Reflectors = Annotated[int, typer.Option(help="Reflectors fixed to the floor.", min=0, max=100)]
Half = Annotated[bool, typer.Option(help="Also half the load at repeated poses, to test linearity.")]


def protocol(
    experiment: ExperimentFile,
    plan: Annotated[Path, typer.Argument(help="plan.csv", show_default=False)],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The sheet to print: .html, or .pdf by Chromium.")
    ] = Path("sheet.html"),
    readings: Annotated[Path, typer.Option(help="The table to fill in.")] = Path("readings.csv"),
    order: Order = "random",
    cycles: Cycles = 2,
    repeat_share: RepeatShare = 0.2,
    settle: Annotated[float, typer.Option(help="Wait before a reading, s.", min=0)] = 30.0,
    warm_up: Annotated[float, typer.Option(help="Warm-up, minutes.", min=0)] = 30.0,
    drive: Drive = "servo",
    reflectors: Reflectors = 3,
    half: Half = True,
    seed: Seed = 0,
    trust: Trust = False,
) -> None:
    """Write the measuring protocol: a sheet, and a table to fill in."""
    from qsframework.applications.protocol import ProtocolOptions
    from qsframework.cli.protocol import run_protocol

    options = ProtocolOptions(
        order=order,
        seed=seed,
        cycles=cycles,
        repeat_share=repeat_share,
        settle=settle,
        warm_up=warm_up,
        drive=drive,
        reflectors=reflectors,
        half=half,
    )
    run_protocol(experiment, plan, output, readings, options)


def day(
    experiment: ExperimentFile,
    plan: Annotated[Path, typer.Argument(help="plan.csv", show_default=False)],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The folder of the session; an existing one is resumed.")
    ] = Path("day"),
    watch: Annotated[
        Path | None, typer.Option(help="Read the tracker's exports from this folder instead of the page.")
    ] = None,
    port: Annotated[int, typer.Option(help="Port of the page; 0 takes any free one.", min=0)] = 8765,
    once: Annotated[bool, typer.Option("--once", help="With --watch: read what is there, then exit.")] = False,
    order: Order = "random",
    cycles: Cycles = 2,
    repeat_share: RepeatShare = 0.2,
    drive: Drive = "servo",
    reflectors: Reflectors = 3,
    half: Half = True,
    seed: Seed = 0,
    trust: Trust = False,
) -> None:
    """Run the measuring session; reports mistakes at once."""
    from qsframework.applications.protocol import ProtocolOptions
    from qsframework.cli.day import DayFiles, run_day

    options = ProtocolOptions(
        order=order,
        seed=seed,
        cycles=cycles,
        repeat_share=repeat_share,
        drive=drive,
        reflectors=reflectors,
        half=half,
    )
    run_day(DayFiles(experiment=experiment, plan=plan, folder=output, watch=watch), options, port, once)


def import_files(
    experiment: ExperimentFile,
    files: Annotated[
        list[Path],
        typer.Argument(
            help="Point lists, and a joint log: CSV, text or Excel, as they were exported.", show_default=False
        ),
    ],
    plan: Annotated[
        Path | None,
        typer.Option(
            "--plan", "-p", help="plan.csv, or the table to fill in of qsf protocol.", rich_help_panel="Files"
        ),
    ] = None,
    columns: Annotated[
        list[str] | None,
        typer.Option("--map", help="ROLE=COLUMN, such as x=Xcoord, or x=3 where columns have no names (repeat)."),
    ] = None,
    mapping: Annotated[Path | None, typer.Option(help="YAML with columns, units and names.")] = None,
    unit: Annotated[
        list[str] | None, typer.Option(help="Unit of columns that state none: mm, in, deg, ms (repeat).")
    ] = None,
    word: Annotated[
        list[str] | None, typer.Option(help="FOUND=MEANT in names, such as WITH=loaded or ball1=m1 (repeat).")
    ] = None,
    sheet: Annotated[str, typer.Option(help="Which sheet of a workbook.")] = "",
    separator: Annotated[
        str, typer.Option(help="Column separator: ',', ';', '|', tab or space (default: detected).")
    ] = "",
    decimal: Annotated[str, typer.Option(help="Decimal sign: '.' or ',' (default: detected).")] = "",
    match: Annotated[
        str, typer.Option(help="Match points by names, by order (of the plan) or nearest.", rich_help_panel="Points")
    ] = "names",
    join: Annotated[str | None, typer.Option(help="Match the joint log by names, by order or by time.")] = None,
    state: Annotated[str | None, typer.Option(help="State of points that carry none: unloaded or loaded.")] = None,
    series: Annotated[str, typer.Option(help="Name of the tracker's station.")] = "",
    ignore: Annotated[
        list[str] | None, typer.Option(help="Ignore these points, such as 'B*', or a column (repeat).")
    ] = None,
    clock: Annotated[float, typer.Option(help="Seconds by which the log's clock is ahead of the tracker's.")] = 0.0,
    align: Annotated[
        str, typer.Option(help="Tracker to base: from the 'unloaded' readings, or a file of known points, base frame.")
    ] = "",
    within: Annotated[float, typer.Option(help="Largest distance of a point from its predicted place, mm.")] = 50.0,
    output: Annotated[Path, typer.Option("-o", "--output", help="The readings.", rich_help_panel="Output")] = Path(
        "readings.csv"
    ),
    look: Annotated[bool, typer.Option("--look", help="Show the column mapping, and write nothing.")] = False,
    json: Json = None,
    trust: Trust = False,
) -> None:
    """Convert a tracker's export into readings."""
    from qsframework.applications.importers import ImportOptions
    from qsframework.cli.importing import ImportFiles, columns_of, run_import, words_of

    options = ImportOptions(
        columns=columns_of(columns or ()),
        units=tuple(unit or ()),
        names=words_of(word or ()),
        match=match,
        join=join or "",
        state=state or "",
        series=series,
        ignore=tuple(ignore or ()),
        sheet=sheet,
        separator=separator,
        decimal=decimal,
        clock=clock,
        align=align,
        within=1e-3 * within,
    )
    paths = ImportFiles(
        experiment=experiment,
        files=tuple(files),
        plan=plan,
        mapping=mapping,
        output=output,
        json=json,
        look=look,
    )
    run_import(paths, options)


def compare(
    robots: Annotated[list[str], typer.Argument(help="Two or more robots, by name or folder.", show_default=False)],
    task: Annotated[Path, typer.Option(help="task.yaml: path, map and campaign.", show_default=False)],
    fit: Annotated[list[str] | None, typer.Option(help="ROBOT=fit.json: its identified values.")] = None,
    jobs: Jobs = 1,
    dask: DaskAddress = None,
    seed: Seed = 0,
    json: Json = None,
    report: Report = None,
    anyway: Anyway = False,
    trust: Trust = False,
) -> None:
    """Compare robots: deflection, and predicted uncertainty."""
    from qsframework.cli.compare import run_compare
    from qsframework.work import Work

    run_compare(robots, task, seed, json, report, fit or (), Work(jobs, dask), anyway)


def new(
    name: Annotated[str, typer.Argument(help="The robot's name.", show_default=False)],
    urdf: Annotated[Path | None, typer.Option(help="Its URDF or xacro.")] = None,
    dh: Annotated[
        Path | None, typer.Option(help="Instead of a URDF, a table: a_mm, alpha_deg, d_mm, theta_deg.")
    ] = None,
    modified: Annotated[bool, typer.Option("--modified", help="The table is the modified one (Craig).")] = False,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Folder to make (default: the name).")] = None,
    base: Annotated[str | None, typer.Option(help="Fixed link (default: the root).")] = None,
    flange: Annotated[str | None, typer.Option(help="Link that carries the tool.")] = None,
    payload: Annotated[float | None, typer.Option(help="Its payload, kg, from the manual.")] = None,
    package: Annotated[list[str] | None, typer.Option(help="NAME=FOLDER of a package that it names.")] = None,
    arg: Annotated[list[str] | None, typer.Option(help="NAME=VALUE for a xacro's $(arg NAME).")] = None,
) -> None:
    """Make and test a robot's folder from a URDF or a table."""
    from qsframework.cli.new import run_new
    from qsframework.cli.pairs import pairs
    from qsframework.robot.new import Arm

    arm = Arm(
        base=base,
        flange=flange,
        payload=payload,
        packages={key: Path(value) for key, value in pairs("--package", package or (), "NAME=FOLDER").items()},
        arguments=pairs("--arg", arg or (), "NAME=VALUE"),
        modified=modified,
    )
    run_new(name, urdf, dh, output, arm)


def add_commands(app: typer.Typer) -> None:
    """Register the commands."""
    for command in (compensate, kinematics, certificate, export, protocol, day, import_files, compare, new):
        app.command("import" if command is import_files else None, cls=Command)(command)
