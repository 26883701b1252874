"""Every command's report: figures with a sentence and numbers, where it comes from, whole, offline, printable,
light and dark."""

from __future__ import annotations

import hashlib
import importlib.metadata
import io
import json
import re
import zlib
from collections.abc import Iterator
from html.parser import HTMLParser
from importlib import resources

import numpy as np
import pytest
from chromium import Browser
from every_report import COMMANDS, PAGES, TASK, Reports, make_reports
from headless import browser, unpacked
from PIL import Image

from qsframework.cli.app import every_command
from qsframework.plugin.registry import registry

SEEDED = {"demo", "design", "simulate", "diagnose", "foresee", "compare", "validate"}
JUDGED = {
    "demo",
    "stiffness",
    "design",
    "identify",
    "identify_positions",
    "validate",
    "diagnose",
    "foresee",
    "compensate",
    "compare",
    "certificate",
}
"""Pages whose first question has an answer."""
PLAIN = {"validate"}
"""Reports without a pose to be seen in 3D."""


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> Reports:
    folder = tmp_path_factory.mktemp("reports")
    text = TASK.read_text().replace("steps: 14", "steps: 4").replace("candidates: 300", "candidates: 60")
    (folder / "task.yaml").write_text(text)
    return make_reports(folder, folder / "task.yaml")


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
            self.frames.append(unpacked(found.get("data-page") or ""))
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
    with_report = {name for name, c in every_command().items() if any("--report" in p.opts for p in c.params)}
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
def test_every_plot_has_properties_that_plotly_knows(reports: Reports, name: str) -> None:
    """`qsframework.report.plots` writes Plotly's JSON by itself: the package checks every property and value of it."""
    from plotly.graph_objects import Figure

    drawn = re.findall(r'<script type="application/json" id="figure[^>]*>(.*?)</script>', reports.text(name), re.DOTALL)
    assert len(drawn) == len(re.findall(r'class="plotly-graph-div"', reports.text(name)))
    for text in drawn:
        assert Figure(json.loads(text)).data


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


@pytest.fixture(scope="module")
def chromium(reports: Reports) -> Iterator[Browser]:
    """One browser for all pages; every host but this machine's address is unknown to it."""
    with Browser(reports.folder / "profile", "about:blank", own="file://") as driven:
        yield driven


_DRAWN = """document.readyState === "complete"
  && [...document.querySelectorAll(".plotly-graph-div:not(:has(.main-svg))")].every(d => !d.checkVisibility())
  && [...document.querySelectorAll("iframe")].every(f => f.contentDocument.querySelector("canvas"))"""
_PALE = """(() => {
  const rgb = text => (text.match(/[\\d.]+/g) || []).map(Number);
  const linear = x => x <= 10.3 ? x / 3295 : ((x / 255 + .055) / 1.055) ** 2.4;
  const light = ([r, g, b]) => .2126 * linear(r) + .7152 * linear(g) + .0722 * linear(b);
  const behind = e => { for (; e; e = e.parentElement) { const c = rgb(getComputedStyle(e).backgroundColor);
    if (c.length === 3 || c[3] > .5) return c; } return [255, 255, 255]; };
  const out = [];
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const e = texts.currentNode.parentElement, look = getComputedStyle(e);
    if (!texts.currentNode.data.trim() || !e.getClientRects().length || e.closest("script, .heatmaplayer")) continue;
    const [a, b] = [light(rgb(e instanceof SVGElement ? look.fill : look.color)), light(behind(e))];
    if ((Math.max(a, b) + .05) / (Math.min(a, b) + .05) < 4.5) out.push(e.textContent.slice(0, 40));
  }
  return out; })()"""
_WIDE = """[...document.querySelectorAll("body *")].filter(e => e.checkVisibility()
  && e.getBoundingClientRect().right > innerWidth + 1
  && !e.parentElement.closest(".scroll, svg")).map(e => e.tagName + "." + e.className)"""
_FITTED = """[...document.querySelectorAll(".main-svg")].every(
  s => !s.checkVisibility() || s.clientWidth === s.closest(".plotly-graph-div").clientWidth)"""
_STOPS = """[...document.querySelectorAll("a[href], button, input, select, summary, iframe, [tabindex]")]
  .filter(e => e.tabIndex >= 0 && (e.getClientRects().length || e.closest(".modebar"))).length"""


