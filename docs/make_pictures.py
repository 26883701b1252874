"""Make pictures in headless Chromium: report, `qsf show`, sheet, certificate and the robots for the pages; and, into
build/pictures, every report 1400 and 400 pixels wide and in print, and a session in a terminal.

Run: make pictures
"""

from __future__ import annotations

import csv
import html
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from every_report import COMMANDS, make_reports

from qsframework import design, show
from qsframework.experiment import load_experiment, read_readings
from qsframework.fits import identify
from qsframework.report.printed import write_page
from qsframework.robot import load_robot

HERE = Path(__file__).resolve().parent
EXPERIMENT = HERE.parent / "examples" / "m900ib" / "experiment.yaml"
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--virtual-time-budget=15000",
    "--hide-scrollbars",
)


def screenshot(page: Path | str, picture: Path, size: str, at: str = "") -> None:
    """Save what Chromium shows of a page, or of the place #at in it, in a window of a size such as 1060,1500."""
    picture.parent.mkdir(exist_ok=True, parents=True)
    with tempfile.TemporaryDirectory() as profile:
        subprocess.run(
            [
                "chromium",
                *FLAGS,
                f"--window-size={size}",
                f"--user-data-dir={profile}",
                f"--screenshot={picture}",
                (page if isinstance(page, str) else page.as_uri()) + at,
            ],
            check=True,
            capture_output=True,
        )


def qsf(*arguments: str) -> None:
    """Run a command of qsf."""
    command = str(Path(sys.executable).with_name("qsf"))  # of this environment, on the path or not
    subprocess.run([command, *arguments], check=True, capture_output=True)


CAMPAIGN = """robot: {robot}
load: {{point_mm: [300, 0, 200]}}
markers: {{m1: {{xyz_mm: [200, 200, 100]}}, m2: {{xyz_mm: [-200, 100, 100]}}}}
noise: {{sigma_mm: 0.03}}
loads: [{{name: weight, fz_N: {down:.0f}, fy_N: {side:.0f}}}]
constraints: {{of: flange, z_min_m: 0.3}}
"""
AT = {"abb_irb760": "#4"}
"""The pose of a robot's plan that its picture shows; the second of others."""


def picture_of(robot: str, at: str, images: Path) -> None:
    """One pose of a small plan for a robot, in 3D."""
    with tempfile.TemporaryDirectory() as name:
        experiment, plan, page = (Path(name) / file for file in ("experiment.yaml", "plan.csv", "show.html"))
        weight = 9.81 * (load_robot(robot).payload or 50.0)
        experiment.write_text(CAMPAIGN.format(robot=robot, down=-0.8 * weight, side=0.2 * weight))
        qsf("design", str(experiment), "-n", "6", "--candidates", "200", "--output", str(plan))
        qsf("show", str(experiment), str(plan), "--html", str(page))
        screenshot(page, images / f"{robot}.png", "800,560", at)


META = """calibration: {number: "2026-014", date: 2026-11-20, place: Hall 3, operator: A. Surveyor}
robot: {maker: Universal Robots, type: UR10, serial_number: "2015301234"}
instrument: {type: laser tracker with a 6D target, uncertainty_mm: 0.06}
tolerance_mm: 0.75
"""
"""Made up, but for the type of the instrument; the readings are real."""


def certificate(images: Path) -> None:
    """The first sheet of a certificate of the UR10, extended by what its readings name."""
    with tempfile.TemporaryDirectory() as name:
        meta, fit, page = (Path(name) / f for f in ("meta.yaml", "fit.json", "certificate.html"))
        meta.write_text(META)
        experiment = str(HERE.parent / "examples" / "ur10" / "experiment.yaml")
        for extended in (Path(name) / "extended", Path(name) / "again"):  # until the readings name nothing more
            qsf("diagnose", experiment, "--extend", str(extended))
            experiment = str(extended / "experiment.yaml")
        qsf("identify", experiment, "--json", str(fit))
        qsf("certificate", experiment, str(fit), "--halves", "3", "--meta", str(meta), "-o", str(page))
        screenshot(page, images / "certificate.png", "900,1300")


