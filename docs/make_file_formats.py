"""Write docs/file-formats.md from the models and columns that read the files: python docs/make_file_formats.py

Keys, units and what is required come from the code, the meanings from file_formats_text.txt; a key without a meaning,
or a meaning without a key, is an error.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
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
from qsframework.identify import Estimate, FitRecord, Held, Masked, NotEstimated
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
    "fit.json, not_estimated": NotEstimated,
    "fit.json, held": Held,
    "fit.json, intervals": Interval,
    "fit.json, cleaned and gross": Masked,
}
NAMED = {Estimate: "name", Frame: "series", NotEstimated: "name", Held: "name", Interval: "name"}
"""Records that stand in their file under this field of theirs, which is no key in it."""


EXAMPLES = {
    "robot.yaml": ("robots/kuka_kr270/robot.yaml", 12),
    "experiment.yaml": ("examples/m900ib/experiment.yaml", 12),
    "plan.csv": ("examples/m900ib/table5.csv", 2),
    "readings.csv": ("examples/r2000ic/readings.csv", 2),
    "readings.csv of states": ("examples/ur10/series_d.csv", 2),
    "targets.csv": ("examples/m900ib/targets.csv", 2),
}
"""What each section begins with: so many lines of a shipped file."""
UNITS = 2
"""So many spellings of a key are shown: the usual units."""


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
        shown = f"```\n{_lines(*EXAMPLES[title])}```\n\n" if title in EXAMPLES else ""
        out.append(f"\n## {title}\n\n{shown}{said[title]}\n")
        used |= {(title, name) for name, _, _ in found}
        meant = [(keys[title, name], required, spelled.split(", ")[:UNITS]) for name, spelled, required in found]
        for (words, required), alike in groupby(meant, lambda row: row[:2]):
            spelled = ", ".join(f"`{s}`" for row in alike for s in row[2])
            out.append(f"- {spelled}{' (required)' if required else ''}: {words}\n")
    for title in (t for t in said if t not in rows() and t != "top"):
        out.append(f"\n## {title}\n\n{said[title]}\n")
        named = [(words, name) for (owner, name), words in keys.items() if owner == title]
        used |= {(title, name) for _, name in named}
        for words, alike in groupby(named, lambda row: row[0]):
            out.append(f"- {', '.join(f'`{name}`' for _, name in alike)}: {words}\n")
    if unknown := sorted(set(keys) - used):
        raise KeyError(f"no such key: {unknown}")
    return "".join(out)


def _lines(file: str, count: int) -> str:
    """The first lines of a shipped file, without its remarks."""
    lines = (DOCS.parent / file).read_text().splitlines(keepends=True)
    return "".join([line for line in lines if not line.startswith("#")][:count])


def keys_of(title: str) -> list[str]:
    """The keys that the page explains under a heading that has no model."""
    _, keys = meanings()
    return [name for owner, name in keys if owner == title]


def main() -> Any:
    """Write the page."""
    return PAGE.write_text(page())


if __name__ == "__main__":
    main()