@browser
@pytest.mark.parametrize("name", PAGES)
def test_a_browser_shows_the_answer_first(reports: Reports, chromium: Browser, name: str) -> None:
    """No error, no request to anywhere; the verdict on the first screen; contrast; at 400 px nothing is wider than the
    page; few stops of the tab key."""
    page = reports.folder / f"{name}.html"
    assert page.stat().st_size < 3_000_000
    chromium.size(1400, 900)
    chromium.go(page.as_uri(), _DRAWN)
    seen = chromium.run(f"""({{
      band: [...document.querySelectorAll(".verdict")].map(b => b.getBoundingClientRect().bottom),
      shapes: document.querySelectorAll(".verdict svg").length,
      word: document.querySelector(".verdict .state")?.textContent.trim(),
      numbers: document.querySelectorAll(".verdict dd").length, main: document.querySelectorAll("main").length,
      pale: {_PALE}, stops: {_STOPS}, high: document.documentElement.scrollHeight}})""")
    assert len(seen["band"]) == (name in JUDGED)
    if name in JUDGED:
        assert seen["band"][0] < 900
        assert seen["shapes"] == 1
        assert seen["word"]
        assert 3 <= seen["numbers"] <= 4 or name == "compare"
    assert seen["main"] == 1
    assert seen["pale"] == []
    assert 0 < seen["stops"] < 60 or name == "sheet"
    assert seen["high"] < 5 * 900 or not name.startswith("diagnose")
    chromium.size(400, 900)
    chromium.until(f"innerWidth === 400 && {_FITTED}")
    narrow = chromium.run(f"({{page: document.documentElement.scrollWidth, wide: {_WIDE}}})")
    assert narrow["wide"] == []
    assert narrow["page"] <= 400
    assert chromium.errors == []
    assert chromium.foreign == []


@browser
def test_a_row_a_point_and_the_slider_show_one_pose(reports: Reports, chromium: Browser) -> None:
    chromium.size(1400, 900)
    chromium.go((reports.folder / "identify.html").as_uri(), _DRAWN)
    slider = "document.querySelector('iframe').contentDocument.getElementById('step')"
    poses = chromium.run("JSON.parse(document.querySelector('iframe').dataset.poses)")
    chromium.run(f"document.querySelector('tr[data-pose=\"{poses[3]}\"]').click()")
    assert chromium.run(f"Number({slider}.value)") == 4
    marked = "[...new Set([...document.querySelectorAll('tr.chosen')].map(r => r.dataset.pose))]"
    assert chromium.run(marked) == [poses[3]]
    plots = "[...document.querySelectorAll('.js-plotly-plot')].filter(d => d.data.some(t => t.selectedpoints))"
    assert chromium.run(f"{plots}.length") >= 2
    point = "{points: [{customdata: " + json.dumps(poses[1]) + "}]}"
    chromium.run(f"{plots}[0].emit('plotly_click', {point})")
    assert chromium.run(f"Number({slider}.value)") == 2
    chromium.run(f"{slider}.focus()")
    chromium.key("ArrowRight")
    assert chromium.run(marked) == [poses[2]]


@browser
@pytest.mark.parametrize("name", PAGES)
def test_every_trace_is_seen(reports: Reports, chromium: Browser, name: str) -> None:
    """With all other traces hidden, each colours pixels of its plot that differ clearly from the ground; all that is
    written can be read, also in what was folded, and every drawing has a name."""
    chromium.size(1400, 1500)  # as high as the highest plot, so that none is laid out anew for its picture
    chromium.go(without_scenes(reports, name), _DRAWN)
    chromium.run(_OPENED)
    try:
        for scheme in ("dark", "light"):
            chromium.media(scheme=scheme)
            ink = {"light": "#222", "dark": "#e4e7ea"}[scheme]
            chromium.until(
                f"{_DRAWN} && [...document.querySelectorAll('.js-plotly-plot')]"
                f".every(d => d._fullLayout.font.color === '{ink}')"
            )
            told = chromium.run(f"({{pale: {_PALE}, small: {_SMALL}, unnamed: {_UNNAMED}, plots: {_PLOTS}}})")
            assert (told["pale"], told["small"], told["unnamed"]) == ([], [], []), scheme
            for number, (box, traces) in enumerate(told["plots"]):
                assert box[3] < 1500, "higher than the window"
                chromium.run(f"document.querySelectorAll('.js-plotly-plot')[{number}].scrollIntoView()")
                empty = pixels_of(chromium, number, -1, box)
                for k in range(traces):
                    apart = np.abs(pixels_of(chromium, number, k, box) - empty).sum(axis=2)
                    assert int((apart > 90).sum()) >= 20, f"trace {k} of plot {number} is not to be seen: {scheme}"
    finally:
        chromium.media()