def measuring_day(images: Path) -> None:
    """The page of a day whose last state is to be looked at again."""
    example = HERE.parent / "examples" / "day"
    with tempfile.TemporaryDirectory() as name:
        day = ["day", str(example / "experiment.yaml"), str(example / "plan.csv"), "-o", f"{name}/day"]
        day += ["--cycles", "1", "--no-half", "--repeat-share", "0"]
        qsf(*day, "--watch", str(example / "exports"), "--once")
        command = [str(Path(sys.executable).with_name("qsf")), *day, "--port", "0"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
            assert server.stdout is not None
            address = next(line.split()[0] for line in server.stdout if line.startswith("http"))
            screenshot(address, images / "day.png", "1200,1180")
            server.terminate()


WALK = (1.0, 50.0, 100.0)
"""Magnifications at which each pose of the moving picture is seen."""
MILLISECONDS = (250, 250, 900)
"""How long each of them stands."""


def walk(images: Path) -> None:
    """The M-900iB sags under the load at each pose of a plan, 100 times enlarged: a moving picture below 1 MB."""
    from PIL import Image

    experiment = load_experiment(EXPERIMENT)
    plan, frames = design(experiment, 8, candidates=400, seed=1), list[Image.Image]()
    with tempfile.TemporaryDirectory() as name:
        picture = Path(name) / "frame.png"
        pages = [Path(name) / f"{scale:g}.html" for scale in WALK]
        for page, scale in zip(pages, WALK, strict=True):
            page.write_text(show(experiment, plan, scale=scale).html())
        for pose in range(1, 9):
            for page in pages:
                screenshot(page, picture, "560,400", f"#{pose}")
                frames.append(Image.open(picture).convert("RGB").crop((0, 0, 560, 326)).quantize(64))
    first, *others = frames
    first.save(images / "walk.gif", save_all=True, append_images=others, duration=[*MILLISECONDS] * 8, loop=0)


SESSION = """qsf robots
qsf check gp18
qsf check fanuc_m900ib {experiment}
qsf design {experiment} -n 12 --candidates 400 -o plan.csv
qsf show {experiment} plan.csv --html scene.html
qsf protocol {experiment} plan.csv -o sheet.html --readings table.csv
qsf simulate {experiment} plan.csv --truth drawn --seed 1 -o readings.csv
qsf identify {experiment} readings.csv --json fit.json
qsf identify {real}
qsf validate {experiment} readings.csv fit.json
qsf stiffness fanuc_m900ib --pose 0,20,-10,30,40,0 --load 0,0,-4000 --point 150,0,200
qsf compensate {experiment} fit.json {targets} -o corrected.csv
qsf export {experiment} plan.csv --to fanuc-ls --hold -o campaign.ls
qsf diagnose {hidden}
qsf diagnose {hidden} plan.csv
qsf diagnose {ur10} --extend extended
qsf diagnose extended/experiment.yaml --extend again
qsf identify again/experiment.yaml --json positions.json
qsf kinematics again/experiment.yaml positions.json --urdf corrected.urdf --offsets offsets.csv
qsf certificate again/experiment.yaml positions.json --halves 3 -o certificate.html
qsf day {day} {day_plan} -o session --cycles 1 --no-half --repeat-share 0 --watch {exports} --once
qsf import {ur10} {tracker} --mapping {mapping} --series D -o ur10.csv
qsf compare fanuc_m900ib fanuc_r2000ic --task {task}
qsf new arm --urdf {urdf} -o arm
qsf demo -o demo
qsf --help
"""
"""What a user types in a campaign, with every verb, and what then stands in the terminal."""
EXAMPLES = {
    "experiment": "examples/m900ib/experiment.yaml",
    "real": "examples/r2000ic/experiment.yaml",
    "targets": "examples/m900ib/targets.csv",
    "hidden": "examples/hidden_effect/experiment.yaml",
    "ur10": "examples/ur10/experiment.yaml",
    "tracker": "examples/ur10/tracker.csv",
    "mapping": "examples/ur10/mapping.yaml",
    "day": "examples/day/experiment.yaml",
    "day_plan": "examples/day/plan.csv",
    "exports": "examples/day/exports",
    "task": "examples/compare/task.yaml",
    "urdf": "robots/kuka_kr500_r2800_2/kuka_kr500_r2800_2.urdf.xacro",
}


def typed(folder: Path, columns: int) -> dict[str, list[str]]:
    """The lines of a terminal of so many columns, by the verb, each command after its prompt; run in a folder."""
    for name in ("examples", "robots"):
        (folder / name).symlink_to(HERE.parent / name)
    environment = {**os.environ, "COLUMNS": str(columns)}
    out: dict[str, list[str]] = {}
    for command in SESSION.splitlines():
        words = [str(Path(sys.executable).with_name("qsf")), *command.format(**EXAMPLES).split()[1:]]
        run = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True)
        lines = out.setdefault(words[1].lstrip("-"), [])
        lines += [f"$ {command.format(**EXAMPLES)}"]
        lines += [*(run.stdout + run.stderr).splitlines(), ""]
    return out


