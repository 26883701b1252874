"""The commands of `qsf` for work on the real robot. Each imports the library when it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from qsframework.cli.declared import Values
from qsframework.cli.files import CompensateFiles
from qsframework.cli.options import Anyway, DaskAddress, ExperimentFile, Jobs, Json, Report, Trust
from qsframework.option import Option, Seed
from qsframework.uses.options import ProgrammeOptions, Reference


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
    reference: Reference = "commanded",
    *,
    options: Annotated[Values, ProgrammeOptions],
    typed: Annotated[Values, CompensateFiles],
    anyway: Anyway = False,
    trust: Trust = False,
) -> None:
    """Correct targets for deflection under load."""
    from qsframework.cli.compensate import run_compensate
    from qsframework.cli.kinds import sorted_out, the_fit
    from qsframework.errors import InputError, Problem

    given = sorted_out(files, ("fit",), "targets")
    usage = "compensate EXPERIMENT fit.json TARGETS"
    fit = the_fit(given, usage)
    if len(given["targets"]) != 1:
        found = ", ".join(map(str, given["targets"])) or "none"
        raise InputError(Problem(f"one file of targets is corrected: {usage}", found=found))
    (targets,) = given["targets"]
    run_compensate(
        CompensateFiles(**typed, experiment=experiment, fit=fit, targets=targets), reference, options, anyway
    )


def kinematics(
    experiment: ExperimentFile,
    fit: Annotated[Path, typer.Argument(help="fit.json, from qsf identify --json", show_default=False)],
    urdf: Annotated[Path | None, Option("Write the URDF with corrected joint origins.")] = None,
    dh: Annotated[Path | None, Option("Write the Denavit-Hartenberg table, YAML.")] = None,
    mdh: Annotated[Path | None, Option("Write the modified table (Craig), YAML.")] = None,
    hayati: Annotated[
        Path | None, Option("Write the table with a fifth number for nearly parallel axes, YAML.")
    ] = None,
    ur: Annotated[Path | None, Option("Write the kinematics of the Universal Robots driver, YAML.")] = None,
    offsets: Annotated[
        Path | None, Option("Write the joints' offsets, CSV; in motor counts where robot.yaml states them.")
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
    output: Annotated[Path, Option("The page, for A4: .html, or .pdf by Chromium.", short="o")] = Path(
        "certificate.html"
    ),
    meta: Annotated[Path | None, Option("meta.yaml: who, when, serial numbers, tolerance.")] = None,
    template: Annotated[Path | None, Option("Write a meta.yaml to fill in, and nothing else.")] = None,
    halves: Annotated[int, Option("Random halves, where no held-out readings are given.", least=1, most=1000)] = 10,
    seed: Seed = 0,
    anyway: Annotated[
        bool,
        Option("Certify although a diagnosis found an unmodelled effect; the page says so."),
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


def compare(
    robots: Annotated[list[str], typer.Argument(help="Two or more robots, by name or folder.", show_default=False)],
    task: Annotated[Path, Option("task.yaml: path, map and campaign.", shown=False)],
    fit: Annotated[tuple[str, ...], Option("Its identified values.", form="ROBOT=fit.json")] = (),
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

    run_compare(robots, task, seed, json, report, fit, Work(jobs, dask), anyway)


COMMANDS = {
    "compensate": compensate,
    "kinematics": kinematics,
    "certificate": certificate,
    "compare": compare,
}