@browser
@pytest.mark.parametrize("name", PAGES)
def test_no_label_is_cut_or_over_another(reports: Reports, chromium: Browser, name: str) -> None:
    """In no plot, at the widths of a desk, a tablet and a telephone, also in what was folded."""
    chromium.size(1400, 1500)
    chromium.go(without_scenes(reports, name), _DRAWN)
    chromium.run(_OPENED)
    for width in (1400, 820, 390):
        chromium.size(width, 1500)
        chromium.until(f"innerWidth === {width} && {_DRAWN} && {_FITTED}")
        assert chromium.run(_OVER) == [], width


def without_scenes(reports: Reports, name: str) -> str:
    """Where a copy of a report is that has its plots alone."""
    page = reports.folder / f"{name}_plots.html"
    page.write_text(re.sub(r"<iframe .*?</iframe>", "", reports.text(name), flags=re.S))
    return page.as_uri()


_OPENED = "document.querySelectorAll('#unfold').forEach(b => b.click())"
_OVER = """[...document.querySelectorAll(".js-plotly-plot")].filter(d => d.checkVisibility()).flatMap(d => {
  const level = t => (/rotate\\((-?[\\d.]+)/.exec(t.getAttribute("transform")) || [0, 0])[1] % 90 == 0;
  const texts = [...d.querySelectorAll("svg text")].filter(t => t.textContent.trim() && t.getClientRects().length
    && t.checkVisibility({opacityProperty: true, visibilityProperty: true}) && level(t)
    && !t.closest(".hoverlayer, .modebar-container")).map(t => [t.textContent, t.getBoundingClientRect()]);
  const inner = (p, q) => Math.min(p.right, q.right) - Math.max(p.left, q.left) > 3
    && Math.min(p.bottom, q.bottom) - Math.max(p.top, q.top) > 4;
  const box = d.getBoundingClientRect(), cut = ([, p]) => p.left < box.left - 2 || p.right > box.right + 2
    || p.top < box.top - 2 || p.bottom > box.bottom + 2;
  return [...texts.filter(cut).map(([a]) => a + " is cut"), ...texts.flatMap(([a, p], i) =>
    texts.slice(i + 1).filter(([, q]) => inner(p, q)).map(([b]) => a + " over " + b))]; })"""
_SMALL = """[...document.querySelectorAll("body *")].filter(e => e.getClientRects().length && !e.closest("script")
  && [...e.childNodes].some(n => n.nodeType === 3 && n.data.trim()) && parseFloat(getComputedStyle(e).fontSize) < 10
  ).map(e => e.textContent.slice(0, 40))"""
_UNNAMED = """[...document.querySelectorAll("main svg")].filter(s => s.getClientRects().length
  && !s.closest("[aria-hidden=true]") && !s.getAttribute("aria-label")).map(s => s.outerHTML.slice(0, 80))"""
_TRACES = ".scatterlayer > .trace, .barlayer > .trace, .boxlayer > .trace, .heatmaplayer > .hm"
_PLOTS = f"""[...document.querySelectorAll(".js-plotly-plot")].map(d => {{
  const box = d.getBoundingClientRect();
  return [[box.left + scrollX, box.top + scrollY, box.width, box.height],
    [...d.querySelectorAll("{_TRACES}")].filter(t => t.querySelector("path, image, text")).length]; }})"""


def pixels_of(chromium: Browser, plot: int, trace: int, box: list[float]) -> np.ndarray:
    """What one trace of a plot shows alone, none where it is -1: (rows, columns, 3)."""
    chromium.run(f"""[...document.querySelectorAll(".js-plotly-plot")[{plot}].querySelectorAll("{_TRACES}")]
      .filter(t => t.querySelector("path, image, text"))
      .forEach((t, k) => {{ t.style.visibility = k === {trace} ? "visible" : "hidden"; }})""")
    return np.asarray(Image.open(io.BytesIO(chromium.picture(box))).convert("RGB")).astype(np.int16)


