"""What the screening says of mistakes in the table: `docs/results.md` holds the answers.

    python benchmarks/table_mistakes.py [--seeds 10] [--kinds angle,force,...] [--clean 300] [--whole 2] [--write]
    python benchmarks/table_mistakes.py --beside 100 [--seeds 4]

Campaigns of the second generator (`independent.py`), which imports nothing of the package, are written with one mistake
each; the screening sees the files alone. `--clean`: campaigns without a mistake, of all noises, and as many with a
hidden effect of s = 10; `--whole`: so many cases of each kind go through the whole diagnosis. `--beside`: mistakes of
one or two poses alone, each beside a hidden effect of so many s, by the whole diagnosis.

The size s of a mistake is the norm of what it adds to the whitened readings beyond what the fitted parameters absorb,
about the arm that the table speaks of. Below 8 it is too small to be seen, and counted apart.
"""

from __future__ import annotations

import argparse
import tempfile
import time
import zlib
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import date
from functools import cached_property
from pathlib import Path

import numpy as np
from common import machine, replace_between, shelved, table
from independent import NOISES, Campaign, Setting, Unreachable, noisy, random_poses, visits_of, write_campaign
from independent_arm import ARMS, Arm, Array, Hidden, NoRest, Visits, turn
from independent_effects import SHOWN, campaign_for, hide
from second_generator import interval

from qsframework.errors import QsfError
from qsframework.experiment import Experiment, Readings, load_experiment, read_readings
from qsframework.plugin import Indices
from qsframework.screening import Mistake, find_mistakes

PAGE = Path(__file__).resolve().parent.parent / "docs" / "results.md"
PLAIN = 8.0
Both = tuple[Visits, Visits]
Tables = list[Array]


@dataclass(frozen=True)
class Table(Campaign):
    """What the files of a campaign say: other visits than those that were measured."""

    both: Both | None = None
    states: Visits | None = None

    @cached_property
    def visits(self) -> tuple[Both | None, Visits | None]:
        """As the table has them."""
        return self.both, self.states


@dataclass(frozen=True)
class Page:
    """A table before it is written: visits of displacements and of positions, values of each; poses that are touched.

    arm: whose joints; force: what the loads were where the table says something else, of both kinds
    """

    arm: Arm
    both: Both | None
    states: Visits | None
    values: tuple[Array, ...]
    poses: frozenset[int] = frozenset()
    measured: tuple[Both | None, Visits | None] | None = None

    @property
    def numbers(self) -> list[int]:
        """Poses, in the order of the file."""
        found = [v.number for v in (self.both[1] if self.both else None, self.states) if v is not None]
        return list(dict.fromkeys(int(n) for v in found for n in v))

    def each(self, change: Callable[[Visits], Visits]) -> Page:
        """Other visits."""
        both = None if self.both is None else (change(self.both[0]), change(self.both[1]))
        return replace(self, both=both, states=None if self.states is None else change(self.states))

    def at(self, pose: int) -> list[tuple[int, Indices]]:
        """Table and visits of a pose."""
        out: list[tuple[int, Indices]] = []
        for visits in (self.both[1] if self.both else None, self.states):
            if visits is not None:
                out.append((len(out), np.flatnonzero(visits.number == pose)))
        return out

    def with_values(self, change: Callable[[int, Array], Array]) -> Page:
        """Other values of each table."""
        return replace(self, values=tuple(change(t, v.copy()) for t, v in enumerate(self.values)))


Maker = Callable[[Page, np.random.Generator], Page]


def _angles(page: Page, change: Callable[[Array, Array], Array]) -> Page:
    """Angles (V, n) and pose numbers (V,) of all visits changed."""
    return page.each(lambda v: replace(v, shown=change(v.shown.copy(), v.number)))


def _forces(page: Page, change: Callable[[Array, Array], Array]) -> Page:
    return page.each(lambda v: replace(v, force=change(v.force.copy(), v.number)))


def _one(page: Page, rng: np.random.Generator) -> int:
    return int(rng.choice(page.numbers))


def unit_of_angles(page: Page, rng: np.random.Generator) -> Page:
    k = int(rng.integers(len(page.arm.links)))
    factor = np.where(np.arange(len(page.arm.links)) == k, np.pi / 180.0, 1.0)
    return _angles(page, lambda q, _: q * factor)


