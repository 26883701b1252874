"""Laws that no effect of the library is, to try learning and its scores on. Thresholds may be chosen on these.

They are not those of `untouched.py`, which nothing is tuned on; `touched.py` holds more of them. Run by
`python benchmarks/trial_laws.py`.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from independent import Campaign, Setting, Unreachable
from independent_arm import ARMS, Arm, Array, Hidden, NoRest, Rest


@dataclass(frozen=True)
class Trial:
    """make(size) hides a law at a place, by a variable; first: a usual size."""

    make: Callable[[float], Hidden]
    place: str
    variable: str
    first: float = 1.0
    most: float = 300.0


def _gear(arm: Arm, k: int, law: Callable[[Array, Rest], Array], variable: str) -> Trial:
    def make(size: float) -> Hidden:
        def extra(still: Rest) -> Array:
            return np.eye(len(arm.links))[k] * size * law(still.torque[:, [k]], still)

        return Hidden(gears=(extra,))

    return Trial(make, f"j{k + 1}", variable)


def _full(arm: Arm, k: int) -> float:
    """A large torque, N m, on gear k."""
    return 9.81 * arm.payload * (2.0 if k < 3 else 0.5) * 0.5


def knee(arm: Arm, rng: np.random.Generator) -> Trial:
    """A gear gives more from a third of its torque on."""
    k = int(rng.integers(1, 3))
    t = _full(arm, k)
    return _gear(arm, k, lambda T, _: 2e-5 * np.maximum(np.abs(T) / t - 0.33, 0.0) * np.sign(T), "torque")


def saturation(arm: Arm, rng: np.random.Generator) -> Trial:
    """A gear gives more up to a third of its torque, and then no more."""
    k = int(rng.integers(1, 3))
    t = _full(arm, k)
    return _gear(arm, k, lambda T, _: 2e-5 * np.tanh(3.0 * T / t), "torque")


def one_side(arm: Arm, rng: np.random.Generator) -> Trial:
    """A gear gives more the one way round, with the root of its torque."""
    k = int(rng.integers(1, 3))
    t = _full(arm, k)
    return _gear(arm, k, lambda T, _: 2e-5 * np.sqrt(np.maximum(T, 0.0) / t + 1e-4), "torque")


def by_own_angle(arm: Arm, rng: np.random.Generator) -> Trial:
    """A gear gives more in a part of its turn."""
    k, phase = int(rng.integers(1, 3)), float(rng.uniform(0, 6.28))
    t = _full(arm, k)

    def law(T: Array, still: Rest) -> Array:
        return 2e-5 * T / t * np.exp(np.cos(still.angles[:, [k]] - phase) - 1.0)

    return _gear(arm, k, law, f"j{k + 1}")


def by_another_angle(arm: Arm, rng: np.random.Generator) -> Trial:
    """A gear gives more with the angle of another joint."""
    k, j = map(int, rng.choice(np.arange(1, 5), 2, replace=False))
    t, phase = _full(arm, k), float(rng.uniform(0, 6.28))

    def law(T: Array, still: Rest) -> Array:
        return 2e-5 * T / t * np.cos(2.0 * still.angles[:, [j]] + phase)

    return _gear(arm, k, law, f"j{j + 1}")


KINDS: tuple[Callable[[Arm, np.random.Generator], Trial], ...] = (
    knee,
    saturation,
    one_side,
    by_own_angle,
    by_another_angle,
)


def trials(count: int, poses: int, s: float, first: int = 0) -> Iterator[tuple[str, Campaign, Trial, float]]:
    """`count` campaigns of each kind with their size, on arms in turns."""
    for number in range(first, first + count):
        for kind in KINDS:
            rng = np.random.default_rng([number, len(kind.__name__), poses])
            for _ in range(5):
                arm = list(ARMS.values())[int(rng.integers(len(ARMS)))]
                campaign = Campaign(Setting(arm, poses, int(rng.integers(1 << 30)), loads="many"))
                try:
                    trial = kind(arm, rng)
                    yield kind.__name__, campaign, trial, campaign.sized(trial.make, s, trial.first, trial.most)
                    break
                except (Unreachable, NoRest):
                    continue


def main() -> None:
    """Answer the trials and print the scores of `second_generator.py`."""
    from second_generator import Result, Told, answer, unknown_report

    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=2)
    parser.add_argument("--poses", type=int, default=40)
    parser.add_argument("--s", type=float, default=10.0)
    given = parser.parse_args()
    results: list[Result] = []
    for name, campaign, trial, size in trials(given.count, given.poses, given.s):
        told = Told(campaign, trial.make(size), (), given.s, size, trial.place, trial.variable)
        found = answer(told, fresh=True)
        found |= {"truth": (), "group": "untouched", "place": trial.place, "variable": trial.variable}
        found |= {"poses": given.poses, "id": f"untouched/{name}"}
        results.append(found)
        print(name, campaign.setting.arm.name, trial.place, trial.variable, found.get("said"), found.get("fresh"))
        print("   ", found["verdict"], [f["name"] for f in found["findings"]], found["learned"], flush=True)
    print(unknown_report(results))


if __name__ == "__main__":
    main()