@browser
@pytest.mark.parametrize("name", PAGES)
def test_paper_shows_the_answer_first_and_cuts_nothing(reports: Reports, chromium: Browser, name: str) -> None:
    """On paper the verdict stands on the first sheet; what is folded is listed and, once opened, printed whole."""
    chromium.size(PAPER, 900)
    chromium.go(without_scenes(reports, name), _DRAWN)
    chromium.media("print")
    try:
        chromium.run("dispatchEvent(new Event('beforeprint'))")
        closed = chromium.run("""({
          answer: [...document.querySelectorAll(".verdict")].map(v => v.getBoundingClientRect().bottom),
          listed: [...document.querySelectorAll("details > summary")].every(s => s.closest("details details")
            || s.getClientRects().length), open: document.querySelectorAll("details[open]").length})""")
        assert all(bottom < SHEET for bottom in closed["answer"])
        assert closed["listed"]
        assert closed["open"] == 0
        chromium.run(_OPENED)
        chromium.run("dispatchEvent(new Event('beforeprint'))")
        opened = chromium.run(f"""({{cut: {_CUT}, small: {_SMALL},
          high: [...document.querySelectorAll("figure")].map(f => f.getBoundingClientRect().height)}})""")
        assert opened["cut"] == []
        assert all(high < SHEET for high in opened["high"])
    finally:
        chromium.media()


PAPER, SHEET = 688, 1000
"""Width and height of the text on A4, pixels."""
_CUT = """[...document.querySelectorAll("main *")].filter(e => e.getClientRects().length && !e.closest("svg")
  && e.getBoundingClientRect().right > innerWidth + 1).map(e => e.tagName + ": " + e.textContent.slice(0, 40))"""


@browser
def test_a_fit_of_six_parameters_prints_on_four_sheets(reports: Reports, chromium: Browser) -> None:
    chromium.size(1400, 900)
    chromium.go((reports.folder / "identify.html").as_uri(), _DRAWN)
    printed = chromium.pdf()
    assert 1 <= len(re.findall(rb"/Type\s*/Page\b", printed)) <= 4
    boxes = re.findall(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", printed)
    assert {(round(float(w)), round(float(h))) for w, h in boxes} == {(595, 842)}, "A4"
    pictures = [p for p in images_of(printed) if p.shape[1] > 300]
    assert pictures
    grey = pictures[0].reshape(-1, 3).astype(int)
    assert int((grey[:, 0] - grey[:, 2] > 80).sum()) > 1000, "no arm in the picture on paper"


def images_of(pdf: bytes) -> list[np.ndarray]:
    """The coloured pictures (rows, columns, 3) in a PDF, as Chromium writes them."""
    out = []
    for head, data in re.findall(rb"(<<[^>]*?/Subtype /Image.*?>>)\s*stream\r?\n(.*?)endstream", pdf, re.S):
        width, height = (int(re.search(rb"/%s (\d+)" % key, head)[1]) for key in (b"Width", b"Height"))
        raw = zlib.decompress(data) if b"/FlateDecode" in head else b""
        if len(raw) == width * height * 3:
            out.append(np.frombuffer(raw, np.uint8).reshape(height, width, 3))
    return out


def test_the_bundle_is_the_one_that_its_page_names() -> None:
    """Unchanged, and of the version for which the Python package writes figures."""
    from plotly.offline import get_plotlyjs_version

    folder = resources.files("qsframework.report") / "plotly"
    told = (folder / "README.md").read_text()
    assert f"`{hashlib.sha256((folder / 'plotly-cartesian.min.js').read_bytes()).hexdigest()}`" in told
    assert f"Plotly.js {get_plotlyjs_version()} " in told
    assert "MIT" in (folder / "LICENSE").read_text()


def test_the_numbers_of_a_figure_are_those_of_its_traces() -> None:
    from qsframework.report.numbers import figure_table
    from qsframework.report.plots import blank

    figure = blank("", "x, m", "y, mm")
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
    assert "some points" in apart.caption
    figure = blank("", "", "")
    figure.add_heatmap(x=["p", "q"], y=["r"], z=[[1.5, np.nan]])
    heat = figure_table(figure)
    assert heat.header == ("", "p", "q")
    assert heat.rows == (("r", "1.5", "-"),)
