"""Every command's report: figures with a sentence and numbers, where it comes from, whole, offline, printable."""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import re
import shutil
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from headless import NO_HOST, browser, console, open_page
from typer.testing import CliRunner

from qsframework.cli.main import app
from qsframework.experiment import example, load_experiment
from qsframework.plugin.registry import registry
from qsframework.robot.loader import find_robot
from qsframework.viz import Scene

EXPERIMENT = example("m900ib") / "experiment.yaml"
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
SEEDED = {"demo", "design", "simulate", "diagnose", "foresee", "compare", "validate"}
PLAIN = {"validate"}
"""Reports without a pose to be seen in 3D."""


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


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> Reports:
    """All commands with small inputs, each with a report."""
    folder = tmp_path_factory.mktemp("reports")
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
    out.run("identify", "identify", EXPERIMENT, "--data", readings, "--json", fit, reads=[*campaign, readings])
    unseen = folder / "unseen.csv"
    CliRunner().invoke(app, ["simulate", str(EXPERIMENT), str(plan), "--seed", "5", "-o", str(unseen)])
    out.run("validate", "validate", EXPERIMENT, fit, unseen, reads=[*campaign, fit, unseen])
    out.run("identify_positions", "identify", states, reads=[states, *load_experiment(states).data])
    out.run("diagnose", "diagnose", EXPERIMENT, readings, reads=[*campaign, readings])
    out.run("foresee", "diagnose", EXPERIMENT, "--plan", plan, reads=[*campaign, plan])
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
    task = EXPERIMENT.parents[1] / "compare" / "task.yaml"
    out.run("compare", "compare", "fanuc_m900ib", "abb_irb2400", "--task", task, reads=[*robot, task])
    return out


class Page(HTMLParser):
    """The order of figures, captions and tables; links and what they lead to; what would be loaded."""

    def __init__(self) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.frames: list[str] = []
        self.titles: list[str] = []
        self.figures: list[dict[str, int | str]] = []
        self._in = ""

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        found = dict(attributes)
        self.ids.add(found.get("id") or "")
        if tag == "a":
            self.links.append(found.get("href") or "")
        if tag in ("script", "img", "link", "iframe", "source", "object"):
            self.loads += [found[k] or "" for k in ("src", "href", "data") if k in found]
        if tag == "iframe":
            self.frames.append(found.get("srcdoc") or "")
        if tag == "figure":
            self.figures.append({"caption": "", "rows": 0, "drawn": 0})
        if self.figures and (tag == "iframe" or "plotly-graph-div" in (found.get("class") or "")):
            self.figures[-1]["drawn"] = 1
        if tag == "tr" and self._in == "details" and self.figures:
            self.figures[-1]["rows"] = int(self.figures[-1]["rows"]) + 1
        self._in = {"figcaption": "figcaption", "details": "details", "h2": "h2"}.get(tag, self._in)

    def handle_endtag(self, tag: str) -> None:
        if tag == self._in:
            self._in = ""

    def handle_data(self, data: str) -> None:
        if self._in == "figcaption":
            self.figures[-1]["caption"] = f"{self.figures[-1]['caption']}{data}"
        if self._in == "h2":
            self.titles.append(data)


def parse(text: str) -> Page:
    page = Page()
    page.feed(text)
    return page


def test_these_are_all_commands_with_a_report() -> None:
    """A new command with --report must come into the list above."""
    import typer

    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    with_report = {name for name, c in commands.items() if any("--report" in p.opts for p in c.params)}
    assert with_report | {"demo"} == {c.partition("_")[0] for c in COMMANDS} - {"foresee"}


@pytest.mark.parametrize("name", COMMANDS)
def test_every_figure_has_its_sentence_and_its_numbers(reports: Reports, name: str) -> None:
    page = parse(reports.text(name))
    for figure in page.figures:
        assert figure["drawn"] == 1
        assert len(str(figure["caption"]).split()) >= 8, figure
        assert "Look" in str(figure["caption"]) or "look" in str(figure["caption"]), figure["caption"]
        assert int(figure["rows"]) >= 2, figure  # a header and a row
    drawn = len(re.findall(r'class="plotly-graph-div"', reports.text(name))) + len(page.frames)
    assert drawn == len(page.figures)
    assert drawn >= 1


@pytest.mark.parametrize("name", COMMANDS)
def test_every_report_says_how_it_was_computed(reports: Reports, name: str) -> None:
    text = reports.text(name)
    own = text.rpartition("How this was computed</h2>")[2]
    assert importlib.metadata.version("qsframework") in own
    assert ("come from seed" in own) == (name in SEEDED)
    for path in reports.inputs[name]:
        assert hashlib.sha256(path.read_bytes()).hexdigest() in own, path.name
    cells = re.findall(r"<td[^>]*>([^<]*)</td>", own)
    used = [kind for effect, kind in registry().items() if effect in cells]
    assert used, "no effect of the model is told"
    import html

    said = {html.unescape(cell) for cell in cells}
    for kind in used:
        assert kind.equation in said, kind
        assert kind.source in said, kind


