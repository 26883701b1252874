"""Readers, languages and commands of strangers: installed beside qsframework they work as its own do."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest

from qsframework import installed
from qsframework.cli import check_command
from qsframework.cli.app import every_command
from qsframework.errors import PluginError
from qsframework.plugin import MeasuredFile, check_language, check_reader, languages, read_points
from qsframework.plugin.language import endings

FOLDER = Path(__file__).parents[1] / "third_party_formats"
LISTINGS = Path(__file__).parents[1] / "applications" / "listings"
PIP = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
OFFLINE = ["--no-deps", "--no-build-isolation", "--no-index"]


def run(command: list[str], folder: Path, *paths: Path) -> subprocess.CompletedProcess[str]:
    """A command with packages on the path."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, paths))}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)


def qsf(line: str, folder: Path, *paths: Path) -> subprocess.CompletedProcess[str]:
    """A command of `qsf`."""
    return run([str(Path(sys.executable).with_name("qsf")), *line.split()], folder, *paths)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package in a folder of its own, for it is built there."""
    folder = tmp_path_factory.mktemp("source") / "acme"
    return shutil.copytree(FOLDER, folder, ignore=shutil.ignore_patterns("__pycache__"))


@pytest.fixture(scope="module", params=["folder", "wheel"])
def site(request: pytest.FixtureRequest, source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the package is installed, out of its folder or out of its wheel."""
    target, given = tmp_path_factory.mktemp("site"), source
    if request.param == "wheel":
        wheels = tmp_path_factory.mktemp("wheels")
        subprocess.run([*PIP, "wheel", *OFFLINE, "--wheel-dir", str(wheels), str(source)], check=True)
        (given,) = wheels.glob("*.whl")
    subprocess.run([*PIP, "install", *OFFLINE, "--target", str(target), str(given)], check=True)
    return target


@pytest.fixture
def cell(root: Path, tmp_path: Path) -> Path:
    """A campaign on an arm by ACME."""
    arm = shutil.copytree(root / "robots" / "ur10", tmp_path / "acme_arm")
    text = (arm / "robot.yaml").read_text()
    lines = [f"title: ACME {k}" if line.startswith("title:") else line for k, line in enumerate(text.splitlines())]
    (arm / "robot.yaml").write_text("\n".join(lines) + "\n")
    (tmp_path / "experiment.yaml").write_text(
        "robot: acme_arm\nload: {point_mm: [0, 0, 100]}\n"
        "markers: {m1: {xyz_mm: [0, 0, 50]}, m2: {xyz_mm: [60, 0, 50]}}\n"
        "loads: [{name: weight, fz_N: -50}]\nnoise: {sigma_mm: 0.03}\n"
    )
    (tmp_path / "plan.csv").write_text(
        "pose,load,repeats,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,fx_N,fy_N,fz_N\n"
        "p01,weight,2,0,-90,90,0,90,0,0,0,-50\np02,weight,1,30,-80,80,0,80,0,0,0,-50\n"
    )
    return tmp_path


def test_a_command_is_one_of_qsf(site: Path, cell: Path) -> None:
    assert "visits       Count the visits of a plan under each load." in qsf("--help", cell, site).stdout
    counted = qsf("visits experiment.yaml plan.csv --json counts.json", cell, site)
    assert (counted.returncode, [w for w in counted.stdout.split() if set(w) != {"─"}]) == (
        0,
        ["load", "visits", "weight", "3"],
    ), counted.stderr
    assert '"weight": 3' in (cell / "counts.json").read_text()
    assert qsf("visits experiment.yaml plan.csv --once", cell, site).stdout.split()[-2:] == ["weight", "2"]
    assert "No such command 'visits'" in qsf("visits experiment.yaml plan.csv", cell).stderr


def test_a_reader_serves_import(site: Path, cell: Path) -> None:
    shutil.copy(FOLDER / "points.acm", cell)
    line = "import experiment.yaml points.acm -p plan.csv --within 5000"
    found = qsf(line, cell, site)
    assert found.returncode == 0, found.stderr
    assert "3 points of an ACME tracker" in found.stdout
    assert len((cell / "readings.csv").read_text().splitlines()) > 3
    (cell / "points.acm").write_text("ACME TRACKER\nUNIT mm\nPOINT p01 1 2\n")
    spoilt = qsf(line.replace("import", "import --look"), cell, site)
    assert spoilt.returncode == 2
    assert "points.acm, line 3: a point; found POINT p01 1 2; allowed: a name and three numbers" in " ".join(
        spoilt.stderr.split()
    )