def unit_of_values(page: Page, rng: np.random.Generator) -> Page:
    i, factor, one = int(rng.integers(3)), float(rng.choice([10.0, 1e3, 25.4])), int(rng.integers(len(page.values)))
    return page.with_values(lambda t, v: v / np.where(np.arange(3) == i, factor, 1.0) if t == one else v)


def unit_of_forces(page: Page, rng: np.random.Generator) -> Page:
    factor = float(rng.choice([9.80665, 1e3, 4.4482216]))
    i = int(rng.choice([1, 2]))
    return _forces(page, lambda f, _: f / np.where(np.arange(3) == i, factor, 1.0))


def sign_of_values(page: Page, rng: np.random.Generator) -> Page:
    i, one = int(rng.integers(3)), int(rng.integers(len(page.values)))
    return page.with_values(lambda t, v: v * np.where(np.arange(3) == i, -1.0, 1.0) if t == one else v)


def sign_of_angles(page: Page, rng: np.random.Generator) -> Page:
    k = int(rng.integers(len(page.arm.links)))
    sign = np.where(np.arange(len(page.arm.links)) == k, -1.0, 1.0)
    return _angles(page, lambda q, _: q * sign)


def sign_of_forces(page: Page, rng: np.random.Generator) -> Page:
    i = int(rng.choice([1, 2]))
    return _forces(page, lambda f, _: f * np.where(np.arange(3) == i, -1.0, 1.0))


def axes_of_values(page: Page, rng: np.random.Generator) -> Page:
    a, b = map(int, rng.permutation(3)[:2])
    order = np.arange(3)
    order[[a, b]] = b, a
    one = int(rng.integers(len(page.values)))
    return page.with_values(lambda t, v: v[:, :, order] if t == one else v)


def axes_of_forces(page: Page, rng: np.random.Generator) -> Page:
    order = np.array([0, 2, 1] if rng.integers(2) else [1, 0, 2])
    return _forces(page, lambda f, _: f[:, order])


def columns_of_angles(page: Page, rng: np.random.Generator) -> Page:
    a, b = map(int, rng.permutation(len(page.arm.links))[:2])
    order = np.arange(len(page.arm.links))
    order[[a, b]] = b, a
    return _angles(page, lambda q, _: q[:, order])


def one_angle(page: Page, rng: np.random.Generator) -> Page:
    """2 to 10 deg off, another sign, or a shifted decimal."""
    pose, k = _one(page, rng), int(rng.integers(len(page.arm.links)))
    way = int(rng.integers(3))
    off = np.deg2rad(rng.uniform(2.0, 10.0)) * rng.choice([-1.0, 1.0])

    def change(q: Array, number: Array) -> Array:
        here = number == pose
        q[here, k] = (q[here, k] + off, -q[here, k], 0.1 * q[here, k])[way]
        return q

    return replace(_angles(page, change), poses=frozenset([pose]))


def one_force(page: Page, rng: np.random.Generator) -> Page:
    """Ten times, another sign, or missing."""
    pose, way = _one(page, rng), int(rng.integers(3))
    i = 2 if way < 2 else 1

    def change(f: Array, number: Array) -> Array:
        here = number == pose
        f[here, i] = (10.0 * f[here, i], -f[here, i], 0.0 * f[here, i])[way]
        return f

    return replace(_forces(page, change), poses=frozenset([pose]))


def markers_everywhere(page: Page, rng: np.random.Generator) -> Page:
    a, b = map(int, rng.permutation(page.values[0].shape[1])[:2])
    order: Indices = np.arange(page.values[0].shape[1])
    order[[a, b]] = b, a
    return page.with_values(lambda t, v: v[:, order])


def markers_once(page: Page, rng: np.random.Generator) -> Page:
    pose = _one(page, rng)
    a, b = map(int, rng.permutation(page.values[0].shape[1])[:2])
    loaded = int(rng.integers(2))

    def change(t: int, v: Array) -> Array:
        for u, rows in page.at(pose):
            for r in rows[loaded % len(rows) :][:1] if u == t and len(rows) else ():
                v[r, [a, b]] = v[r, [b, a]]
        return v

    return replace(page.with_values(change), poses=frozenset([pose]))


