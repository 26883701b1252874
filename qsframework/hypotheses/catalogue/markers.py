"""Markers under one another's names at some visits, or everywhere; a reflector whose constant nobody set.

Two readings of one file are compared by their likelihood: where the file is right, another reading of it is better by
a factor of c in at most 1 of c cases, so n alternatives at a level a need a factor of n / a.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from qsframework.errors import listed
from qsframework.estimation import LinearFit
from qsframework.estimation.projection import least_squares
from qsframework.experiment import observation_model
from qsframework.hypotheses.hypothesis import Hypothesis
from qsframework.hypotheses.linearized import Linearized
from qsframework.plugin import Array, Indices
from qsframework.plugin.build import build_effects
from qsframework.plugin.registry import with_role
from qsframework.plugin.settings import place_fields

_SLACK = 16.0
"""How much worse, in squares of the noise, an exchange may fit than leaving out the worst of its rows."""
_MOST, _GROUPS = 100_000, 20
"""Exchanges that are tried, and those in all states of a long file."""
_NUMBERS = 5_000_000
"""In one product: large ones are taken in parts."""
_LEAST = 49.0
"""Fall of the sum of squares, in squares of the noise, below which no constant is called: s = 7."""
_FEWEST = 4
_BETTER = 12.0
"""By how much, in squares of the noise, a marker that sits elsewhere on its link must explain the readings worse."""
_RADII = (("0.5-inch", 6.35e-3), ("0.875-inch", 11.1125e-3), ("1.5-inch", 19.05e-3))
"""m: of the reflectors that laser trackers come with."""
_NEAR = 0.1e-3


def exchanged_markers(fit: Linearized, level: float) -> Hypothesis | None:
    """Two or three markers of one state, or of all states, that fit much better exchanged; None where none do."""
    readings, swapped = fit.readings, _exchanges(fit, level)
    if not swapped:
        return None
    value = np.array(readings.value)
    for order, _ in swapped:
        value[order[:, 0]] = readings.value[order[:, 1]]
    words = "; ".join(words for _, words in swapped)
    changed, tried = readings.with_values(value), 3 * len(readings.states)
    change = Hypothesis("swapped_markers", 1.0, words, fit.experiment, readings=changed, tried=tried)
    return change.at(np.unique(np.concatenate([order for order, _ in swapped])))


def _exchanges(fit: Linearized, level: float) -> list[tuple[Indices, str]]:
    """The exchanges as orders (k, 2), a row of the readings and the row whose value it should have, with words."""
    every = _together(fit)
    few = _worst(fit, every)
    orders = [order for rows in few for order in _orders(rows)]
    candidates = [*orders, *_everywhere(fit.rows.marker, orders, () if few is every else every)]
    single = len(orders)
    tried = max(len(candidates), _count(np.array([len(rows) for rows in every])), 1)
    need = 2.0 * np.log(tried / level)
    out: list[tuple[Indices, str]] = []
    able = np.ones(len(candidates), dtype=bool)
    while able.any():
        before = fit.fit.chi2
        after = np.full(len(candidates), before)
        after[able] += _changes(fit, [candidates[c] for c in np.flatnonzero(able)])
        alone = fit.fit.misfits(fit.row, len(fit.keep))
        for c in np.flatnonzero(able[:single]):
            if after[c] > before - alone[candidates[c][:, 0]].max() + _SLACK * fit.fit.unit(float(after[c])):
                after[c] = before  # one gross reading explains it as well
        best = int(np.argmin(after))
        if _gain(fit, before, float(after[best])) <= need:
            break
        chosen = candidates[best]
        out.append((fit.keep[chosen], _swap_words(fit, chosen, best < single)))
        errors = fit.rows.spread(fit.errors)
        errors[chosen[:, 0]] += _change(fit, chosen)
        fit = replace(fit, errors=fit.rows.flat(errors))
        taken = set(chosen.ravel().tolist())
        able &= np.array([not taken & set(c.ravel().tolist()) for c in candidates])
    return out


def _together(fit: Linearized) -> list[Indices]:
    """Rows of a fit that may be exchanged: whole readings of one kind in one state."""
    rows = np.flatnonzero(np.isfinite(fit.rows.measured).all(axis=1) & ~fit.readings.is_gauge[fit.keep])
    kind = 2 * fit.rows.frame[rows] + (fit.rows.minus[rows] < 0)
    label = np.unique(np.stack([fit.rows.plus[rows], kind], axis=1), axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(label, kind="stable")
    return np.split(rows[order], np.cumsum(np.bincount(label))[:-1])


def _worst(fit: Linearized, every: list[Indices]) -> list[Indices]:
    """Of rows that may be exchanged all, or of long files those that fit worst: an exchange spoils both its rows."""
    if _count(np.array([len(rows) for rows in every])) <= _MOST:
        return every
    misfit = fit.fit.misfits(fit.row, len(fit.keep))
    part = np.repeat(np.arange(len(every)), [len(rows) for rows in every])
    rows = np.concatenate(every)
    worst = np.argsort(-misfit[rows], kind="stable")
    used = bisect_left(range(len(rows)), True, key=lambda n: _count(np.bincount(part[worst[: n + 1]])) > _MOST)
    kept = np.sort(worst[:used])
    return [rows[kept[part[kept] == k]] for k in np.unique(part[kept])]


def _count(sizes: Indices) -> int:
    """Exchanges of two and of three among so many rows each."""
    return int((sizes * (sizes - 1) // 2 + sizes * (sizes - 1) * (sizes - 2) // 3).sum())


def _everywhere(marker: Indices, orders: Sequence[Indices], more: Sequence[Indices]) -> Iterator[Indices]:
    """The same exchange of markers in all states where it was tried at several; more: states in which it was not."""
    groups: dict[bytes, list[Indices]] = {}
    for order in orders:
        key = marker[order]
        groups.setdefault(key[np.argsort(key[:, 0])].tobytes(), []).append(order)
    found = sorted((group for group in groups.values() if len(group) > 1), key=len, reverse=True)
    if not len(more):
        yield from map(np.concatenate, found)
        return
    places = [dict(zip(marker[rows].tolist(), rows.tolist(), strict=True)) for rows in more]
    for group in found[:_GROUPS]:
        pairs = marker[group[0]].tolist()
        here = [p for p in places if all(a in p for a, _ in pairs)]
        yield np.array([[p[a], p[b]] for p in here for a, b in pairs])


def _gain(fit: Linearized, before: float, after: float) -> float:
    """2 log of how much likelier the readings are with a sum of squares `after` than `before`."""
    if fit.stated:
        return before - after
    return fit.fit.dof * float(np.log(max(before, 1e-300) / max(after, 1e-300)))


def _orders(rows: Indices) -> list[Indices]:
    """Exchanges of two and of three rows: (k, 2), each row and the row whose reading it should have."""
    out = [np.array([[a, b], [b, a]]) for a, b in combinations(rows.tolist(), 2)]
    for a, b, c in combinations(rows.tolist(), 3):
        out += [np.array([[a, b], [b, c], [c, a]]), np.array([[a, c], [c, b], [b, a]])]
    return out


def _change(fit: Linearized, orders: Indices) -> Array:
    """What exchanges (n, k, 2) add to the readings of their rows (n, k, 3), m."""
    measured = fit.rows.measured
    return measured[orders[..., 1]] - measured[orders[..., 0]]


def _changes(fit: Linearized, orders: Sequence[Indices]) -> Array:
    """How much the sum of squares changes with each exchange."""
    places = np.nan_to_num(fit.rows.spread(np.arange(float(len(fit.row))))).astype(np.intp)
    r, Q = fit.noise.turned(fit.fit.white), fit.noise.turned(fit.fit.Q)
    out = np.empty(len(orders))
    for k in sorted({len(o) for o in orders}):
        same = [i for i, o in enumerate(orders) if len(o) == k]
        count = max(1, _NUMBERS // (3 * k * max(Q.shape[1], 1)))
        for part in (same[i : i + count] for i in range(0, len(same), count)):
            order = np.stack([orders[i] for i in part])
            at = places[order[..., 0]].reshape(len(part), -1)
            d = _change(fit, order).reshape(len(part), -1)
            explained = np.square(np.einsum("ns,nsp->np", d, Q[at])).sum(axis=1)
            out[part] = 2.0 * (r[at] * d).sum(axis=1) + fit.noise.squares(at, d) - explained
    return out


def _swap_words(fit: Linearized, order: Indices, single: bool) -> str:
    readings = fit.readings
    at = [fit.keep[i] for i in order[:, 0]]
    said = listed([fit.experiment.markers[int(m)].name for m in np.unique(readings.marker[at])])
    where = f"pose {readings.states.pose[readings.plus[at[0]]]}" if single else "all poses"
    rows = ", ".join(str(readings.line[i]) for i in fit.keep[np.unique(order)][:6])
    return f"markers {said} are exchanged at {where} (rows {rows}): the readings fit far better if exchanged"


def marker_constant(fit: Linearized) -> Hypothesis | None:
    """The marker whose positions fit far better with another constant, None where none does or where a marker that sits
    elsewhere on its link would do the same."""
    readings, rows = fit.readings, fit.rows
    sight = rows.measured / np.maximum(np.linalg.norm(rows.measured, axis=1, keepdims=True), 1e-300)
    able = (rows.minus < 0) & np.isin(rows.frame, rows.estimated) & np.isfinite(sight).all(axis=1)
    able &= ~readings.is_gauge[fit.keep]
    markers = [m for m in np.unique(rows.marker[able]).tolist() if (able & (rows.marker == m)).sum() >= _FEWEST]
    if len(markers) < 2:  # the constant of all markers is the frame's
        return None
    columns = (rows.flat(np.where((able & (rows.marker == m))[:, None], sight, 0.0)) for m in markers)
    falls = [_fall(fit.fit, column[:, None]) for column in columns]
    best = int(np.argmax([drop for drop, _ in falls]))
    marker, (drop, (off,)) = int(markers[best]), falls[best]
    own = able & (rows.marker == marker)
    name = fit.experiment.markers[marker].name
    elsewhere, _ = _fall(fit.fit, _moved(fit, name))
    unit = fit.fit.unit(fit.fit.chi2 - drop)
    if drop < (_LEAST + 2.0 * np.log(len(markers))) * unit or elsewhere > drop - _BETTER * unit:
        return None
    at = fit.keep[own]
    value = readings.value.copy()
    value[at] -= off * sight[own]
    words, changed, tried = _described(name, off), readings.with_values(value), len(markers)
    change = Hypothesis(
        "marker_constant",
        off,
        words,
        fit.experiment,
        readings=changed,
        free=1,
        tried=tried,
    )
    return change.at(at)


def _described(marker: str, off: float) -> str:
    """In words, with the reflectors whose constants differ by so much."""
    pairs = [(a, b) for a, ra in _RADII for b, rb in _RADII if a != b and abs(abs(off) - (ra - rb)) < _NEAR]
    way = "long" if off > 0.0 else "short"
    said = f"all positions of marker {marker} are {abs(off) * 1e3:.2f} mm too {way} along the line of sight"
    said += ": its reflector has another constant"
    return said + "".join(f", as between {a} and {b} ones" for a, b in pairs[:1])


def _fall(fit: LinearFit, columns: Array) -> tuple[float, list[float]]:
    """By how much the sum of squares falls with further columns (m, k), and their coefficients (k,)."""
    beside = fit.given(columns)
    x = least_squares(beside, fit.white, 1e-6)
    return float(fit.white @ (beside @ x)), x.tolist()


def _moved(fit: Linearized, marker: str) -> Array:
    """Columns (m, 3) of a marker that sits elsewhere on its link."""
    experiment, rows = fit.experiment, fit.rows
    (kind,) = with_role("marker offset")
    names = tuple(m.name for m in experiment.markers)
    effects = build_effects({field: marker for field in place_fields(kind)}, experiment.robot.facts, names, kind)
    wide = experiment.with_effects(effects)
    wanted = [p.name for e in effects for p in e.parameters(experiment.robot.facts)]
    seen = observation_model(wide, rows.readings, wanted, linear=True, rows=rows)
    return rows.flat(rows.rates(seen.model, seen.x, seen.frames, wanted, linear=True)[1])[:, seen.motions :]