def test_a_language_serves_export(site: Path, cell: Path) -> None:
    done = qsf("export experiment.yaml plan.csv --to acme -o cell.acme", cell, site)
    assert done.returncode == 0, done.stderr
    assert "P1 = [" in (cell / "cell.acme").read_text()
    refused = qsf("export experiment.yaml plan.csv --to krl -o cell.src", cell, site)
    assert "krl is for controllers by KUKA" in refused.stderr
    assert "Use acme. (--to acme)" in " ".join(refused.stderr.split())


PAGES = {"new-reader.md": "acme_points.py", "new-language.md": "acme_script.py", "new-command.md": "acme_visits.py"}


@pytest.mark.parametrize("page", PAGES)
def test_a_page_shows_the_file_and_its_entry_point(page: str, root: Path) -> None:
    text = (root / "docs" / page).read_text()
    code, entry = (re.findall(rf"^```{kind}\n(.*?)^```", text, re.M | re.S) for kind in ("python", "toml"))
    assert code == [(FOLDER / PAGES[page]).read_text()]
    assert entry[0] in (FOLDER / "pyproject.toml").read_text()
    (check,) = re.findall(r"^```sh\n(.*?)^```", text, re.M | re.S)
    words = shlex.split(check)
    done = run([sys.executable, *words[1:]], FOLDER, FOLDER)
    assert (done.returncode, done.stdout.strip()) == (0, ""), done.stderr


