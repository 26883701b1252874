"""In which order the poses of a plan are visited: a short way, or a random order; repeats apart.

The way from one pose to the next takes as long as its slowest joint: with all joints equally fast, the largest change
of any pendant angle. A metre of a joint that slides counts as a radian, for tracks go some 1.5 m/s and axes 1.5 rad/s.
Of ways that take about as long, the one that turns the joints least spares the cables. The order is that of a
travelling salesman on an open path: nearest neighbour, then 2-opt (turn a stretch around) and or-opt (move up to three
visits elsewhere) until neither shortens it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from qsframework.experiment import Plan
from qsframework.option import check_choice
from qsframework.plans.options import Order
from qsframework.plugin import Array, Indices

_STARTS = 8
_LONGEST_STRETCH = 3
_SHORTER = 1e-9
_CABLES = 0.05
"""Share of what all joints turn that counts beside the slowest one."""


def travel(pendant: Array, other: Array) -> Array:
    """Largest change (N, M) rad of any angle from each of N poses to each of M."""
    return np.abs(pendant[:, None] - other[None]).max(axis=2)


def turning(pendant: Array, order: Sequence[int]) -> Array:
    """What each angle (n,) rad turns in all on the way through poses (N, n) in an order."""
    return np.abs(np.diff(pendant[list(order)], axis=0)).sum(axis=0)


def way_length(pendant: Array, order: Sequence[int], home: Array | None = None) -> float:
    """Length, rad of the slowest joint, of the way through poses (N, n) in an order, from `home` and back if given."""
    points = pendant[list(order)] if home is None else np.vstack([home, pendant[list(order)], home])
    return float(np.abs(np.diff(points, axis=0)).max(axis=1).sum()) if len(points) > 1 else 0.0


def with_repeats(plan: Plan, share: float, seed: int = 0) -> Plan:
    """A plan with its repeats, and one more for poses drawn until `share` of the poses have some."""
    repeats = list(plan.repeats)
    missing = int(np.ceil(share * len(repeats) - 1e-9)) - sum(r > 1 for r in repeats)
    single = [i for i, r in enumerate(repeats) if r == 1]
    for i in np.random.default_rng(seed).permutation(single)[: max(missing, 0)]:
        repeats[i] = 2
    return replace(plan, repeats=tuple(repeats))


def visits(
    plan: Plan,
    order: Order = "shortest",
    seed: int = 0,
    home: Array | None = None,
    penalty: Mapping[tuple[int, int], float] | None = None,
) -> tuple[int, ...]:
    """Poses of the plan (positions in it), each as often as it is to be measured, in the order of the visits.

    "shortest": rounds within which no pose comes twice, so that repeats stand a round apart; poses under one load stay
    together, for the load is changed by hand. "random": the same rounds in random order, which drift cannot imitate.
    Poses of one station stay together in every order.
    "plan": as the plan lists them, repeats in later rounds. `penalty` (rad) makes the way between two poses longer.
    """
    check_choice("order", Order, order)
    rng, out = np.random.default_rng(seed), list[int]()
    # rad, of each way between two poses (N, N): its slowest joint, and a little of what all turn
    turns = np.abs(plan.pendant[:, None] - plan.pendant[None])
    cost = turns.max(axis=2) + _CABLES * turns.sum(axis=2)
    for (i, j), more in (penalty or {}).items():
        cost[i, j] += more
        cost[j, i] += more
    rounds = _rounds(plan, order)
    if order == "shortest":
        ways = [_chain(plan, rounds, cost, home, rng), _chain(plan, rounds[::-1], cost, home, rng)[::-1]]
        return tuple(min(ways, key=lambda way: _cost(plan, way, cost, home)))
    for group in rounds:
        members = np.array(group)
        if order == "random":
            members = rng.permutation(members)
            if out and out[-1] == members[0]:
                members = np.roll(members, -1)
        out += members.tolist()
    return tuple(out)


def _chain(plan: Plan, rounds: list[list[int]], cost: Array, home: Array | None, rng: np.random.Generator) -> list[int]:
    """Round after round, each a short way from where the one before ended."""
    out: list[int] = []
    for group in rounds:
        members = np.array(group)
        start = _first_way(plan, members, out, cost, home)
        out += members[shortest_path(cost[np.ix_(members, members)], start, rng)].tolist()
    return out


def _cost(plan: Plan, way: list[int], cost: Array, home: Array | None) -> float:
    """Of a way, from home and back to it if there is one."""
    ends = 0.0 if home is None else float(travel(home[None], plan.pendant[[way[0], way[-1]]]).sum())
    return ends + float(cost[way[:-1], way[1:]].sum())


def _rounds(plan: Plan, order: str) -> list[list[int]]:
    """Sets of poses to visit one after the other."""
    rounds: list[list[int]] = []
    loads = plan.load if order == "shortest" else ("",) * len(plan.pose)
    under = list(zip(plan.stations, loads, strict=True))  # neither the tracker nor a load is moved for one pose
    for group in dict.fromkeys(under):
        own = [i for i in range(len(plan.pose)) if under[i] == group]
        for k in range(max(plan.repeats[i] for i in own)):
            rounds.append([i for i in own if plan.repeats[i] > k])
    return rounds


def _first_way(plan: Plan, members: Indices, out: list[int], cost: Array, home: Array | None) -> Array | None:
    """How far each member is from where the round begins; not the pose that was measured last, where possible."""
    if not out:
        return None if home is None else travel(home[None], plan.pendant[members])[0]
    first = cost[out[-1]][members].copy()
    first[members == out[-1]] += 1e3
    return first


def shortest_path(cost: Array, start: Array | None, rng: np.random.Generator) -> list[int]:
    """An order of N points on a short open path; start (N,): the way to each point from where the path begins."""
    count = len(cost)
    if count < 2:
        return list(range(count))
    W = np.zeros((count + 1, count + 1))
    W[1:, 1:] = cost
    W[0, 1:] = 0.0 if start is None else start
    # the way back to point 0 costs nothing, so a tour is an open path
    begins = rng.permutation(count)[:_STARTS] + 1
    best: list[int] = []
    for first in begins:
        tour = _improve(_greedy(W, int(first)), W)
        if not best or _length(tour, W) < _length(best, W) - _SHORTER:
            best = tour
    return [i - 1 for i in best[1:]]


def _length(tour: list[int], W: Array) -> float:
    return float(W[tour[:-1], tour[1:]].sum())


def _greedy(W: Array, first: int) -> list[int]:
    tour, left = [0, first], set(range(1, len(W))) - {first}
    while left:
        tour.append(min(left, key=lambda i: float(W[tour[-1], i])))
        left.discard(tour[-1])
    return tour


def _improve(tour: list[int], W: Array) -> list[int]:
    """Apply the best 2-opt or or-opt move until none shortens the path."""
    while True:
        gain, better = max((_turn(tour, W), _shift(tour, W)), key=lambda move: move[0])
        if gain <= _SHORTER:
            return tour
        tour = better


def _turn(tour: list[int], W: Array) -> tuple[float, list[int]]:
    """2-opt: the gain of the best stretch i..j to walk the other way round, and the tour with it."""
    t = np.array(tour)
    before, here = t[:-1], t[1:]
    after = np.append(t[2:], -1)
    end = np.where(after >= 0, 1.0, 0.0)
    old = W[before, here][:, None] + (end * W[here, after])[None, :]
    new = W[np.ix_(before, here)] + end[None, :] * W[np.ix_(here, np.maximum(after, 0))]
    gain = np.triu(old - new, 1)
    i, j = np.unravel_index(int(np.argmax(gain)), gain.shape)
    return float(gain[i, j]), tour[: i + 1] + tour[i + 1 : j + 2][::-1] + tour[j + 2 :]


def _shift(tour: list[int], W: Array) -> tuple[float, list[int]]:
    """Or-opt: the gain of the best stretch of up to three points to move elsewhere, either way round."""
    best, where = 0.0, tour
    for size in range(1, min(_LONGEST_STRETCH, len(tour) - 2) + 1):
        for i in range(1, len(tour) - size + 1):
            part, rest = tour[i : i + size], np.array(tour[:i] + tour[i + size :])
            closes = W[tour[i - 1], tour[i + size]] if i + size < len(tour) else 0.0
            opens = W[part[-1], tour[i + size]] if i + size < len(tour) else 0.0
            removed = W[tour[i - 1], part[0]] + opens - closes
            last = np.append(rest[1:], -1)
            end = np.where(last >= 0, 1.0, 0.0)
            for ends in (part, part[::-1]):
                joins = end * W[ends[-1], np.maximum(last, 0)]
                added = W[rest, ends[0]] + joins - end * W[rest, np.maximum(last, 0)]
                k = int(np.argmin(added))
                if removed - added[k] > best:
                    kept = rest.tolist()
                    best, where = float(removed - added[k]), [*kept[: k + 1], *ends, *kept[k + 1 :]]
    return best, where
