"""Reports and scenes of a robot, a campaign and files whose every name is markup: nothing of it becomes an element."""

from __future__ import annotations

import base64
import gzip
import re
import shutil
import socket
import threading
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.request import Request, urlopen

import numpy as np
import pytest
import yaml
from headless import unpacked
from typer.testing import CliRunner

from qsframework.cli.app import app, every_command
from qsframework.experiment import example
from qsframework.robot.search import find_robot
from qsframework.viz.scene import Facts, Scene
from qsframework.viz.server import SceneSite, serve

EVIL = """"'></script></style></title></textarea></iframe><qsf-evil onerror="qsf_evil()"><script>qsf_evil()</script>"""
"""Gets out of attributes, scripts, styles and titles, if anything lets it."""
IN_NAME = """"'><qsf-evil onerror=qsf_evil() href=javascript:qsf_evil()>"""
"""The same for names, which end at a blank in some files: a joint, a link, a marker, a load, a pose."""
EVIL_NAME = IN_NAME.replace(" ", "\u00a0").replace("()", "")
POSES = ["--pose", "0,20,-10,0,40,0", "--load", "0,0,-4000"]


class Elements(HTMLParser):
    """What a browser would make of a page, and of the pages inside it."""

    def __init__(self) -> None:
        super().__init__()
        self.evil: list[str] = []
        self.scripts: list[str] = []
        self.shown = ""
        self.inner: list[str] = []
        self._script = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        names = [name for name, _ in attrs]
        handlers = [name for name in names if name.startswith("on")]
        links = [value for name, value in attrs if name in ("href", "src", "action") and "evil" in (value or "")]
        if "evil" in tag or handlers or links or any("evil" in name for name in names):
            self.evil.append(f"<{tag} {attrs}>")
        self.inner += [value or "" for name, value in attrs if name == "srcdoc"]
        self.inner += [unpacked(value or "") for name, value in attrs if name == "data-page"]
        if tag == "script":
            self._script = True
            self.scripts.append("")

    def handle_endtag(self, tag: str) -> None:
        self._script = self._script and tag != "script"

    def handle_data(self, data: str) -> None:
        if self._script:
            self.scripts[-1] += data
        else:
            self.shown += data


def parse(text: str) -> Elements:
    page = Elements()
    page.feed(text)
    page.close()
    return page


def problems(text: str) -> list[str]:
    """Where the user's text got out of its place."""
    page = parse(text)
    found = list(page.evil)
    for script in page.scripts:
        plain = script.replace("\\u003c", "<").replace("\\u003e", ">")
        if re.match(r"\s*qsf_evil", script):
            found.append(script[:80])
        if script.startswith('{"data":') and "<qsf-evil" in plain:
            found.append("plotly would read the text as markup: " + plain[plain.index("<qsf-evil") - 80 :][:160])
    for inner in page.inner:
        found += [f"in a scene: {p}" for p in problems(inner)]
    return found


def test_the_parser_sees_what_gets_out() -> None:
    """Pages that do not escape are found out."""
    for page in (
        f"<p>{EVIL}</p>",
        f"<p>{IN_NAME}</p>",
        f'<a title="{EVIL}">',
        f"<title>{EVIL}</title>",
        f"<script>const a = '{EVIL}'</script>",
        f"<style>{EVIL}</style>",
        f'<iframe srcdoc="{("<p>" + EVIL).replace("&", "&amp;").replace(chr(34), "&quot;")}"></iframe>',
        f'<iframe data-page="{base64.b64encode(gzip.compress(EVIL.encode())).decode()}"></iframe>',
        '<script type="application/json">{"data":[{"text": "\\u003cqsf-evil>"}]}</script>',
    ):
        assert problems(page), page
    assert not problems("<p>&lt;qsf-evil onerror=1&gt;</p><script>const a = '\\u003cqsf-evil>'</script>")


