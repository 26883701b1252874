"""Every command's report, from small inputs: what the tests read and `make pictures` shows."""

from __future__ import annotations

import shutil
from dataclasses import dataclass, field
from pathlib import Path

from typer.testing import CliRunner

from qsframework.cli.app import app
from qsframework.experiment import example
from qsframework.robot.search import find_robot

EXPERIMENT = example("m900ib") / "experiment.yaml"
TASK = EXPERIMENT.parents[1] / "compare" / "task.yaml"
COMMANDS = (
    "demo",
    "robots",
    "check",
    "check_states",
    "stiffness",
    "design",
    "simulate",
    "identify",
    "identify_positions",
    "validate",
    "diagnose",
    "foresee",
    "compensate",
    "compare",
)
PAGES = (*COMMANDS, "certificate", "sheet")


@dataclass
class Reports:
    """The folder of all reports; inputs: what each command read."""

    folder: Path
    inputs: dict[str, list[Path]] = field(default_factory=dict)

    def run(self, name: str, *arguments: str | Path, reads: list[Path] | None = None, option: str = "--report") -> None:
        where = [] if option == "" else [option, str(self.folder / f"{name}.html")]
        result = CliRunner().invoke(app, [*map(str, arguments), *where])
        assert result.exit_code == 0, (name, result.output, result.exception)
        self.inputs[name] = reads or []

    def text(self, name: str) -> str:
        return (self.folder / f"{name}.html").read_text()


def make_reports(folder: Path, task: Path = TASK) -> Reports:
    """All commands with small inputs, each with a report, a certificate and a sheet; task: that `qsf compare` reads."""
    out = Reports(folder)
    robot = [find_robot("fanuc_m900ib"), find_robot("fanuc_m900ib").parent / "nominal.yaml"]
    campaign = [EXPERIMENT, *robot]
    plan, readings, fit = folder / "plan.csv", folder / "readings.csv", folder / "fit.json"
    out.run("demo", "demo", "-o", folder, "--json", folder / "demo.json", option="")
    shutil.move(folder / "report.html", folder / "demo.html")
    out.inputs["demo"] = campaign
    out.run("robots", "robots", reads=robot)
    real, states = example("r2000ic") / "experiment.yaml", example("ur10") / "experiment.yaml"
    out.run("check", "check", "fanuc_m900ib", real, reads=[*robot, real, real.parent / "readings.csv"])
    out.run("check_states", "check", states, reads=[states])
    pose = ["--pose", "0,20,-10,0,40,0", "--load", "0,0,-4000"]
    out.run("stiffness", "stiffness", "fanuc_m900ib", *pose, reads=robot)
    out.run("design", "design", EXPERIMENT, "-n", "8", "--candidates", "120", "-o", plan, reads=campaign)
    out.run("simulate", "simulate", EXPERIMENT, plan, "-o", readings, "--truth", "drawn", reads=[*campaign, plan])
    out.run("identify", "identify", EXPERIMENT, readings, "--json", fit, reads=[*campaign, readings])
    unseen = folder / "unseen.csv"
    CliRunner().invoke(app, ["simulate", str(EXPERIMENT), str(plan), "--seed", "5", "-o", str(unseen)])
    out.run("validate", "validate", EXPERIMENT, fit, unseen, reads=[*campaign, fit, unseen])
    few, lines = folder / "states.csv", (states.parent / "series_d.csv").read_text().splitlines(keepends=True)
    few.write_text("".join([*lines[:3], *lines[3::6]]))
    out.run("identify_positions", "identify", states, few, reads=[states, few])
    out.run("diagnose", "diagnose", EXPERIMENT, readings, reads=[*campaign, readings])
    out.run("foresee", "diagnose", EXPERIMENT, plan, reads=[*campaign, plan])
    targets = folder / "targets.csv"
    targets.write_text("target,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,fx_N,fy_N,fz_N\na,0,20,-10,0,40,0,0,0,-4000\n")
    out.run(
        "compensate",
        "compensate",
        EXPERIMENT,
        fit,
        targets,
        "-o",
        folder / "corrected.csv",
        reads=[*campaign, fit, targets],
    )
    whole = ["certificate", EXPERIMENT, fit, readings, "--halves", "2", "-o", folder / "certificate.html"]
    out.run("certificate", *whole, option="")
    sheet = ["protocol", EXPERIMENT, plan, "-o", folder / "sheet.html", "--readings", folder / "blank.csv"]
    out.run("sheet", *sheet, option="")
    out.run("compare", "compare", "fanuc_m900ib", "abb_irb2400", "--task", task, reads=[*robot, task])
    return out