def poses_exchanged(page: Page, rng: np.random.Generator) -> Page:
    """The readings of two poses of one table."""
    t = int(rng.integers(len(page.values)))
    visits = [v for v in (page.both[1] if page.both else None, page.states) if v is not None][t]
    one, two = rng.permutation(np.unique(visits.number))[:2]
    a, b = np.flatnonzero(visits.number == one), np.flatnonzero(visits.number == two)

    def change(u: int, v: Array) -> Array:
        if u == t:
            v[a], v[b] = v[b].copy(), v[a].copy()
        return v

    return replace(page.with_values(change), poses=frozenset([int(one), int(two)]))


def repeated(page: Page, rng: np.random.Generator) -> Page:
    """The readings of the pose before stand once more."""
    t = int(rng.integers(len(page.values)))
    visits = [v for v in (page.both[1] if page.both else None, page.states) if v is not None][t]
    names = list(dict.fromkeys(visits.number.tolist()))
    i = int(rng.integers(1, len(names)))
    a, b = np.flatnonzero(visits.number == names[i]), np.flatnonzero(visits.number == names[i - 1])

    def change(u: int, v: Array) -> Array:
        if u == t:
            v[a] = v[b]
        return v

    return replace(page.with_values(change), poses=frozenset([int(names[i])]))


def tracker(page: Page, rng: np.random.Generator) -> Page:
    """Displacements along the axes of a tracker that stands anywhere and level to 5 deg."""
    R = turn(np.array([*np.deg2rad(rng.uniform(-5, 5, 2)), rng.uniform(0.3, 3.0) * rng.choice([-1.0, 1.0])]))
    return page.with_values(lambda t, v: v @ R.T if t == 0 else v)


def states_everywhere(page: Page, rng: np.random.Generator) -> Page:
    return _states(page, None)


def states_once(page: Page, rng: np.random.Generator) -> Page:
    pose = _one(page, rng)
    return replace(_states(page, pose), poses=frozenset([pose]))


def _states(page: Page, pose: int | None) -> Page:
    def change(t: int, v: Array) -> Array:
        moved = page.both is not None and t == 0
        for n in page.numbers if pose is None else [pose]:
            for u, rows in page.at(n):
                if u == t and moved:
                    v[rows] *= -1.0
                elif u == t and len(rows) == 2:
                    v[rows] = v[rows[::-1]]
        return v

    return page.with_values(change)


