"""Reports are whole, need no network, and escape what users wrote."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from headless import SMALL, browser, console, open_page, unpacked

from qsframework.cli.demo import WRITTEN, run_demo
from qsframework.experiment import Experiment, make_plan
from qsframework.plugin import Poses
from qsframework.report import Figure, ReportTable, SceneView, Section, Text, write_report
from qsframework.report.plots import blank
from qsframework.viz import Scene, show_scene

EVIL = "<script>alert(1)</script>"


class Page(HTMLParser):
    """Collects tags, ids, links and addresses that a browser would load."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.ids: set[str] = set()
        self.anchors: list[str] = []
        self.loads: list[str] = []
        self.frames: list[str] = []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        found = dict(attributes)
        self.tags.append(tag)
        self.ids.add(found.get("id") or "")
        if tag == "a":
            self.anchors.append(found.get("href") or "")
        if tag in ("script", "img", "link", "iframe"):
            self.loads += [found[k] or "" for k in ("src", "href") if k in found]
        if tag == "iframe":
            self.frames.append(unpacked(found.get("data-page") or ""))


def parse(path: Path) -> Page:
    page = Page()
    page.feed(path.read_text())
    return page


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("demo")
    run_demo(folder, 1)
    return folder


def test_the_demo_report_is_whole(demo: Path) -> None:
    page = parse(demo / "report.html")
    assert page.tags.count("table") >= 12
    assert page.tags.count("iframe") == 2
    assert len(re.findall("plotly-graph-div", (demo / "report.html").read_text())) >= 4
    assert all(a.startswith("#") and a[1:] in page.ids for a in page.anchors)
    assert page.loads == []
    text = (demo / "report.html").read_text()
    for number in ("1.725", "0.372", "0.406", "0.495", "0.535", "0.310"):
        assert number in text
    card = text.index('<section class="verdict good"')
    assert card < text.index("Calibrated</p>") < text.index("where the errors are")
    for words in ("joint_compliance[joint_1]", "initial", "correlated above 0.7", "efficiency", "SHA-256"):
        assert words in text


def test_the_scene_inside_loads_nothing(demo: Path) -> None:
    frames = parse(demo / "report.html").frames
    assert len(frames) == 2
    for frame in frames:
        inner = Page()
        inner.feed(frame)
        assert inner.loads == []
        assert frame.count("handle_command_bytearray") >= 1


def test_the_demo_leaves_its_files(demo: Path) -> None:
    names = {p.name for p in demo.iterdir()}
    assert names == set(WRITTEN)


def test_text_is_escaped(tmp_path: Path) -> None:
    section = Section(
        EVIL,
        (
            Text(EVIL),
            ReportTable((EVIL,), ((EVIL,),), EVIL),
            SceneView(f"<p>{EVIL}</p>", EVIL, ReportTable((EVIL,), ())),
        ),
    )
    page = parse(write_report(tmp_path / "r.html", EVIL, [section]))
    assert page.tags.count("script") == 1  # the report's own


def test_a_long_campaign_makes_a_page_that_opens(tmp_path: Path) -> None:
    """Of a long series the highest and lowest points are drawn, of a long table the first rows; both say so, and the
    figure that was given stays whole."""
    count = 50_000
    heights = np.sin(np.arange(count) / 500.0)
    heights[31_234], heights[777] = 9.0, -9.0
    plot = blank("long", "row", "mm")
    plot.add_scatter(x=np.arange(count), y=heights, customdata=[f"p{i}" for i in range(count)], mode="markers")
    table = ReportTable(("row",), tuple((str(i),) for i in range(count)))
    page = write_report(tmp_path / "r.html", "t", [Section("s", (Figure(plot, "Look.", table), table))]).read_text()
    drawn = json.loads(
        re.findall(r'<script type="application/json" id="figure-0-0-data">(.*?)</script>', page, re.S)[0]
    )
    names = drawn["data"][0]["customdata"]
    assert {"p31234", "p777"} < set(names)
    assert len(names) <= 4000
    assert "Of 50000 points the highest and lowest of each stretch are drawn" in page
    assert page.count("The first 2000 of 50000 rows.") == 2
    assert len(plot.data[0].y) == count


def test_scene_titles_and_labels_are_escaped() -> None:
    scene = Scene(title=EVIL)
    scene.step("pose", EVIL)
    html = scene.html()
    assert EVIL not in html


def plan_page(experiment: Experiment, path: Path) -> Path:
    import numpy as np

    pendant = np.deg2rad([[0.0, 20.0, -10.0, 0.0, 40.0, 0.0]])
    poses = Poses(pendant, experiment.robot.controller.to_joints(pendant), np.array([[0, 0, -4000.0, 0, 0, 0]]))
    path.write_text(show_scene(experiment, make_plan(poses, ["weight"])).html())
    return path


@browser
def test_a_browser_shows_the_robot(m900ib: Experiment, tmp_path: Path) -> None:
    """Yellow pixels of the arm against an empty scene; nothing on the console, no request."""
    import numpy as np
    from PIL import Image

    (tmp_path / "empty.html").write_text(Scene(title="empty").html())
    pages = {"robot": plan_page(m900ib, tmp_path / "robot.html"), "empty": tmp_path / "empty.html"}
    yellow = {}
    for name, page in pages.items():
        said = console(open_page(page, tmp_path, SMALL, f"--screenshot={tmp_path / name}.png").stderr)
        assert not [line for line in said if "rror" in line], said
        pixels = np.asarray(Image.open(tmp_path / f"{name}.png").convert("RGB")).astype(int)
        yellow[name] = int(((pixels[..., 0] - pixels[..., 2]) > 80).sum())
    assert yellow["empty"] < 200  # the green axis of the grid
    assert yellow["robot"] > 2000
