"""What the readings tell so far: the parameters against what the plan predicted, and which poses would help most.

Too slow to stand between a reading and its answer: it is worked out beside the day, after every visit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from qsf_day.judge import Expected
from qsf_day.record import TABLE, Entry, write_readings
from qsf_day.session import Day
from qsframework.diagnoses import diagnose
from qsframework.errors import QsfError
from qsframework.experiment import Experiment, Plan, Readings, read_readings
from qsframework.experiment.finding import Finding
from qsframework.fits import Fit, identify
from qsframework.plans import design, joint_sd
from qsframework.units import JointUnits

if TYPE_CHECKING:
    from qsframework.diagnoses import Diagnosis

_ENOUGH = 1.1
"""An sd this many times the predicted one is as good as it."""
_CANDIDATES = 200
_POINTS = 12
"""Of the curves of sds against visits."""
_HELP = 3
_DIAGNOSED, _EVERY = 8, 4
"""Visits below which a diagnosis would only guess, and after how many more it looks again."""


@dataclass(frozen=True)
class Told:
    """One parameter, SI: its value and sd so far, and the sd that the whole plan predicts."""

    name: str
    unit: str
    value: float
    sd: float
    predicted: float

    @property
    def enough(self) -> bool:
        return self.sd <= _ENOUGH * self.predicted


@dataclass(frozen=True, eq=False, kw_only=True)
class SoFar:
    """visits: that it is of; fit: None where the readings give none yet, and why; help: the poses that would help most
    beside what was read; minutes: that the rest of the plan takes, and those that `help` would; causes: that the last
    diagnosis names and the model does not have; history: after so many visits, the sd that their readings predict of
    each of `told`"""

    visits: int
    fit: Fit | None
    why: str
    told: tuple[Told, ...]
    help: Plan | None
    minutes: float
    help_minutes: float
    units: JointUnits
    causes: tuple[str, ...] = ()
    history: tuple[tuple[int, tuple[float, ...]], ...] = ()

    @property
    def enough(self) -> bool:
        """Whether every parameter is told as well as the plan predicted, no cause is open, and nothing is wrong with
        the readings."""
        return bool(self.told) and all(t.enough for t in self.told) and not (self.causes or self.findings)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is wrong with the readings, or with the files of the campaign."""
        return () if self.fit is None else self.fit.account.stopping


def so_far(day: Day) -> SoFar:
    """The fit of what was accepted, beside what was predicted."""
    each = 60.0 * day.record.protocol.hours / max(len(day.record.protocol.visits), 1)
    rest = each * (len(day.record.protocol.visits) - day.visits_done)
    none = SoFar(
        visits=day.visits_done,
        fit=None,
        why="",
        told=(),
        help=None,
        minutes=rest,
        help_minutes=_HELP * each,
        units=day.record.protocol.units,
    )
    try:
        readings = accepted(day)
        fit = identify(day.experiment, readings)
    except QsfError as error:
        return replace(none, why=str(error))
    predicted = predicted_sd(day)
    told = tuple(
        Told(e.name, e.unit, e.value, sd, predicted.get(e.name, np.inf))
        for e, sd in zip(fit.estimates, fit.sd_total, strict=True)
        if e.name in predicted
    )
    history = _history(day.experiment, readings, [t.name for t in told])
    visits = history[-1][0]  # fewer than were made where states wait for a decision
    return replace(none, visits=visits, fit=fit, told=told, help=_help(day, readings), history=history)


def _history(
    experiment: Experiment, readings: Readings, names: Sequence[str]
) -> tuple[tuple[int, tuple[float, ...]], ...]:
    """How the sds fell: number of visits, and what their readings tell of each parameter; at most so many points."""
    states = readings.states
    visits = [(states.series[m], states.pose[m], int(states.repeat[m])) for m in map(int, readings.plus)]
    number = {visit: k for k, visit in enumerate(dict.fromkeys(visits), start=1)}
    own = np.array([number[visit] for visit in visits])
    at = [experiment.fit_names().index(name) for name in names]
    counts = dict.fromkeys(np.linspace(1, len(number), min(len(number), _POINTS)).round().astype(int).tolist())
    sds = (joint_sd(experiment, [readings.masked(own > count)])[at] for count in counts)
    return tuple((count, tuple(sd.tolist())) for count, sd in zip(counts, sds, strict=True))


def predicted_sd(day: Day) -> dict[str, float]:
    """The sd that each fitted parameter has when the whole protocol was read as expected."""
    return _predicted(day.expected)


@lru_cache(maxsize=1)
def _predicted(e: Expected) -> dict[str, float]:
    """The same, worked out once a day: what is expected does not change."""
    protocol = e.protocol
    place = e.model.positions(e.poses, loaded=True)
    entries = [
        Entry(
            slot=s,
            xyz={m: place[i, protocol.markers.index(m)] for m in protocol.visits[s.visit].markers},
            pendant=e.poses.pendant[i],
            wrench=e.poses.wrench[i],
            series=protocol.visits[s.visit].station,
        )
        for s, i in e.at.items()
    ]
    with TemporaryDirectory() as folder:
        whole = Path(folder) / TABLE
        write_readings(whole, protocol, entries, 0.0)
        sd = joint_sd(e.experiment, [read_readings(whole, e.experiment)])
    return dict(zip(e.experiment.fit_names(), sd.tolist(), strict=True))


def accepted(day: Day) -> Readings:
    """The readings of the day, without the states that wait for a decision, as they are read for a fit.

    InputError where nothing was read yet, or the table cannot be read.
    """
    return read_readings(day.record.table, day.experiment)


def diagnosis_so_far(day: Day) -> Diagnosis | None:
    """What the diagnosis sees so far, every few visits; None where it does not look."""
    if day.visits_done < _DIAGNOSED or (day.visits_done % _EVERY and day.next is not None):
        return None
    try:
        return diagnose(day.experiment, accepted(day), repeats=1)
    except QsfError:
        return None


def _help(day: Day, readings: Readings) -> Plan | None:
    """The few poses that would help most beside what was read; None where the readings cannot be designed upon."""
    try:
        return design(day.experiment, _HELP, "D", _CANDIDATES, taken=[readings])
    except QsfError:
        return None