def block(page: Page, rng: np.random.Generator) -> Page:
    """A run of a fifth of the poses under half the load, or from another place of the tracker."""
    names = page.numbers
    size = max(3, len(names) // 5)
    first = int(rng.integers(1, len(names) - size))
    run = names[first : first + size]
    if page.both is None and rng.integers(2):
        shift, R = rng.uniform(-0.5, 0.5, 3), turn(np.array([0.0, 0.0, rng.uniform(0.1, 0.5)]))

        def change(t: int, v: Array) -> Array:
            for n in run:
                for u, rows in page.at(n):
                    if u == t:
                        v[rows] = v[rows] @ R.T + shift
            return v

        return replace(page.with_values(change), poses=frozenset(run))
    return replace(
        _forces(page, lambda f, number: np.where(np.isin(number, run)[:, None], 0.5 * f, f)), poses=frozenset(run)
    )


def convention(page: Page, rng: np.random.Generator) -> Page:
    """The third angle is absolute where the file says relative, or the reverse."""
    sign = float(rng.choice([-1.0, 1.0]))

    def change(q: Array, number: Array) -> Array:
        q[:, 2] += sign * q[:, 1]
        return q

    return _angles(page, change)


def decimal(page: Page, rng: np.random.Generator) -> Page:
    """One cell ten times as large, or a tenth, or with another sign, or in inches."""
    t = int(rng.integers(len(page.values)))
    v, i, m = (int(rng.integers(n)) for n in (len(page.values[t]), 3, page.values[t].shape[1]))
    factor = float(rng.choice([10.0, 0.1, -1.0, 1.0 / 25.4, 0.1, 10.0]))
    visits = [w for w in (page.both[1] if page.both else None, page.states) if w is not None][t]

    def change(u: int, values: Array) -> Array:
        if u == t:
            values[v, m, i] *= factor
        return values

    return replace(page.with_values(change), poses=frozenset([int(visits.number[v])]))


def slipped(by: int) -> Maker:
    """From a pose on the angles are those of the pose before (by 1) or after (by -1)."""

    def make(page: Page, rng: np.random.Generator) -> Page:
        names = page.numbers
        first = int(rng.integers(2, len(names) - 4))
        of = dict(zip(names, names, strict=True))
        for i in range(first, len(names)):
            of[names[i]] = names[min(i - by, len(names) - 1)]

        def each(visits: Visits) -> Visits:
            at = {int(n): q for n, q in zip(visits.number, visits.shown, strict=True)}
            shown = [at.get(of[int(n)], q) for n, q in zip(visits.number, visits.shown, strict=True)]
            return replace(visits, shown=np.array(shown))

        return page.each(each)

    return make


def rounded(page: Page, rng: np.random.Generator) -> Page:
    return _angles(page, lambda q, _: np.deg2rad(np.round(np.rad2deg(q))))


def radians(page: Page, rng: np.random.Generator) -> Page:
    return _angles(page, lambda q, _: q * np.pi / 180.0)


def counted_from_zero(page: Page, rng: np.random.Generator) -> Page:
    return _angles(page, lambda q, _: np.roll(q, -1, axis=1))


def loads_exchanged(page: Page, rng: np.random.Generator) -> Page:
    """Two poses under different loads stand under each other's."""
    force: dict[int, Array] = {}
    for visits in (page.both[1] if page.both else None, page.states):
        if visits is not None:
            force |= {int(n): f for n, f in zip(visits.number, visits.force, strict=True) if f.any()}
    names = list(map(int, rng.permutation(sorted(force))))
    one = names[0]
    two = next((n for n in names if not np.allclose(force[n], force[one])), None)
    if two is None:
        raise Unreachable

    def change(f: Array, number: Array) -> Array:
        loaded = f.any(axis=1)
        for a, b in ((one, two), (two, one)):
            f[loaded & (number == a)] = force[b]
        return f

    return replace(_forces(page, change), poses=frozenset([one, two]))


def constant(page: Page, rng: np.random.Generator) -> Page:
    """One marker's reflector is of another size: its positions are off along the line of sight."""
    m = int(rng.integers(page.values[0].shape[1]))
    off = float(rng.choice([4.7625e-3, -7.9375e-3, 12.7e-3]))

    def change(t: int, v: Array) -> Array:
        if page.states is not None and t == len(page.values) - 1:
            v[:, m] += off * v[:, m] / np.linalg.norm(v[:, m], axis=1, keepdims=True)
        return v

    return page.with_values(change)


@dataclass(frozen=True)
class Kind:
    """A kind of mistake: the names that are right; which readings it is of; turned: whether it changes all angles."""

    words: str
    make: Maker
    names: tuple[str, ...]
    of: tuple[str, ...] = ("displacements", "positions", "mixed")
    turned: bool = False


UNLOADED = ("displacements", "positions")
MOVED = ("displacements", "displacements", "mixed")
KINDS = (
    Kind("unit of a column of angles", unit_of_angles, ("column_unit",)),
    Kind("unit of a column of readings", unit_of_values, ("column_unit",)),
    Kind("unit of a column of forces", unit_of_forces, ("column_unit",)),
    Kind("sign of a column of readings", sign_of_values, ("displacement_axes", "position_axes")),
    Kind("sign of a column of angles", sign_of_angles, ("joint_sign",), turned=True),
    Kind("sign of a column of forces", sign_of_forces, ("force_axes",)),
    Kind("two axes of the readings", axes_of_values, ("displacement_axes", "position_axes")),
    Kind("two axes of the force", axes_of_forces, ("force_axes",)),
    Kind("two columns of angles", columns_of_angles, ("joint_columns",), turned=True),
    Kind("one pose's angle", one_angle, ("angle",)),
    Kind("one pose's force", one_force, ("force",)),
    Kind("marker names, everywhere", markers_everywhere, ("swapped_markers",)),
    Kind("marker names, one pose", markers_once, ("swapped_markers",)),
    Kind("two poses exchanged", poses_exchanged, ("poses_exchanged",)),
    Kind("one pose's readings repeated", repeated, ("repeated_readings",)),
    Kind("tracker axes", tracker, ("tracker_axes",), ("displacements",)),
    Kind("loaded and unloaded, everywhere", states_everywhere, ("displacement_sign", "states_exchanged"), UNLOADED),
    Kind("loaded and unloaded, one pose", states_once, ("states_exchanged",), UNLOADED),
    Kind("a block of another setting", block, ("block",)),
    Kind("the third angle's convention", convention, ("controller_coupling",), turned=True),
    Kind("one cell: decimal, sign or unit", decimal, ("value",)),
    Kind("angles of the pose before, from one on", slipped(1), ("late_angles",)),
    Kind("angles of the pose after, from one on", slipped(-1), ("late_angles",)),
    Kind("angles in whole degrees", rounded, ("angles_rounded",), ("positions",), turned=True),
    Kind("all angles in radians", radians, ("column_unit",), turned=True),
    Kind("columns of angles counted from zero", counted_from_zero, ("joint_columns",), turned=True),
    Kind("loads of two poses exchanged", loads_exchanged, ("loads_exchanged", "poses_exchanged")),
    Kind("a reflector's constant", constant, ("marker_constant",), ("positions",)),
)
OF_A_POSE = ("one pose", "two poses", "one cell")
"""In the words of mistakes that touch one or two poses."""


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What was said of one case. s: size of the mistake; outcome: named, wrong, silent, refused or small; hidden: the
    effect beside it."""

    kind: str
    arm: str
    of: str
    s: float
    outcome: str
    said: tuple[str, ...]
    seconds: float
    physical: tuple[str, ...] = ()
    hidden: str = ""


def make(kind: Kind, number: int, seed: int, beside: float = 0.0) -> tuple[Campaign, Table, Page, float, str]:
    """A campaign with a mistake: what was measured, what the files say, with noise, and its size; beside: s of an
    effect that is hidden too, and its name."""
    first = [seed, zlib.crc32(kind.words.encode()), number]
    rng = np.random.default_rng(first)
    for attempt in range(100):
        arm = list(ARMS.values())[int(rng.integers(len(ARMS)))]
        of = kind.of[number % len(kind.of)]
        setting = Setting(
            arm, (40, 24, 60)[number % 3], int(rng.integers(1 << 30)), of, loads=("two", "many")[number % 2]
        )
        effect, name = Hidden(), ""
        try:
            setting = replace(setting, plan=readable(kind, setting, [*first, attempt]))
            campaign = Campaign(setting)
            if beside:
                shown = SHOWN[of]
                found, amount = hide(campaign, shown[(number + attempt) % len(shown)], beside, rng)
                effect, name = found.make(amount), found.name
            clean = campaign.clean(effect)
            pages = [
                kind.make(Page(arm, *campaign.visits, values), np.random.default_rng([*first, attempt]))
                for values in (clean, noisy(campaign, clean))
            ]
            told = Table(setting, pages[0].both, pages[0].states)
            more = told.whiten(pages[0].values) - told.whiten(told.clean(effect))
            size = float(np.linalg.norm(more - told.fitted @ (told.fitted.T @ more)))
        except (NoRest, Unreachable, FloatingPointError, np.linalg.LinAlgError):
            continue
        if np.isfinite(size):
            return campaign, told, pages[1], size, name
    raise Unreachable


_DRAWN = 4000
"""Poses from which those are taken that the controller would also show with the mistake."""


def readable(kind: Kind, setting: Setting, seed: Sequence[int]) -> Array | None:
    """A plan whose angles the reader takes with the mistake too, else it speaks first; Unreachable without one."""
    if not kind.turned:
        return None
    arm = setting.arm
    many = replace(setting, poses=_DRAWN, kind="displacements", noise="nominal")
    plan = random_poses(many, np.random.default_rng(seed))
    both, _ = visits_of(replace(many, plan=plan))
    assert both is not None
    page = kind.make(Page(arm, both, None, (np.zeros((_DRAWN, 3, 3)),)), np.random.default_rng(seed))
    assert page.both is not None
    low, high = (np.deg2rad([link.limits[e] for link in arm.links]) for e in (0, 1))
    shown = page.both[1].shown
    inside = ((shown >= low) & (shown <= high)).all(axis=1)
    if arm.lever:
        inside &= np.cos(arm.joints(shown)[:, 2]) >= 0.25
    if inside.sum() < setting.poses:
        raise Unreachable
    return plan[inside][: setting.poses]


def files(campaign: Campaign, told: Campaign, values: Sequence[Array], folder: Path) -> tuple[Experiment, Readings]:
    """Written and read again."""
    experiment = load_experiment(write_campaign(told, values, folder))
    return experiment, read_readings(experiment.data, experiment)


def ask(kind: Kind, number: int, seed: int, whole: bool, beside: float = 0.0) -> Answer:
    """What is said of one case."""
    campaign, told, page, size, name = make(kind, number, seed, beside)
    setting = campaign.setting
    start = time.process_time()
    physical: tuple[str, ...] = ()
    with tempfile.TemporaryDirectory() as folder:
        try:
            experiment, readings = files(campaign, told, page.values, Path(folder))
            if whole:
                from qsframework.diagnoses import diagnose

                found = diagnose(experiment, readings)
                conventions = found.conventions
                own = {c.name for c in conventions}
                physical = tuple(f.name for f in found.sure if f.name not in own)
            else:
                conventions = find_mistakes(experiment, readings, gross=False)
        except QsfError as error:
            return Answer(
                kind=kind.words,
                arm=setting.arm.name,
                of=setting.kind,
                s=size,
                outcome="refused",
                said=(str(error).splitlines()[0][-100:],),
                seconds=time.process_time() - start,
            )
    called = [c for c in conventions if c.compelling]
    return Answer(
        kind=kind.words,
        arm=setting.arm.name,
        of=setting.kind,
        s=size,
        outcome=outcome(kind, page, size, called, readings),
        said=tuple(f"{c.name} {c.column} {c.rows[:3]}" for c in called),
        seconds=time.process_time() - start,
        physical=physical,
        hidden=name,
    )


def outcome(kind: Kind, page: Page, size: float, called: Sequence[Mistake], readings: Readings) -> str:
    """named: all that is called is of the right kind and of the rows of the right poses."""
    if not called:
        return "silent" if size >= PLAIN else "small"
    files = [readings.sources[int(f)].name if len(readings.sources) > 1 else "" for f in readings.file]
    pose = {
        (file, int(line)): int(name[1:]) - 1
        for file, line, name in zip(files, readings.line, readings.pose, strict=True)
    }
    for c in called:
        right = bool({name.partition("[")[0] for name in c.kinds or (c.name,)} & set(kind.names))
        if page.poses and c.rows:
            right &= {pose[c.file, r] for r in c.rows} <= page.poses
        if not right:
            return "wrong"
    return "named" if size >= PLAIN else "small, named"


@dataclass(frozen=True)
class Clean:
    """A campaign without a mistake: what is said of it."""

    noise: str
    hidden: str
    said: tuple[str, ...]


def clean(number: int, seed: int, hidden: bool) -> Clean | None:
    """What is said of a campaign without a mistake; hidden: with an effect of s = 10. None where none shows as much."""
    rng = np.random.default_rng([seed, number, 77 + hidden])
    noise = "nominal" if hidden and number % 2 else NOISES[number % len(NOISES)]
    arms = list(ARMS.values())
    of = ("displacements", "displacements", "positions", "mixed")[int(rng.integers(4))]
    poses = (12, 14, 24, 40, 60)[int(rng.integers(5))]
    draw = int(rng.integers(1 << 30))
    effect = Hidden()
    name = ""
    if hidden:
        places = SHOWN[of][number % len(SHOWN[of])]
        for a in map(int, rng.permutation(len(arms))):
            campaign = Campaign(campaign_for(of, arms[a], poses, draw, noise))
            try:
                found, size = hide(campaign, places, 10.0, rng)
            except (Unreachable, NoRest):
                continue
            effect, name = found.make(size), found.name
            break
        else:
            return None
    else:
        campaign = Campaign(campaign_for(of, arms[int(rng.integers(len(arms)))], poses, draw, noise))
    with tempfile.TemporaryDirectory() as folder:
        values = noisy(campaign, campaign.clean(effect))
        try:
            experiment, readings = files(campaign, campaign, values, Path(folder))
            called = [c for c in find_mistakes(experiment, readings, gross=False) if c.compelling]
        except QsfError as error:
            return Clean(f"{noise}, {of}", name, (f"refused: {error}"[:80],))
    return Clean(f"{noise}, {of}, {poses}", name, tuple(f"{c.name} {c.column} {c.rows[:3]}" for c in called))


# ---------------------------------------------------------------- tables


def share(hits: int, count: int) -> tuple[str, str]:
    """Of count, and its interval."""
    low, high = interval(hits, count)
    return f"{100 * hits / count:.1f} %", f"{100 * low:.1f} - {100 * high:.1f} %"


def tables(answers: Sequence[Answer], plain: Sequence[Clean], hiding: Sequence[Clean]) -> str:
    """The goals, and each kind."""
    seen = [a for a in answers if a.outcome not in ("small", "small, named")]
    goals: list[tuple[str, ...]] = []
    for words, goal, hits, count in (
        (
            "mistakes of s >= 8 named, or refused by the reader",
            ">= 95 %",
            sum(a.outcome in _RIGHT for a in seen),
            len(seen),
        ),
        ("of these called something else", "-", sum(a.outcome == "wrong" for a in seen), len(seen)),
        ("clean tables called mistaken", "<= 1 %", sum(bool(c.said) for c in plain), len(plain)),
        ("a hidden effect of s = 10 called a mistake", "<= 1 %", sum(bool(c.said) for c in hiding), len(hiding)),
    ):
        if count:
            goals.append((words, goal, *share(hits, count), str(count)))
    out = table(("metric", "goal", "measured", "95 %", "cases"), goals)
    rows: list[tuple[str, ...]] = []
    for words in dict.fromkeys(a.kind for a in answers):
        own = [a for a in answers if a.kind == words]
        told = Counter(a.outcome for a in own)
        small = told["small"] + told["small, named"]
        rest = len(own) - small
        right = told["named"] + told["refused"]
        rows.append((words, str(len(own)), str(small), f"{right} of {rest}", share(right, rest)[1] if rest else "-"))
        rows[-1] += (str(told["refused"]), str(told["silent"]), str(told["wrong"]))
    head = ("kind", "cases", "too small to see", "named", "95 %", "by the reader", "not seen", "called otherwise")
    return f"{out}\n\n{table(head, rows)}"


_RIGHT = ("named", "refused")


def main() -> None:
    """Run, print, and write where asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10, help="cases of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", default="", help="parts of the names of kinds, comma between")
    parser.add_argument("--clean", type=int, default=0, help="campaigns without a mistake")
    parser.add_argument("--whole", type=int, default=0, help="cases of each kind by the whole diagnosis")
    parser.add_argument("--beside", type=float, default=0.0, help="s of an effect hidden beside each mistake")
    parser.add_argument("--write", action="store_true", help="write the tables to docs/results.md")
    given = parser.parse_args()
    parts = [p for p in given.kinds.split(",") if p]
    answers: list[Answer] = []
    for kind in KINDS:
        if parts and not any(p in kind.words for p in parts):
            continue
        if given.beside and not any(w in kind.words for w in OF_A_POSE):
            continue
        for number in range(given.seeds):
            try:
                a = ask(kind, number, given.seed, bool(given.beside) or number < given.whole, given.beside)
            except Unreachable:
                continue
            answers.append(a)
            said = "; ".join(a.said) + (f"  PHYSICAL {a.physical}" if a.physical else "")
            said += f"  HIDDEN {a.hidden}" if a.hidden else ""
            print(
                f"{a.outcome:9s} {a.kind:32s} {a.arm:7s} {a.of:13s} s={a.s:9.1f} {a.seconds:5.1f} s  {said}", flush=True
            )
    plain, hiding = (
        [c for n in range(given.clean) if (c := clean(n, given.seed, hidden)) is not None] for hidden in (False, True)
    )
    for c in (*plain, *hiding):
        if c.said:
            print("CLEAN", c)
    text = tables(answers, plain, hiding)
    asked = [a for k in {a.kind for a in answers} for a in [x for x in answers if x.kind == k][: given.whole]]
    bad = sum(bool(a.physical) for a in asked)
    if given.beside:
        both = sum(a.hidden in a.physical for a in answers)
        text += f"\n\nThe hidden effect is named beside it in {both} of {len(answers)}."
    elif asked:
        text += f"\n\nBy the whole diagnosis: {len(asked)} cases, a physical cause named beside or in place of {bad}."
    print(text)
    if given.write:
        when = (
            f"`python benchmarks/table_mistakes.py --seeds {given.seeds} --clean {given.clean} --whole {given.whole}`"
        )
        head = f"{when}; {date.today().isoformat()}; {machine()}."
        record = f"{head}\n\n{shelved(text, 'diagnosis mistakes')}"
        replace_between(PAGE, "<!-- table mistakes -->", "<!-- end of table mistakes -->", record)


if __name__ == "__main__":
    main()