def joint(match: re.Match[str]) -> str:
    return match.group() + EVIL_NAME


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot, a campaign, a plan, readings and targets, all with markup for names."""
    folder = tmp_path_factory.mktemp("evil") / IN_NAME.replace("/", "").replace("\n", "")
    source = find_robot("fanuc_m900ib").parent
    shutil.copytree(source, folder / "robot")
    urdf = folder / "robot" / "m900ib.urdf.xacro"
    in_xml = EVIL_NAME.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;").replace(">", "&gt;")
    urdf.write_text(re.sub(r"joint_\d", lambda m: m.group() + in_xml, urdf.read_text()))
    for name in ("robot.yaml", "nominal.yaml"):
        path = folder / "robot" / name
        text = re.sub(r"joint_\d", joint, path.read_text())
        text = re.sub(r"source: .*", lambda m: "source: '" + EVIL.replace("'", "''") + "'", text)
        path.write_text(re.sub(r"title: .*", lambda m: "title: 'FANUC " + EVIL.replace("'", "''") + "'", text))
    document = yaml.safe_load((example("m900ib") / "experiment.yaml").read_text())
    document["robot"] = "./robot"
    document["markers"] = {f"{name}{IN_NAME}": marker for name, marker in [*document["markers"].items()][:1]}
    for load in document["loads"]:
        load["name"] += EVIL
    (folder / "experiment.yaml").write_text(yaml.safe_dump(document))
    target = f"target,{','.join(f'q{k}_deg' for k in range(1, 7))},fx_N,fy_N,fz_N\n"
    (folder / "targets.csv").write_text(target + '"' + EVIL.replace('"', '""') + '",0,20,-10,0,40,0,0,0,-4000\n')
    task = (example("m900ib").parent / "compare" / "task.yaml").read_text()
    task = re.sub(r"title: .*", lambda m: "title: '" + EVIL.replace("'", "''") + "'", task)
    (folder / "task.yaml").write_text(
        task.replace("steps: 14", "steps: 2").replace("candidates: 300", "candidates: 30")
    )
    return folder


@pytest.fixture(scope="module")
def states(folder: Path) -> Path:
    """Absolute positions of a UR10 whose marker, poses and series are markup."""
    document = yaml.safe_load((example("ur10") / "experiment.yaml").read_text())
    document |= {"markers": {f"tmac{EVIL_NAME}": document["markers"]["tmac"]}, "data": "states.csv"}
    document |= {"effects": document["effects"][:3], "fit": ["marker_offset", "joint_offset"]}
    (folder / "states.yaml").write_text(yaml.safe_dump(document))
    quoted = EVIL_NAME.replace('"', '""')
    rows = (example("ur10") / "series_d.csv").read_text().splitlines()[2:60]
    table = [re.sub(r"^(\d+),", lambda m: f'"{m[1]}{quoted}",', row) for row in rows]
    table = [row.replace(",tmac,", f',"tmac{quoted}",').replace(",D,", f',"D{quoted}",') for row in table]
    (folder / "states.csv").write_text("\n".join(table) + "\n")
    return folder / "states.yaml"


@pytest.fixture(scope="module")
def pages(folder: Path, states: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The report of every command, and every kind of scene."""
    out: dict[str, str] = {}
    robots = tmp_path_factory.mktemp("robots") / "linked"  # a search path has no colons
    robots.symlink_to(folder)
    here = {name: str(folder / f"{name}.csv") for name in ("plan", "readings", "targets", "corrected", "sheet")}
    experiment, fit, robot = str(folder / "experiment.yaml"), str(folder / "fit.json"), str(folder / "robot")

    def run(name: str, *arguments: str, option: str = "--report") -> None:
        path = folder / f"{name}.html"
        result = CliRunner().invoke(app, [*arguments, option, str(path)], env={"QSF_ROBOTS": str(robots)})
        assert result.exit_code == 0, (name, result.output[-2000:], result.exception)
        out[name] = path.read_text()

    run("design", "design", experiment, "-n", "6", "--candidates", "60", "--efficiency", "0.9", "-o", here["plan"])
    plan = Path(here["plan"])
    evil = EVIL_NAME.replace('"', '""')
    plan.write_text(re.sub(r"^p(\d+),", lambda m: f'"p{m[1]}{evil}",', plan.read_text(), flags=re.MULTILINE))
    run("robots", "robots")
    run("check", "check", experiment, robot)
    run("stiffness", "stiffness", robot, *POSES)
    run("simulate", "simulate", experiment, here["plan"], "-o", here["readings"], "--truth", "drawn")
    run("identify", "identify", experiment, here["readings"], "--json", fit)
    run("check_states", "check", str(states))
    run("identify_positions", "identify", str(states), "--json", str(folder / "positions.json"))
    run("validate", "validate", experiment, fit, here["readings"])
    run("validate_positions", "validate", str(states), str(folder / "positions.json"))
    run("diagnose", "diagnose", experiment, here["readings"])
    run("foresee", "diagnose", experiment, here["plan"])
    run("compensate", "compensate", experiment, fit, here["targets"], "-o", here["corrected"])
    run("compare", "compare", robot, "abb_irb2400", "--task", str(folder / "task.yaml"))
    run("protocol", "protocol", experiment, here["plan"], "--readings", here["sheet"], option="-o")
    run("show", "show", experiment, here["plan"], option="--html")
    run("show_fit", "show", experiment, fit, here["readings"], option="--html")
    run("show_robot", "show", robot, option="--html")
    return out