def terminal(pictures: Path, columns: int) -> None:
    """Each verb in a terminal of so many columns, as a picture; a line that is wider runs over the edge, in red."""
    style = f"pre {{ font: 14px/18px monospace; width: {columns}ch; background: #fafafa; }} b {{ color: #b00; }}"
    with tempfile.TemporaryDirectory() as name:
        for verb, lines in typed(Path(name), columns).items():
            shown = "\n".join(
                f"<b>{html.escape(line)}</b>" if len(line) > columns and line[:1] != "$" else html.escape(line)
                for line in lines
            )
            page = Path(name) / "terminal.html"
            page.write_text(f'<!DOCTYPE html><meta charset="utf-8"><style>{style}</style><pre>{shown}</pre>')
            picture = pictures / f"terminal_{columns}_{verb}.png"
            screenshot(page, picture, f"{9 * columns + 40},{18 * len(lines) + 60}")


PANEL = """<div><h2>{title}</h2><svg viewBox="-60 -20 460 400" width="460" height="400">{drawn}
<text x="170" y="375">{below}</text><text transform="rotate(-90)" x="-170" y="-42">{left}</text></svg></div>"""
OVERVIEW = """<!DOCTYPE html><meta charset="utf-8"><style>body {{ display: flex; gap: 16px; margin: 12px;
background: #fff; font: 15px sans-serif }}
h2 {{ font-size: 18px; margin: 0 0 6px }} text {{ font-size: 14px; text-anchor: middle }}
div {{ flex: none }}</style><div><h2>1. Plan: where to measure</h2><img src="{scene}" width="500"></div>{panels}"""


def overview(folder: Path, images: Path) -> None:
    """The README's picture: a plan in 3D, measured against predicted displacements, targets before and after."""
    experiment = load_experiment(HERE.parent / "examples" / "r2000ic" / "experiment.yaml")
    readings = read_readings(experiment.data, experiment)
    measured = 1e3 * readings.value.ravel()
    predicted = measured - 1e3 * identify(experiment, readings).residuals.ravel()
    low, high = (float(f([measured, predicted])) for f in (np.min, np.max))
    x, y = (340 * (v - low) / (high - low) for v in (measured, predicted))
    drawn = '<path d="M0 340L340 0" stroke="#999"/><path d="M0 0V340H340" fill="none" stroke="#333"/>' + "".join(
        f'<circle cx="{a:.1f}" cy="{340 - b:.1f}" r="3.5" fill="#0a6c74" fill-opacity="0.6"/>'
        for a, b in zip(x, y, strict=True)
    )
    drawn += "".join(f'<text x="{at}" y="357">{v:.1f}</text>' for at, v in ((8, low), (332, high)))
    fitted = PANEL.format(
        title="2. Fit: 43 real cable pulls, R-2000iC", drawn=drawn, below="measured, mm", left="predicted, mm"
    )
    with (folder / "corrected.csv").open() as lines:
        rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    bars = '<path d="M0 0V340H340" fill="none" stroke="#333"/>'
    for k, row in enumerate(rows):
        sizes = (float(row[name]) for name in ("uncorrected_mm", "by_load_mm", "expected_error_mm"))
        for at, mm, colour in zip((0, 34, 68), sizes, ("#b4502c", "#d9a441", "#0a6c74"), strict=True):
            left, top = 12 + 112 * k + at, 340 - 95 * mm
            bars += f'<path d="M{left} 340V{top:.1f}h30V340z" fill="{colour}"/><text x="{left + 15}" y="{top - 5:.1f}">'
            bars += f"{mm:.2g}</text>"
        bars += f'<text x="{60 + 110 * k}" y="357">{row["target"]}</text>'
    corrected = PANEL.format(
        title="3. Use: targets before and after (simulated)",
        drawn=bars,
        below="M-900iB/700, 4 kN: uncorrected; the part by the load; corrected",
        left="mm",
    )
    page = folder / "overview.html"
    page.write_text(OVERVIEW.format(scene=(images / "show.png").as_uri(), panels=fitted + corrected))
    screenshot(page, images / "overview.png", "1500,470")


