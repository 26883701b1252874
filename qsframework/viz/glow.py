"""Lights on the arm: springs by their share of what the load point moves, and the place of a named cause."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from qsframework.elastostatics import Model
from qsframework.plugin import Array, Poses, RobotFacts, Spring
from qsframework.uses.stiffness import spring_shares
from qsframework.viz.scene import Scene

SPRING = "#4b3cff"
CAUSE = "#e000a0"
CAUSE_INK = "#8f0066"
"""The same hue, dark enough for words on white."""
_SMALL = 0.005
"""Share below which a spring neither glows nor is listed."""
_RADIUS = 0.11
"""Of a light, as a part of the arm's reach."""
_MOST = 8


@dataclass(frozen=True)
class Shares:
    """What each of K springs adds to the motion of the load point: share (N, K), along that motion, and its place."""

    names: tuple[str, ...]
    places: tuple[str, ...]
    share: Array

    def largest(self, i: int) -> tuple[tuple[str, float], ...]:
        """Of pose i, the springs that give most, largest first."""
        order: list[int] = np.argsort(-self.share[i], kind="stable")[:_MOST].tolist()
        return tuple((self.names[k], float(self.share[i, k])) for k in order if self.share[i, k] >= _SMALL)


def shares(model: Model, poses: Poses, x: Array | None) -> Shares:
    """Shares by the linear model, the coordinates of one effect taken together; all 0 where nothing moves."""
    moved = spring_shares(model, poses, x)
    springs = [e for e in model.effects if isinstance(e, Spring)]
    ends = np.cumsum([len(e.compliances(model.facts)) for e in springs])
    parts = np.split(moved, ends[:-1], axis=1) if springs else []
    whole = moved.sum(axis=1)
    square = np.maximum(np.einsum("nc,nc->n", whole, whole), 1e-300)
    share = [np.einsum("nkc,nc->n", part, whole) / square for part in parts]
    where = [e.where for e in springs]
    names = tuple(e.where if e.where and where.count(e.where) == 1 else e.name for e in springs)
    return Shares(names, tuple(where), np.array(share).reshape(len(springs), len(poses)).T)


def draw_shares(scene: Scene, path: str, found: Shares, i: int, spots: Mapping[str, Array], reach: float) -> None:
    """A light at every spring of pose i that gives, as strong as its share."""
    for k, where in enumerate(found.places):
        share = float(found.share[i, k])
        if share >= _SMALL and (point := spot(where, spots)) is not None:
            strength = min(1.0, 0.25 + 0.75 * share)
            scene.glow(path, point, _RADIUS * reach * (0.4 + 0.6 * min(1.0, share)), SPRING, strength)


Suspects = Mapping[str, tuple[str, float]]
"""What may be wrong on the arm: by what is written there, the place as a file names it, such as `joint_2/link_3`, and
how brightly it shines, 0 to 1."""


def draw_suspects(scene: Scene, path: str, suspects: Suspects, spots: Mapping[str, Array], reach: float) -> None:
    """A pulsing light with its label at each that is at a place of the arm."""
    for k, (label, (where, strength)) in enumerate(suspects.items()):
        if (point := spot(where, spots)) is not None:
            scene.glow(f"{path}/{k}", point, 1.2 * _RADIUS * reach, CAUSE, strength, pulse=True)
            scene.text(f"{path}/{k}", label, point, CAUSE_INK)


def spots(facts: RobotFacts, links: Array, markers: Mapping[str, Array]) -> dict[str, Array]:
    """Joints, links and markers by name, with where they are (3,) m; links (links, 4, 4)."""
    joints = {joint: links[k + 1][:3, 3] for k, joint in enumerate(facts.turning) if k + 1 < len(links)}
    bodies = {link: links[k][:3, 3] for k, link in enumerate(facts.bodies) if k < len(links)}
    return {**bodies, **joints, **markers}


def spot(where: str, known: Mapping[str, Array]) -> Array | None:
    """The place of the first name in `joint_2/link_3` that is known."""
    return next((known[name] for name in where.split("/") if name in known), None)
