"""Readings of every kind are read back as they were written: displacements, positions, gauges, single axes."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from qsframework.errors import InputError
from qsframework.experiment import Experiment, Readings, States, read_readings, write_readings
from qsframework.experiment.readings import joined
from qsframework.plugin import Array, Conditions, Indices, Poses

SAME_FOLDER = settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def near(a: Any, b: Any) -> bool:
    return a is b if a is None or b is None else bool(np.allclose(a, b, rtol=1e-9, atol=1e-18, equal_nan=True))


def conditions(rng: np.random.Generator, count: int) -> Conditions:
    return Conditions(rng.uniform(0, 1e4, count), rng.uniform(280, 310, count), rng.choice([-1.0, 1.0], count))


def aimed(rng: np.random.Generator, rows: int, markers: Indices, count: int) -> tuple[Array, Indices]:
    """Axes of `rows` readings, and to which marker they measure: a gauge's direction, a distance, or three axes."""
    axes, to = np.tile(np.eye(3), (rows, 1, 1)), np.full(rows, -1)
    for i, kind in enumerate(rng.integers(0, 3, rows)):
        if kind == 1:
            axes[i] = np.linalg.qr(rng.normal(size=(3, 3)))[0].T
        elif kind == 2:
            to[i] = (markers[i] + 1) % count
    return axes, to


def readings(
    experiment: Experiment,
    states: States,
    plus: Indices,
    minus: Indices,
    series: str,
    gauges: bool,
    rng: np.random.Generator,
    size: float,
) -> Readings:
    """Every marker in the states `plus`, with holes where an axis was not measured."""
    names = [m.name for m in experiment.markers]
    each, rows = len(names), len(plus) * len(names)
    marker = np.tile(np.arange(each), len(plus))
    axes, to = aimed(rng, rows, marker, each) if gauges else (None, np.full(rows, -1))
    value = rng.normal(0.0, size, (rows, 3))
    if axes is not None:
        gauge = (to >= 0) | np.any(axes != np.eye(3), axis=(1, 2))
        value[gauge, 1:] = np.nan
    value[::4, 1] = np.nan
    position = bool((minus < 0).all())
    given = np.array([bool(series or position)] * rows) & (True if axes is None else ~gauge)
    frames = (series,) if given.any() else ()
    return Readings(
        states=states,
        plus=np.repeat(plus, each),
        minus=np.repeat(minus, each),
        marker=marker,
        frame=np.where(given, 0, -1),
        frames=frames,
        known=(None,) * len(frames),
        value=value,
        sigma=np.repeat(rng.uniform(1e-6, 1e-4, rows)[:, None], 3, axis=1),
        minus_sigma=np.full((rows, 3), np.nan),
        stated=True,
        use=rng.random(rows) < 0.8,
        line=np.arange(3, 3 + rows),
        file=np.zeros(rows, dtype=np.intp),
        to=to,
        axes=axes,
        drive_state=tuple(f"servo {i}" for i in range(rows)) if series else None,
    )


def displaced(experiment: Experiment, count: int, seed: int, shared: bool, gauges: bool) -> Readings:
    """Visits with an unloaded state each, or two visits with one unloaded state."""
    rng = np.random.default_rng(seed)
    controller = experiment.robot.controller
    pendant = rng.uniform(controller.lower, controller.upper, (count, len(controller.lower)))
    wrench = rng.normal(0.0, 10.0 ** rng.integers(-3, 5), (count, 6))
    before = np.arange(count) // 2 if shared else np.arange(count)
    first = np.array([np.flatnonzero(before == k)[0] for k in range(before[-1] + 1)])
    rows = np.concatenate([np.arange(count), first])
    pendant = pendant[first][before]  # an unloaded reading is of one pose
    loaded = np.arange(len(rows)) < count
    side = conditions(rng, count)
    own = conditions(rng, len(rows))
    own = dataclasses.replace(own, approach=side.approach[rows]) if side.approach is not None else own
    kept = own if seed % 2 else Conditions()
    used_twice = np.bincount(before) > 1
    states = States(
        poses=Poses(
            pendant[rows], controller.to_joints(pendant)[rows], np.where(loaded[:, None], wrench[rows], 0.0), kept, kept
        ),
        loaded=loaded,
        pose=tuple(f'p{i // 2}, "{i // 2}"' for i in rows.tolist()),
        load_id=("",) * count + tuple(f"zero {k}" if twice else "" for k, twice in enumerate(used_twice)),
        series=("",) * len(rows),
        repeat=rows % 2 + 1,
        cycle=np.ones(len(rows), dtype=np.intp),
    )
    if shared:  # the reading at an unloaded state that visits share is of one time
        assert used_twice.any() or count == 1
    return readings(experiment, states, np.arange(count), count + before, "t" if seed % 3 else "", gauges, rng, 1e-3)