def every_page(pictures: Path) -> None:
    """Every report as a wide and a narrow window show it, and as it is printed."""
    with tempfile.TemporaryDirectory() as name:
        made = make_reports(Path(name))
        for command in COMMANDS:
            page = made.folder / f"{command}.html"
            screenshot(page, pictures / f"{command}_1400.png", "1400,2400")
            narrow = made.folder / "narrow.html"  # no window is narrower than 500 pixels; a frame is
            narrow.write_text(f'<body style="margin: 0"><iframe src="{page.name}" width="400" height="3990"></iframe>')
            screenshot(narrow, pictures / f"{command}_400.png", "500,4000")
            write_page(pictures / f"{command}.pdf", page.read_text())


def main(images: Path = HERE / "images") -> None:
    """Design twelve poses for the M-900iB; picture report, plan in 3D, sheet; a certificate; and every robot."""
    walk(images)
    certificate(images)
    measuring_day(images)
    for robot in sorted(path.parent.name for path in (HERE.parent / "robots").glob("*/robot.yaml")):
        picture_of(robot, AT.get(robot, "#2"), images)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        plan = str(folder / "plan.csv")
        qsf("design", str(EXPERIMENT), "--output", plan, "--report", str(folder / "plan.html"))
        qsf("show", str(EXPERIMENT), plan, "--html", str(folder / "show.html"))
        sheet = folder / "sheet.html"
        qsf("protocol", str(EXPERIMENT), plan, "-o", str(sheet), "--readings", str(folder / "readings.csv"))
        screenshot(folder / "plan.html", images / "report.png", "1060,1960")
        screenshot(folder / "show.html", images / "show.png", "1000,680", "#5")
        readings, fit = str(folder / "readings.csv"), str(folder / "fit.json")
        qsf("simulate", str(EXPERIMENT), plan, "--truth", "drawn", "--seed", "1", "-o", readings)
        qsf("identify", str(EXPERIMENT), readings, "--json", fit)
        targets = str(EXPERIMENT.parent / "targets.csv")
        qsf("compensate", str(EXPERIMENT), fit, targets, "-o", str(folder / "corrected.csv"))
        overview(folder, images)
        cell = str(EXPERIMENT.parents[1] / "r2000ic" / "in_cell.yaml")
        qsf("design", cell, "-n", "8", "--candidates", "300", "--output", plan)
        qsf("show", cell, plan, "--html", str(folder / "cell.html"))
        screenshot(folder / "cell.html", images / "cell.png", "1000,680", "#6")
        visits = sheet.read_text().replace("</style>", "section:not(.load), h1, .fill { display: none }</style>")
        sheet.write_text(visits)
        screenshot(sheet, images / "sheet.png", "760,1000")


if __name__ == "__main__":
    for width in (80, 100):
        terminal(HERE.parent / "build" / "pictures", width)
    every_page(HERE.parent / "build" / "pictures")
    main()
