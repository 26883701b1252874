"""How a report was computed: versions, seed, hashes of all files, equations and sources."""

from __future__ import annotations

import importlib.metadata
import platform
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from qsframework.files import sha256
from qsframework.plugin import Effect, Parameter
from qsframework.report.blocks import ReportTable, Section, Text
from qsframework.report.words.sizes import shown_number, unit_shown

if TYPE_CHECKING:
    from qsframework.experiment import Experiment
    from qsframework.robot import Robot

PROVENANCE = "How this was computed"
_PAPER = (
    "Symbols: see the documentation's page on the model. Klimchik et al.: Design of experiments for elastostatic "
    "calibration of heavy industrial robots with kinematic parallelogram and gravity compensator."
)
_PACKAGES = ("qsframework", "pin", "coal", "numpy", "scipy", "cvxpy", "clarabel", "plotly", "meshcat")
_SPEC = (".yaml", ".yml", ".urdf", ".xacro")

READING = ("reading of a displacement", "p_loaded - p_unloaded of a marker, base frame", "definition")
LINEAR = ("linear model", "eps = (diag(1/c) + K_par(q))^-1 D' w,  t = D eps", "Klimchik et al., (1)-(5), (10)")
EQUILIBRIUM = ("full equilibrium", "eps = C (D(eps)' w + tau_0(eps)), by Newton's iteration", "Klimchik et al., (17)")
LEAST_SQUARES = (
    "least squares",
    "c = argmin sum |reading - prediction|^2 / sigma^2,  cov = (sum A' A / sigma^2)^-1",
    "Klimchik et al., (2)-(4)",
)
INFORMATION = (
    "design",
    "cov = (sum over poses A_i' A_i / sigma^2)^-1; equivalence theorem for the relaxed design",
    "Kiefer, Wolfowitz 1960; Pukelsheim, Optimal Design of Experiments",
)
AFTER = (
    "error after compensation",
    "S cov S', S the derivative of the tip by the parameters",
    "first-order propagation",
)
STIFFNESS = ("Cartesian stiffness", "K_C = (D (K - H)^-1 D')^-1", "Klimchik et al., (18)")
Equation = tuple[str, str, str]
"""What it is for, the equation, where it is published."""


def provenance_section(
    effects: Sequence[Effect],
    files: Sequence[Path],
    seed: int | None,
    equations: Sequence[Equation] = (LINEAR,),
    parameters: Sequence[Parameter] = (),
    robots: Sequence[Robot] = (),
) -> Section:
    """What is needed to compute the report again.

    effects: those of the model; files: what the command read; seed None: nothing is random; equations of the command;
    parameters: nominal values with their sources; robots: their files are added to the others
    """
    versions = (("Python", platform.python_version()), *_versions())
    every = dict.fromkeys([*files, *(f for robot in robots for f in robot_files(robot))])
    hashes = tuple((path.name, sha256(path)) for path in every)
    random = (
        "Nothing is random here: the same files give the same numbers."
        if seed is None
        else (f"All random numbers come from seed {seed}: with it the same files give the same numbers.")
    )
    known = tuple(
        (p.name, f"{shown_number(p.nominal, p.unit)} {unit_shown(p.unit)}".strip(), p.source or "-")
        for p in parameters
        if p.nominal
    )
    nominal = ReportTable(
        ("parameter", "nominal", "source"), known, "Nominal values that are not zero, from the robot's files."
    )
    return Section(
        PROVENANCE,
        (
            Text(random),
            ReportTable(("equation of", "law", "source"), tuple(equations), _PAPER),
            ReportTable(
                ("effect", "where", "physics", "law", "source"), tuple(_laws(effects)), "The effects of the model."
            ),
            *((nominal,) if known else ()),
            ReportTable(("input file", "SHA-256"), hashes, "Other numbers come from other files."),
            ReportTable(("software", "version"), versions),
        ),
        folded=True,
    )


def robots_computed(robots: Sequence[Robot], files: Sequence[Path]) -> Section:
    """The provenance of what is told of robots, each named once, and of readings where files hold some."""
    robots = list({r.folder: r for r in robots}.values())
    parameters = [replace(p, name=f"{r.name}: {p.name}") for r in robots for p in r.parameters]
    return provenance_section([e for r in robots for e in r.effects], files, None, (READING,), parameters, robots)


def computed(
    experiment: Experiment, files: Sequence[Path], seed: int | None, equations: Sequence[Equation] = (LINEAR,)
) -> Section:
    """The section for an experiment: its model's effects and nominal values, its files and its robot's."""
    model = experiment.model()
    named = list(dict.fromkeys([experiment.path, *files]))
    robots = (experiment.robot,)
    return provenance_section(model.effects, named, seed, (READING, *equations), model.parameters, robots)


def robot_files(robot: Robot) -> list[Path]:
    """The files that describe a robot: everything in its folder that a robot.yaml may name."""
    return sorted(p for p in robot.folder.iterdir() if p.suffix in _SPEC and p.is_file())


def _versions() -> Iterator[tuple[str, str]]:
    for name in _PACKAGES:
        try:
            yield name, importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:  # what is not installed was not used
            continue


def _laws(effects: Sequence[Effect]) -> Iterator[tuple[str, ...]]:
    """One row for each kind of effect; third parties' may state neither law nor source."""
    for kind in dict.fromkeys(type(e) for e in effects):
        where = ", ".join(dict.fromkeys(e.where for e in effects if type(e) is kind and e.where))
        physics = (kind.__doc__ or "").split("\n")[0]
        yield kind.effect_name(), where or "-", physics, kind.equation or "-", kind.source or "-"
