"""Write docs/file-formats.md from the models and columns that read the files: python docs/make_file_formats.py

Keys, types, units and defaults come from the code, the meanings from file_formats_text.txt; a key without a meaning, or
a meaning without a key, is an error.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Literal, get_args, get_origin

import numpy as np
from pydantic.fields import FieldInfo

from qsf_trackers.mapping import MappingSpec
from qsframework import units
from qsframework.diagnoses import diagnose
from qsframework.estimation import Interval
from qsframework.experiment import Frame, example, load_experiment, plan, read_readings, readings_table, spec as e
from qsframework.experiment.account import Account
from qsframework.experiment.columns import Column
from qsframework.experiment.finding import Finding
from qsframework.files import FileModel, FileRecord, Unit, fields, measured
from qsframework.files.formats import FORMAT
from qsframework.fits import Estimate, FitRecord, Held, Masked
from qsframework.information import NotEstimated
from qsframework.report.result_json import diagnosis_json
from qsframework.robot.spec import JointSpec, RobotSpec
from qsframework.uses import targets
from qsframework.uses.certificate import DeviceSpec, MetaSpec, PartySpec
from qsframework.uses.task import CampaignSpec, MapSpec, PointSpec, TaskSpec

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
    "fit.json, account, findings": Finding,
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
    "plan.csv": ("examples/m900ib/table5.csv", 2),
    "readings.csv": ("examples/r2000ic/readings.csv", 2),
    "readings.csv of states": ("examples/ur10/series_d.csv", 2),
    "targets.csv": ("examples/m900ib/targets.csv", 2),
}
"""What each section begins with: so many lines of a shipped file."""
UNITS = 2
"""So many units of a key are shown, the usual ones; the first is the one that its default is in."""


def tables() -> dict[str, list[Column]]:
    """The columns of every CSV file, for a robot with six joints."""
    experiment = load_experiment(example("m900ib") / "experiment.yaml")
    return {
        "plan.csv": plan._columns(experiment),
        "readings.csv": readings_table.displacement_columns(experiment),
        "readings.csv of states": readings_table.state_columns(experiment),
        "targets.csv": targets._columns(experiment),
    }


@dataclass(frozen=True)
class Row:
    """A key of a file: its name in the text file, as it is spelled, its type, its units and its default."""

    name: str
    key: str
    kind: str
    unit: str = ""
    default: str = ""


REQUIRED = "required"
KINDS = {
    "text": "text",
    "number": "number",
    "count": "integer",
    "flag": "1 or 0",
    "side": "-1 or 1",
    str: "text",
    float: "number",
    int: "integer",
    bool: "true or false",
    dict: "mapping",
    list: "list",
    type(None): "mapping or null",
}
"""What people call the kinds of columns and of values."""


def rows() -> dict[str, list[Row]]:
    """Per section its keys."""
    out = {title: _model(model) for title, model in MODELS.items()}
    for title, columns in tables().items():
        out[title] = [_column(column) for column in columns]
    return out | {title: _written(title, values) for title, values in written().items()}


def _model(model: type[FileModel | FileRecord]) -> list[Row]:
    marks = measured(model)
    return [
        _field(name, info, marks.get(name), issubclass(model, FileRecord))
        for name, info in fields(model).items()
        if name != NAMED.get(model)
    ]


def _field(name: str, info: FieldInfo, mark: Unit | None, record: bool) -> Row:
    offered = [] if mark is None else [mark.si] if record else _offered(mark.si)
    key = f"{mark.stem}_{offered[0]}" if mark else name
    default = _default(info, offered) if not info.is_required() else "" if record else REQUIRED
    return Row(name, key, _kind(info.annotation), ", ".join(offered), default)


def _offered(si: str) -> list[str]:
    return list(units.ALLOWED.get(si, (si,))[:UNITS])


def _default(info: FieldInfo, offered: Sequence[str]) -> str:
    """The default as a file would have it, in the unit that the key is shown with; none of a mapping."""
    value = info.get_default(call_default_factory=True)
    if isinstance(value, Enum):
        return f"`{value.value}`"
    if isinstance(value, bool):
        return f"`{value}`".lower()
    if isinstance(value, float | int) and math.isfinite(value):
        return f"{units.from_si(value, offered[0]) if offered else value:.6g}"
    if isinstance(value, list) and value:
        return ", ".join(f"{v:g}" for v in value)
    return f"`{value}`" if isinstance(value, str) and value else ""


def _kind(annotation: Any) -> str:
    """The type of a field in words: of a mapping its values, of a choice all that there is."""
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _kind(inner[0])
    if origin is Literal:
        return ", ".join(f"`{value}`" for value in inner)
    if origin in (list, tuple):
        return _several(_kind(inner[0]))
    if origin is dict:
        return "mapping" if inner[1] is Any else f"{_kind(inner[1])} by name"
    if origin is np.ndarray:
        return "numbers"
    if inner:
        return " or ".join(dict.fromkeys(_kind(a) for a in inner if a is not type(None)))
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return "text"
    return KINDS.get(annotation, "mapping")


def _several(kind: str) -> str:
    return f"list of {kind}" if kind.endswith("s") or " " in kind else f"{kind}s"


def _column(c: Column) -> Row:
    offered = _offered(c.unit) if c.unit else []
    key = f"{c.stem}_{offered[0]}" if offered else c.stem
    return Row(c.stem, key, KINDS[c.kind], ", ".join(offered), REQUIRED if c.required else "")


@cache
def written() -> dict[str, dict[str, Any]]:
    """Files that no model reads, as they are written for an example."""
    experiment = load_experiment(example("m900ib") / "table5.yaml")
    poses = plan.read_poses(example("m900ib") / "table5.csv", experiment)
    real = load_experiment(example("r2000ic") / "experiment.yaml")
    diagnosis = diagnosis_json(diagnose(real, read_readings(example("r2000ic") / "readings.csv", real)))
    with TemporaryDirectory() as folder:
        table = Path(folder) / "plan.csv"
        plan.write_plan(table, replace(plan.make_plan(poses, ["weight"] * len(poses)), seed=0), experiment)
        stated = json.loads(table.with_suffix(".json").read_text())
    return {
        "nominal.yaml": {"value_<unit>": 1.0, "sd_<unit>": 1.0, "sd_percent": 1.0, "source": "", "earlier": [{}]},
        "plan.json": stated,
        "diagnosis.json": {"format": FORMAT} | diagnosis,
    }


def _written(title: str, values: dict[str, Any]) -> list[Row]:
    named = [name for owner, name in meanings()[1] if owner == title]
    return [Row(name, name, _kind_of(values[name])) for name in named]


def _kind_of(value: Any) -> str:
    if isinstance(value, list) and value:
        return _several(_kind_of(value[0]))
    return KINDS[type(value)]


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
    found, out, told = rows(), [said["top"]], dict[tuple[Row, str], str]()
    for title in (t for t in said if t != "top"):
        shown = f"```\n{_lines(*EXAMPLES[title])}```\n\n" if title in EXAMPLES else ""
        words = f"{said[title]}\n" if said[title] else ""
        own = [(row, keys[title, row.name]) for row in found[title]]
        again = [pair for pair in own if pair in told and title in EXAMPLES]
        out.append(f"\n## {title}\n\n{shown}{words}{_table([pair for pair in own if pair not in again])}")
        out += [
            f"\nAs in {where}: {', '.join(f'`{row.key}`' for row, _ in each)}.\n" for where, each in _by(again, told)
        ]
        told |= {pair: told.get(pair, title) for pair in own if title.endswith(".csv")}
    if unknown := sorted(set(keys) - {(title, row.name) for title, each in found.items() for row in each}):
        raise KeyError(f"no such key: {unknown}")
    return "".join(out)


def _by(again: Sequence[tuple[Row, str]], told: dict[tuple[Row, str], str]) -> list[tuple[str, list[tuple[Row, str]]]]:
    """Columns that another table explains, by that table."""
    return [(where, [p for p in again if told[p] == where]) for where in dict.fromkeys(told[p] for p in again)]


HEAD = ("key", "type", "default", "meaning")


def cells(row: Row) -> tuple[str, str, str]:
    """How a row begins: a key that is required is bold, a text or a number with a unit needs no type."""
    plain = row.kind == KINDS["number" if row.unit else "text"]
    required = row.default == REQUIRED
    return (
        f"**`{row.key}`**" if required else f"`{row.key}`",
        "" if plain else row.kind,
        "" if required else row.default,
    )


def _table(rows: Sequence[tuple[Row, str]]) -> str:
    """A line for each key, or for several that differ by their name alone; columns that say something somewhere."""
    alike = dict[tuple[str, ...], list[str]]()
    for row, words in rows:
        key, *rest = cells(row)
        alike.setdefault((*rest, words), []).append(key)
    lines = [(", ".join(named), *same) for same, named in alike.items()]
    shown = [k for k in range(len(HEAD)) if any(line[k] for line in lines)]
    picked = [[line[k] for k in shown] for line in (HEAD, ("---",) * len(HEAD), *lines)]
    return "".join(f"|{'|'.join(f' {cell}' if cell.strip('-') else cell for cell in line)}|\n" for line in picked)


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