def test_every_effect_has_an_equation_and_a_source() -> None:
    for kind in registry().values():
        assert len(kind.equation) > 5, kind
        assert len(kind.source) > 5, kind


@pytest.mark.parametrize("name", COMMANDS)
def test_every_report_is_whole_and_loads_nothing(reports: Reports, name: str) -> None:
    page = parse(reports.text(name))
    assert page.links
    assert all(link.startswith("#") and link[1:] in page.ids for link in page.links)
    assert page.loads == []
    assert bool(page.frames) == (name not in PLAIN)
    for frame in page.frames:
        assert parse(frame).loads == []
    assert "@media print" in reports.text(name)


def test_the_demo_as_json(reports: Reports) -> None:
    found = json.loads((reports.folder / "demo.json").read_text())
    assert {"report", "seed", "real_readings", "designed_plan"} <= set(found)
    assert len(found["real_readings"]) == 3


_PROBE = """<script>addEventListener("load", () => setTimeout(async () => {
  dispatchEvent(new Event("beforeprint"));
  await new Promise(done => setTimeout(done, 1500));
  const plots = [...document.querySelectorAll(".js-plotly-plot")];
  document.title = JSON.stringify({
    widths: plots.map(p => p.querySelector(".main-svg").getBoundingClientRect().width),
    closed: document.querySelectorAll("details.printed:not([open])").length,
    asked: performance.getEntriesByType("resource").filter(r => !/^(data|blob|about):/.test(r.name)).map(r => r.name),
  });
}, 1500))</script></body>"""


@browser
@pytest.mark.parametrize("name", COMMANDS)
def test_a_browser_has_no_complaint(reports: Reports, name: str, tmp_path: Path) -> None:
    """No error on the console, no request to anywhere (every name resolves to nothing), and it prints uncut."""
    page = tmp_path / "report.html"
    page.write_text(reports.text(name).rpartition("</body>")[0] + _PROBE)
    run = open_page(page, tmp_path, NO_HOST, "--dump-dom", "--window-size=1000,800", timeout=240)
    said = console(run.stderr)
    assert not said, said
    found = json.loads(run.stdout.split("<title>")[1].split("</title>")[0])
    assert found["asked"] == []
    assert found["closed"] == 0
    assert len(found["widths"]) == len(re.findall(r'class="plotly-graph-div"', reports.text(name)))
    assert all(width <= 700 for width in found["widths"])  # the text of an A4 page is about 718 wide


@browser
def test_the_robot_is_to_be_seen_in_a_report(reports: Reports, tmp_path: Path) -> None:
    """The scene inside the report against the same report with an empty scene inside."""
    import html

    from PIL import Image

    text = reports.text("stiffness")
    (frame,) = re.findall(r'srcdoc="([^"]*)"', text)
    scene = html.escape(Scene(title="empty").html(), quote=True)
    pixels = []
    for name, page in (("robot", text), ("empty", text.replace(frame, scene))):
        file = tmp_path / f"{name}.html"
        file.write_text(page)
        picture = f"--screenshot={tmp_path / name}.png"
        open_page(file, tmp_path, NO_HOST, picture, "--window-size=1000,2600", "--hide-scrollbars", timeout=240)
        pixels.append(np.asarray(Image.open(tmp_path / f"{name}.png").convert("RGB")).astype(int))
    yellow = [int((p[..., 0] - p[..., 2] > 80).sum()) for p in pixels]
    assert yellow[0] > yellow[1] + 3000
    assert int((np.abs(pixels[0] - pixels[1]).max(axis=2) > 40).sum()) > 8000


def test_the_numbers_of_a_figure_are_those_of_its_traces() -> None:
    import plotly.graph_objects as go

    from qsframework.report.numbers import figure_table

    figure = go.Figure(layout={"xaxis": {"title": {"text": "x, m"}}, "yaxis": {"title": {"text": "y, mm"}}})
    figure.add_scatter(x=[1, 2], y=[3.0, None], name="<b>a</b>")
    assert figure_table(figure).rows == (("1", "3"), ("2", "-"))
    figure.add_bar(x=[1, 2], y=[5.0, 6.0], name="b")
    together = figure_table(figure)
    assert together.header[0] == "x, m"
    assert together.rows == (("1", "3", "5"), ("2", "-", "6"))
    figure.add_scatter(x=list(range(1000)), y=list(range(1000)), mode="lines", name="curve")
    apart = figure_table(figure)
    assert apart.header == ("series", "x, m", "y, mm")
    assert 30 < len([r for r in apart.rows if r[0] == "curve"]) <= 60
    assert "some of their points" in apart.caption
    heat = figure_table(go.Figure(go.Heatmap(x=["p", "q"], y=["r"], z=[[1.5, np.nan]])))
    assert heat.header == ("", "p", "q")
    assert heat.rows == (("r", "1.5", "-"),)