def stood(experiment: Experiment, count: int, seed: int, loads: bool, gauges: bool) -> Readings:
    """Every pose once unloaded and, with loads, under two loads; where the arm puts its markers."""
    rng = np.random.default_rng(seed)
    controller, each = experiment.robot.controller, 3 if loads else 1
    total = count * each
    pendant = np.repeat(rng.uniform(controller.lower, controller.upper, (count, len(controller.lower))), each, axis=0)
    loaded = np.tile([False, True, True][:each], count)
    wrench = np.where(loaded[:, None], rng.normal(0.0, 1e3, (total, 6)), 0.0)
    own = conditions(rng, total) if loads else Conditions()
    name = "s" if loads else ""
    states = States(
        poses=Poses(pendant, controller.to_joints(pendant), wrench, own, own),
        loaded=loaded,
        pose=tuple(f'p{i // each}, "x"' for i in range(total)),
        load_id=tuple(("", "A", "B")[i % each] for i in range(total)),
        series=(name,) * total,
        repeat=np.ones(total, dtype=np.intp),
        cycle=np.ones(total, dtype=np.intp),
    )
    out = readings(experiment, states, np.arange(total), np.full(total, -1), name, gauges, rng, 1.0)
    place = experiment.model().positions(states.poses).reshape(-1, 3) @ np.linalg.qr(rng.normal(size=(3, 3)))[0] + 3.0
    return out.with_values(place)


def same(after: Readings, before: Readings) -> None:
    for name in ("frames", "known", "stated", "drive_state", "to", "plus", "minus", "marker", "frame", "use", "line"):
        a, b = getattr(after, name), getattr(before, name)
        assert np.array_equal(a, b) if isinstance(b, np.ndarray) else a == b, name
    for name in ("value", "sigma", "minus_sigma"):
        assert near(getattr(after, name), getattr(before, name)), name
    assert np.array_equal(after.is_gauge, before.is_gauge)
    if before.axes is not None and before.is_gauge.any():
        assert after.axes is not None
        assert near(after.axes[:, 0], before.axes[:, 0])
        assert np.allclose(after.axes @ after.axes.swapaxes(1, 2), np.eye(3), atol=1e-12)
    a, b = after.states, before.states
    for name in ("pose", "load_id", "series"):
        assert getattr(a, name) == getattr(b, name), name
    for name in ("loaded", "repeat", "cycle"):
        assert np.array_equal(getattr(a, name), getattr(b, name)), name
    for name in ("pendant", "q", "wrench"):
        assert np.allclose(getattr(a.poses, name), getattr(b.poses, name), rtol=1e-9, atol=1e-15), name
    for name in ("time", "temperature", "approach"):
        values = [getattr(c, name) for c in (a.poses.unloaded, a.poses.loaded, b.poses.loaded)]
        assert near(values[0], values[2]), name
        assert near(values[1], values[2]), name
    assert a.poses.loaded.order is not None, "from where the rows stand"


def again(path: Path, after: Readings, experiment: Experiment) -> None:
    """Written once more it is the same text; directions are made of unit length, which moves their last digit."""
    once = path.read_text()
    write_readings(path, after, experiment)
    assert path.read_text() == once or after.is_gauge.any()
    same(read_readings(path, experiment, states="positions"), after)


@SAME_FOLDER
@given(st.integers(1, 6), st.integers(0, 10**6), st.booleans(), st.booleans())
def test_displacements(m900ib: Experiment, tmp_path: Path, count: int, seed: int, shared: bool, gauges: bool) -> None:
    before = displaced(m900ib, count, seed, shared, gauges)
    path = tmp_path / "readings.csv"
    write_readings(path, before, m900ib)
    after = read_readings(path, m900ib)
    same(after, before)
    assert after.sources == (path,)
    again(path, after, m900ib)


@SAME_FOLDER
@given(st.integers(1, 5), st.integers(0, 10**6), st.booleans(), st.booleans())
def test_positions(m900ib: Experiment, tmp_path: Path, count: int, seed: int, loads: bool, gauges: bool) -> None:
    before = stood(m900ib, count, seed, loads, gauges)
    if gauges:  # a gauge that points somewhere needs a zero; a distance has one
        before = before.masked(before.is_gauge & (before.to < 0))
    path = tmp_path / "states.csv"
    write_readings(path, before, m900ib)
    assert ("fx_N" in path.read_text()) == loads
    after = read_readings(path, m900ib, states="positions")
    same(after, before)
    again(path, after, m900ib)


def test_two_kinds_are_two_files(m900ib: Experiment, tmp_path: Path) -> None:
    both = joined([displaced(m900ib, 2, 1, False, False), stood(m900ib, 2, 1, True, False)])
    with pytest.raises(InputError, match="positions and displacements are two files; write them one by one"):
        write_readings(tmp_path / "both.csv", both, m900ib)
    assert not list(tmp_path.iterdir())