PAGES = (
    "design",
    "robots",
    "check",
    "stiffness",
    "simulate",
    "identify",
    "diagnose",
    "foresee",
    "compensate",
    "compare",
    "protocol",
    "show",
    "show_fit",
    "show_robot",
    "check_states",
    "identify_positions",
    "validate",
    "validate_positions",
)


@pytest.mark.parametrize("name", PAGES)
def test_no_element_comes_from_the_users_text(pages: dict[str, str], name: str) -> None:
    text = pages[name]
    assert not problems(text), problems(text)[:3]
    page = parse(text)
    everything = page.shown + "".join(page.scripts) + "".join(page.inner)
    assert "qsf-evil" in everything, "the page does not show the names at all: nothing was tested"


def test_these_are_all_commands_that_write_pages() -> None:
    writing = {n for n, c in every_command().items() if any(set(p.opts) & {"--report", "--html"} for p in c.params)}
    assert writing | {"protocol"} == {p.partition("_")[0] for p in PAGES} - {"foresee"} | writing & {"demo"}


def test_a_page_of_an_error_escapes_it() -> None:
    scene = Scene(title=EVIL, notes=[EVIL], factor=EVIL)
    scene.step("a/" + EVIL, EVIL, facts=Facts(name=EVIL, angles=((EVIL, EVIL),), shares=((EVIL, 1.0),)))
    scene.layer(EVIL, EVIL)
    scene.text("a/" + EVIL, EVIL, np.zeros(3))
    page = scene.html("/" + EVIL)
    assert not problems(page), problems(page)


@pytest.fixture
def port() -> Iterator[int]:
    server = serve(SceneSite(lambda watch: f"<p>{watch}</p>", []), 0)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    assert server.socket.getsockname()[0] == "127.0.0.1"
    yield server.server_address[1]
    server.shutdown()
    server.server_close()


def test_the_viewer_listens_on_this_machine_only(port: int) -> None:
    """The socket of `qsf show`, as the kernel lists it, and every address that this machine has."""
    local = [line.split()[1] for line in Path("/proc/net/tcp").read_text().splitlines()[1:] if line.split()[3] == "0A"]
    assert f"0100007F:{port:04X}" in local
    assert f"00000000:{port:04X}" not in local
    if Path("/proc/net/tcp6").exists():
        assert not any(
            line.split()[1].endswith(f":{port:04X}") and line.split()[3] == "0A"
            for line in Path("/proc/net/tcp6").read_text().splitlines()[1:]
        )
    for other in ("127.0.0.2", *socket.gethostbyname_ex(socket.gethostname())[2]):
        if other != "127.0.0.1":
            with pytest.raises(OSError), socket.create_connection((other, port), timeout=1.0):
                pass


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:80", "127.0.0.1.evil.example:80", "[::1]:80", "0.0.0.0:80"]
)
def test_the_viewer_answers_no_foreign_name(port: int, host: str) -> None:
    """A page of another site that points its name at 127.0.0.1 gets nothing."""
    import urllib.error

    with pytest.raises(urllib.error.HTTPError) as caught:
        urlopen(Request(f"http://127.0.0.1:{port}/", headers={"Host": host}), timeout=300.0)
    assert caught.value.code == 403
    caught.value.close()
    with urlopen(f"http://127.0.0.1:{port}/", timeout=300.0) as answer:
        assert answer.status == 200
