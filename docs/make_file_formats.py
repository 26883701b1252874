"""Write docs/file-formats.md from the models and columns that read the files: python docs/make_file_formats.py

Keys, units and what is required come from the code, the meanings from file_formats_text.txt; a key without a meaning,
or a meaning without a key, is an error.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from qsframework import units
from qsframework.applications import targets
from qsframework.applications.certificate import DeviceSpec, MetaSpec, PartySpec
from qsframework.applications.importers.mapping import MappingSpec
from qsframework.applications.task import CampaignSpec, MapSpec, PointSpec, TaskSpec
from qsframework.estimation import Interval
from qsframework.experiment import Frame, example, load_experiment, plan, readings_table, spec as e
from qsframework.experiment.account import Account
from qsframework.experiment.columns import Column
from qsframework.files import FileModel, FileRecord, fields, measured
from qsframework.identify import Estimate, FitRecord, Held, LeftAside, Masked
from qsframework.robot.spec import JointSpec, RobotSpec

DOCS = Path(__file__).parent
PAGE = DOCS / "file-formats.md"
MODELS: dict[str, type[FileModel | FileRecord]] = {
    "robot.yaml": RobotSpec,
    "robot.yaml, controller": JointSpec,
    "experiment.yaml": e.ExperimentSpec,
    "experiment.yaml, load": e.LoadSpec,
    "experiment.yaml, markers": e.MarkerSpec,
    "experiment.yaml, noise": e.NoiseSpec,
    "experiment.yaml, frames": e.FrameSpec,
    "experiment.yaml, load_uncertainty": e.LoadUncertaintySpec,
    "experiment.yaml, loads": e.LoadCaseSpec,
    "experiment.yaml, loads, gauge": e.GaugeSpec,
    "experiment.yaml, stations": e.StationSpec,
    "experiment.yaml, positions": e.PositionsSpec,
    "experiment.yaml, constraints": e.ConstraintsSpec,
    "experiment.yaml, constraints, obstacles": e.ObstacleSpec,
    "experiment.yaml, constraints, sight": e.SightSpec,
    "task.yaml": TaskSpec,
    "task.yaml, path": PointSpec,
    "task.yaml, map": MapSpec,
    "task.yaml, campaign": CampaignSpec,
    "meta.yaml": MetaSpec,
    "meta.yaml, calibration": PartySpec,
    "meta.yaml, robot and instrument": DeviceSpec,
    "mapping.yaml": MappingSpec,
    "fit.json": FitRecord,
    "fit.json, estimates": Estimate,
    "fit.json, account": Account,
    "fit.json, frames": Frame,
    "fit.json, left_aside": LeftAside,
    "fit.json, held": Held,
    "fit.json, intervals": Interval,
    "fit.json, cleaned and gross": Masked,
}
NAMED = {Estimate: "name", Frame: "series", LeftAside: "name", Held: "name", Interval: "name"}
"""Records that stand in their file under this field of theirs, which is no key in it."""


def tables() -> dict[str, list[Column]]:
    """The columns of every CSV file, for a robot with six joints."""
    experiment = load_experiment(example("m900ib") / "experiment.yaml")
    return {
        "plan.csv": plan._columns(experiment),
        "readings.csv": readings_table._columns(experiment, False, False),
        "readings.csv of states": readings_table._columns(experiment, True, False),
        "targets.csv": targets._columns(experiment),
    }


def rows() -> dict[str, list[tuple[str, str, bool]]]:
    """Per section: key, its spelling with units, whether it is required."""
    out = {title: _model(model) for title, model in MODELS.items()}
    for title, columns in tables().items():
        out[title] = _columns(columns)
    return out


def _model(model: type[FileModel | FileRecord]) -> list[tuple[str, str, bool]]:
    marks = measured(model)
    out = []
    for name, info in fields(model).items():
        mark = marks.get(name)
        spelled = units.allowed_names(mark.stem, mark.si) if mark else name
        if issubclass(model, FileRecord) and mark:
            spelled = f"{mark.stem}_{mark.si}"
        if name != NAMED.get(model):
            out.append((name, spelled, info.is_required()))
    return out


def _columns(columns: Sequence[Column]) -> list[tuple[str, str, bool]]:
    return [(c.stem, c.spelling(), c.required) for c in columns]


def meanings() -> tuple[dict[str, str], dict[tuple[str, str], str]]:
    """The text file: the sentence under each heading, and the meaning of each key."""
    said: dict[str, str] = {}
    keys: dict[tuple[str, str], str] = {}
    title = ""
    for line in (DOCS / "file_formats_text.txt").read_text().splitlines():
        if line.startswith("# "):
            title = line[2:]
            said[title] = ""
        elif line.startswith("= "):
            said[title] += line[2:] + "\n"
        elif line:
            name, _, words = line.partition(": ")
            for each in name.split(", "):
                keys[title, each] = words
    return said, keys


def page() -> str:
    """The page. KeyError where a key has no meaning or a meaning no key."""
    said, keys = meanings()
    out, used = [said["top"]], set[tuple[str, str]]()
    for title, found in rows().items():
        out.append(f"\n## {title}\n\n{said[title]}\n| key | required | meaning |\n|---|---|---|\n")
        for name, spelled, required in found:
            used.add((title, name))
            shown = ", ".join(f"`{s}`" for s in spelled.split(", "))
            out.append(f"| {shown} | {'yes' if required else ''} | {keys[title, name]} |\n")
    for title in (t for t in said if t not in rows() and t != "top"):
        out.append(f"\n## {title}\n\n{said[title]}\n| key | meaning |\n|---|---|\n")
        for (owner, name), words in keys.items():
            if owner == title:
                used.add((owner, name))
                out.append(f"| `{name}` | {words} |\n")
    if unknown := sorted(set(keys) - used):
        raise KeyError(f"no such key: {unknown}")
    return "".join(out)


def keys_of(title: str) -> list[str]:
    """The keys that the page explains under a heading that has no model."""
    _, keys = meanings()
    return [name for owner, name in keys if owner == title]


def main() -> Any:
    """Write the page."""
    return PAGE.write_text(page())


if __name__ == "__main__":
    main()
