"""`qsf show`: what it reads, and where the page goes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from qsframework.cli.commands import distinct_outputs, note_folders
from qsframework.cli.numbers import numbers, point_of, wrench_of
from qsframework.cli.stop import Stopped
from qsframework.errors import InputError
from qsframework.experiment import Experiment, Readings, load_experiment, read_plan, read_readings
from qsframework.files import write_text
from qsframework.fits import FitRecord, read_fit
from qsframework.fits.soundness import check_fit
from qsframework.robot import load_robot, robot_names
from qsframework.robot.search import find_robot
from qsframework.viz import Scene, SceneSite, serve, show_scene
from qsframework.viz.subject import floating, measured, one_pose, robot_alone

_LARGEST_SCALE = 1e6
"""A micrometre as long as an arm."""


@dataclass(frozen=True, kw_only=True)
class Shown:
    """What to show: a robot or an experiment, and what the options say."""

    subject: str
    plan: Path | None = None
    fit: Path | None = None
    data: Path | None = None
    pose: str | None = None
    load: str | None = None
    point: str | None = None
    scale: float = 100.0
    anyway: bool = False

    @property
    def is_experiment(self) -> bool:
        """Whether the subject is a file that is not a robot's."""
        path = Path(self.subject)
        return self.subject not in robot_names() and path.is_file() and path.name not in ("robot.yaml", "robot.yml")

    def files(self) -> list[Path]:
        """All files that the scene is made from."""
        own = Path(self.subject) if self.is_experiment else find_robot(self.subject)
        given = [own, self.plan, self.fit, self.data]
        if self.is_experiment:
            experiment = load_experiment(self.subject)
            given += [experiment.robot.folder / "robot.yaml", *(experiment.data if self.fit else ())]
        return [path for path in dict.fromkeys(given) if path is not None]


def run_show(shown: Shown, html: Path | None, port: int) -> None:
    """Write the page, or serve it until Ctrl-C."""
    if html is not None:
        distinct_outputs([html], shown.files())
        print(f"scene: {write_text(html, make_scene(shown, print).html())}")
        return
    first = make_scene(shown, print).html  # bad input ends here, before anything listens
    pages = [first]
    site = SceneSite(lambda watch: (pages.pop() if pages else make_scene(shown).html)(watch), shown.files())
    with serve(site, port) as server:
        print(f"http://127.0.0.1:{server.server_address[1]}/ shows it, on this machine only", flush=True)
        try:
            server.serve_forever()
        except (KeyboardInterrupt, Stopped):
            print()


def make_scene(shown: Shown, say: Callable[[str], object] = lambda note: None) -> Scene:
    """Read everything and draw it; `say` is called with what could not be drawn."""
    if not 0.0 < shown.scale <= _LARGEST_SCALE:
        allowed = f"a number above 0, up to {_LARGEST_SCALE:g}; 1 shows deflections as they are"
        raise InputError(f"--scale {shown.scale:g}: allowed: {allowed}")
    experiment = _experiment(shown)
    note_folders(experiment.robot)
    pose = (
        None
        if shown.pose is None
        else experiment.robot.controller.units.si(numbers("--pose", shown.pose, (experiment.robot.controller.axes,)))
    )
    load = None if shown.load is None else wrench_of("--load", shown.load, experiment.robot)
    if shown.plan is not None and (pose is not None or shown.load is not None):
        raise InputError("a plan has its own poses and loads; leave out --pose and --load, or the plan")
    x, readings, frames = None, None, ()
    notes: list[str] = []
    if shown.data is not None and shown.fit is None:
        raise InputError("readings are shown with a fit: name a fit.json too")
    if shown.fit is not None:
        fit = read_fit(shown.fit)
        notes += check_fit(fit, experiment.robot, experiment, anyway=shown.anyway)
        x, frames = fit.x_of(experiment.model()), fit.frames
        readings, note = _readings((shown.data,) if shown.data else experiment.data, experiment, fit)
        notes += [note] if note else []
    missed = None
    if shown.plan is not None:
        plan = read_plan(shown.plan, experiment)
    elif readings is not None and x is not None and pose is None:
        plan, missed = measured(experiment, readings, x, frames)
    else:
        plan = one_pose(experiment, pose, load)
    if readings is not None and x is not None and missed is None:
        missed = floating(experiment, readings, x, frames)
    scene = show_scene(experiment, plan, x, shown.scale, missed)
    scene.notes.extend(notes)
    for note in notes:
        say(note)
    return scene


def _readings(data: Sequence[Path], experiment: Experiment, fit: FitRecord) -> tuple[Readings | None, str | None]:
    """The readings whose residuals are drawn, and what to know about them."""
    if not data:
        return None, "No residual vectors: the experiment names no readings; name a file of them too."
    readings = read_readings(data, experiment.with_(fit=fit.model_names(experiment) or None))
    if fit.account.has_used(readings):
        return readings, None
    return readings, f"The fit is not of the readings in {readings.where}, which are shown."


def _experiment(shown: Shown) -> Experiment:
    point = None if shown.point is None else point_of("--point", shown.point)
    if not shown.is_experiment:
        return robot_alone(load_robot(shown.subject), np.zeros(3) if point is None else point)
    if point is not None:
        raise InputError("--point is for a robot by itself; an experiment says where its load acts")
    return load_experiment(shown.subject)