def test_the_examples_keep_the_protocols(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(FOLDER)
    import acme_points
    import acme_script
    import acme_visits

    assert check_reader(acme_points.read, FOLDER / "points.acm").failed == []
    assert check_language(acme_script.Acme(), FOLDER / "cell.acme").failed == []
    assert check_command(acme_visits.visits, "visits").failed == []
    assert all(len(path.read_text().splitlines()) < 80 for path in FOLDER.glob("*.py"))


@pytest.mark.parametrize(
    "path", sorted(path for path in LISTINGS.iterdir() if path.suffix in endings()), ids=lambda path: path.name
)
def test_our_languages_keep_the_protocol(path: Path) -> None:
    """Of each language one programme, and all that has a point of numbers."""
    found = [language for language in languages().values() if path.suffix in language.endings]
    report = check_language(found[0], path)
    assert set(report.failed) <= {"finds a point of numbers: none"}


def test_our_commands_keep_the_protocol() -> None:
    for name, entry in installed.entries(installed.COMMANDS).items():
        assert check_command(entry.load(), name).failed == []
        assert name in every_command()


WRONG: dict[str, tuple[Any, str]] = {
    "reader": (lambda file: {"rows": []}, "knows its example: gave dict"),
    "fails": (lambda file: 1 / 0, "reads its example: ZeroDivisionError"),
    "takes all": (
        lambda file: __import__("qsframework.plugin").plugin.PointTable("rows", ("x",), ((1, ("1",)),)),
        "leaves an empty file to others",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_a_reader_breaks_is_said(name: str) -> None:
    reader, words = WRONG[name]
    assert any(line.startswith(words) for line in check_reader(reader, FOLDER / "points.acm").failed)


def test_what_a_language_breaks_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(FOLDER)
    import acme_script

    class Shifted(acme_script.Acme):
        """Its numbers stand one character to the left."""

        def read(self, texts: Any) -> Any:
            lines, points, *rest = super().read(texts)
            from dataclasses import replace

            moved = [replace(p, cells={k: replace(c, start=c.start - 1) for k, c in p.cells.items()}) for p in points]
            return (lines, moved, *rest)

    class Silent(acme_script.Acme):
        """It forgets its points."""

        def read(self, texts: Any) -> Any:
            lines, _, *rest = super().read(texts)
            return (lines, [], *rest)

    assert check_language(Shifted(), FOLDER / "cell.acme").failed
    assert any("accounts for every motion" in line for line in check_language(Silent(), FOLDER / "cell.acme").failed)


@pytest.fixture
def stated(monkeypatch: pytest.MonkeyPatch) -> Any:
    """What the metadata of installed packages say, in place of what is installed."""
    own = installed.entry_points

    def state(**places: list[tuple[str, str]]) -> None:
        def entry_points(group: str) -> list[EntryPoint]:
            more = places.get(group.rpartition(".")[2], [])
            return [*own(group=group), *(EntryPoint(name, place, group) for name, place in more)]

        monkeypatch.setattr(installed, "entry_points", entry_points)
        installed.entries.cache_clear()

    yield state
    installed.entries.cache_clear()


def test_two_packages_of_one_name_are_named(stated: Any) -> None:
    stated(readers=[("json_points", "other_package:read")])
    with pytest.raises(
        PluginError, match=r"reader 'json_points' is registered twice: .*json_points:read.*other_package"
    ):
        installed.entries(installed.READERS)


def test_a_command_of_ours_is_not_replaced(stated: Any) -> None:
    stated(commands=[("identify", "qsf_day.command:day")])
    with pytest.raises(PluginError, match=r"command 'identify' .* has the name of a command of qsf"):
        every_command()


def test_one_that_fails_on_import_is_named_with_its_file(
    stated: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "broken_reader.py").write_text("a = 1\nb = a / 0\n")
    monkeypatch.syspath_prepend(tmp_path)
    stated(readers=[("broken", "broken_reader:read")])
    with pytest.raises(PluginError, match=r"reader 'broken' .*cannot be imported \(.*broken_reader.py, line 2\)"):
        installed.load(installed.entries(installed.READERS)["broken"])


def test_a_reader_that_fails_is_named(stated: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is asked of every file: whose fault it is must be said."""
    (tmp_path / "bad_readers.py").write_text(
        "def fails(file):\n    return 1 / 0\n\n\ndef other(file):\n    return [1]\n\n\nclass Krl:\n    pass\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    for name, words in (("fails", "fails on a.csv: ZeroDivisionError"), ("other", "gives list of a.csv")):
        stated(readers=[("aa", f"bad_readers:{name}")])
        with pytest.raises(PluginError, match=rf"reader 'aa' \(bad_readers:{name}\) {words}"):
            read_points(MeasuredFile(Path("a.csv"), b"x,y\n"))


@pytest.mark.parametrize(
    ("place", "words"),
    [("bad_language:Other", "is not a subclass of Language"), ("bad_language:Twin", "claims '.acme', which is of the")],
)
def test_a_language_that_is_none_or_another_is_named(
    place: str, words: str, stated: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "bad_language.py").write_text(
        "from acme_script import Acme\n\n\nclass Other:\n    pass\n\n\nclass Twin(Acme):\n    form = ''\n"
    )
    monkeypatch.syspath_prepend(FOLDER)
    monkeypatch.syspath_prepend(tmp_path)
    stated(languages=[("acme", "acme_script:Acme"), ("zz", place)])
    languages.cache_clear()
    with pytest.raises(PluginError, match=words):
        languages()
    languages.cache_clear()


HIDDEN = """
import sys
sys.modules[{package!r}] = None
sys.argv = ["qsf", *{line!r}.split()]
from qsframework.cli import main
main()
"""
COMMANDS = {
    "qsf_trackers": ("import",),
    "qsf_controllers": ("export",),
    "qsf_day": ("protocol", "day"),
    "qsf_onboarding": ("new",),
}


@pytest.mark.parametrize("package", COMMANDS)
def test_the_core_works_without_a_package(package: str, cell: Path) -> None:
    """Its help lacks the commands, and who calls one reads what is missing."""

    def hidden(line: str) -> subprocess.CompletedProcess[str]:
        return run([sys.executable, "-c", HIDDEN.format(package=package, line=line)], cell)

    listed = hidden("--help").stdout
    assert "identify" in listed
    assert not any(f"  {name} " in listed for name in COMMANDS[package])
    for name in COMMANDS[package]:
        called = hidden(f"{name} experiment.yaml")
        assert called.returncode == 2
        assert f"qsf {name} is a command of {package}, which is not there" in called.stderr
    simulated = hidden("simulate experiment.yaml plan.csv")
    assert simulated.returncode == 0, simulated.stderr
    assert hidden("check experiment.yaml readings.csv").returncode in (0, 1)
    if package == "qsf_controllers":
        (cell / "way.ls").write_text("/PROG A\n/MN\n/POS\n/END\n")
        (cell / "fit.json").write_text("{}")
        said = " ".join(hidden("compensate experiment.yaml fit.json way.ls").stderr.split())
        assert "Other languages are of qsf_controllers, which is not there" in said
