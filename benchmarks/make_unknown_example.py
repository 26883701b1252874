"""Make examples/unknown_effect: readings of an arm with an effect that no library holds, by the second generator.

    python benchmarks/make_unknown_example.py [--folder examples/unknown_effect]

The fifth gear is driven by a shaft through the forearm that is a little bent: how much it gives goes twice through its
course per turn of joint 4. No effect of the library depends on such an angle; README.md shows what was learned of it.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import re
import shlex
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from independent import Campaign, Setting, noisy, random_poses, write_campaign
from independent_arm import HEAVY, Array, Hidden, Rest

SEED, POSES, S = 5, 40, 25.0
SOFTER, PHASE = 1.0e-7, 0.6
GEAR, BY, NAME = 4, 3, "learned[j5/j4]"
TORQUE = 1000.0
"""N m, for which the curve is told."""
WRITTEN = "--json unknown.json --report unknown.html --extend unknown"
FEW, MORE = 8, 8
ASK = "qsf diagnose examples/unknown_effect/experiment.yaml examples/unknown_effect/first_day.csv --follow-up 8"
AGAIN = (
    "qsf diagnose examples/unknown_effect/experiment.yaml examples/unknown_effect/first_day.csv "
    "examples/unknown_effect/second_day.csv --json both_days.json"
)
EXTEND = f"qsf diagnose examples/unknown_effect/experiment.yaml {WRITTEN}"
README = """# Readings whose cause is not in the library

{poses} poses of a heavy six-axis arm with three reflectors under two loads; 0.03 mm noise on each coordinate. The
readings were made by a code that shares nothing with this one, and hold an effect that no effect of the library is:

```sh
{extend}
```

Nothing is named. What is left sits at the fifth drive and goes with the angle of joint 4; its law is learned, and the
held-out error is smaller with it:

```text
{said}
```

The curve, more give of the drive under {torque:g} N m, urad, beside its spring, which takes the mean; the report
draws it with its band:

| joint 4, deg | {angles} |
|---|{rules}|
| learned | {learned} |
| its sd | {sds} |
| hidden | {hidden} |

`--extend` wrote the arm with the law. Fit it again, its weights pulled by the prior that stands in its file, and
correct targets by it. The third target turns joint 4 beyond what the readings had, and that is said:

```sh
qsf identify unknown/experiment.yaml --json unknown_fit.json --report unknown_fit.html
qsf compensate unknown/experiment.yaml unknown_fit.json examples/unknown_effect/targets.csv -o unknown_corrected.csv
```

```text
{note}
```

## With eight poses, and a second day

The first {few} of these poses show something at the fifth drive, and the likeliest law there is one of several.
`--follow-up` chooses the visits of a second day, two of them repeats, that settle it:

```sh
{ask}
```

```text
{chances}
```

The same arm was measured at these visits. Both days in one call settle place and variable, and the law is learned from
{both} poses:

```sh
{again}
```

```text
{settled}
```

<details><summary>What was hidden</summary>

The fifth gear gives {size:.3g} urad/(N m) times cos(2 q4 + {phase}) more than its spring, as where the shaft that
drives it through the forearm is bent. The readings show it with s = {s:.1f}, the norm of what it adds to them in units
of noise after the springs have been fitted to it.

Made by `python benchmarks/make_unknown_example.py`; seed {seed}.

</details>
"""


def bent(size: float) -> Hidden:
    """The fifth gear gives more, by the angle of the fourth joint."""

    def law(still: Rest) -> Array:
        more = size * SOFTER * np.cos(2.0 * still.angles[:, [BY]] + PHASE)
        return np.eye(6)[GEAR] * still.torque[:, [GEAR]] * more

    return Hidden(gears=(law,))


def campaign() -> Campaign:
    """Joint 4 turns by 115 deg to each side, as far as a hose lets it."""
    setting = Setting(HEAVY, POSES, SEED)
    shown = random_poses(setting, np.random.default_rng(SEED))
    turned = np.linspace(-115.0, 115.0, POSES)[np.random.default_rng(1).permutation(POSES)]
    shown[:, BY] = np.deg2rad(np.round(turned, 3))
    return Campaign(Setting(HEAVY, POSES, SEED, plan=shown))


def targets(made: Campaign, path: Path) -> None:
    """Three of the poses, the last with joint 4 beyond what was measured."""
    assert made.setting.plan is not None
    shown = np.rad2deg(made.setting.plan[:3])
    shown[2, BY] = 165.0
    weight = -0.9 * 9.81 * HEAVY.payload
    with path.open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["target", *(f"q{k}_deg" for k in range(1, 7)), "fx_N", "fy_N", "fz_N"])
        for name, q in zip(("near", "far", "beyond"), shown, strict=True):
            rows.writerow([name, *(f"{a:.3f}" for a in q), 0, 0, f"{weight:.1f}"])


def two_days(made: Campaign, size: float, folder: Path) -> None:
    """The first poses as a day of their own, and the visits that its diagnosis asks for, measured by the same arm."""
    from qsframework.diagnoses import diagnose, follow_up
    from qsframework.experiment import load_experiment, read_readings

    assert made.setting.plan is not None
    first = Campaign(replace(made.setting, poses=FEW, plan=made.setting.plan[:FEW]))
    _day(first, size, made, folder / "first_day.csv", 0)
    experiment = load_experiment(folder / "experiment.yaml")
    asked = follow_up(diagnose(experiment, read_readings([folder / "first_day.csv"], experiment)), MORE)
    visits = first.visits[0]
    assert visits is not None
    plan = np.concatenate([visits[1].shown, np.deg2rad(np.round(np.rad2deg(asked.plan.pendant), 3))])
    pull = np.concatenate([visits[1].force, asked.plan.wrench[:, :3]])
    both = Campaign(replace(made.setting, poses=FEW + MORE, plan=plan, pull=pull))
    _day(both, size, made, folder / "second_day.csv", FEW)


def _day(day: Campaign, size: float, made: Campaign, path: Path, first: int) -> None:
    """The readings of a day from a pose on."""
    with tempfile.TemporaryDirectory() as away:
        write_campaign(day, noisy(day, day.clean(bent(size), made.built)), Path(away))
        head, *rows = (Path(away) / "weights.csv").read_text().splitlines()
    path.write_text("\n".join([head, *(row for row in rows if int(row.split(",")[0][1:]) > first)]) + "\n")


def main() -> None:
    """Write the readings, run what the README runs, and write down what it says."""
    from typer.testing import CliRunner

    from qsframework.cli.app import app
    from qsframework.diagnoses import diagnose
    from qsframework.diagnoses.learn import curve
    from qsframework.experiment import load_experiment, read_readings

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    root = Path(__file__).resolve().parent.parent
    parser.add_argument("--folder", type=Path, default=root / "examples/unknown_effect")
    folder = parser.parse_args().folder
    made = campaign()
    size = made.sized(bent, S, 1.0, 30.0)
    path = write_campaign(made, noisy(made, made.clean(bent(size))), folder)
    targets(made, folder / "targets.csv")
    two_days(made, size, folder)
    experiment = load_experiment(path)
    found = diagnose(experiment, read_readings(experiment.data, experiment))
    assert found.learned is not None
    assert found.learned.name == NAME
    seen = curve(found.learned, experiment.robot.facts)
    assert seen is not None
    angles = np.deg2rad(np.arange(-105, 106, 30))
    per = 1e6 * TORQUE / seen.torque
    learned, sd = (per * np.interp(angles, seen.x, v[:, 0]) for v in (seen.motion, seen.sd))
    whole = np.cos(2.0 * seen.x + PHASE)
    hidden = 1e6 * TORQUE * size * SOFTER * (np.cos(2.0 * angles + PHASE) - whole.mean())

    def listed(values: Array, digits: int = 0) -> str:
        return " | ".join(f"{v:+.{digits}f}" for v in values)

    with tempfile.TemporaryDirectory() as away:
        commands = [EXTEND.replace("examples/unknown_effect", str(folder))]
        commands.append("qsf identify unknown/experiment.yaml --json unknown_fit.json --report unknown_fit.html")
        corrected = f"qsf compensate unknown/experiment.yaml unknown_fit.json {folder}/targets.csv -o corrected.csv"
        commands.append(corrected)
        commands += [c.replace("examples/unknown_effect", str(folder)) for c in (ASK, AGAIN)]
        runner = CliRunner()
        said = [_run(runner, app, command, Path(away)) for command in commands]
    note = next(line for line in said[2].splitlines() if "was learned between" in line)
    law = re.search(rf"As {re.escape(NAME)} its law was learned.*?found\.", " ".join(said[0].split()))
    text = README.format(
        poses=POSES,
        extend=EXTEND,
        said=law.group(0) if law else said[0],
        torque=TORQUE,
        angles=listed(np.rad2deg(angles)),
        rules="---|" * (len(angles) - 1) + "---",
        learned=listed(learned),
        sds=" | ".join(f"{v:.0f}" for v in sd),
        hidden=listed(hidden),
        note=note,
        few=FEW,
        both=FEW + MORE,
        ask=ASK,
        again=AGAIN,
        chances=next(x for x in said[3].splitlines() if "visits bring the chance" in x),
        settled=said[4].splitlines()[0],
        size=1e6 * size * SOFTER,
        phase=PHASE,
        s=made.s(bent(size)),
        seed=SEED,
    )
    (folder / "README.md").write_text(text)
    print(text)


def _run(runner: Any, app: Any, command: str, folder: Path) -> str:
    with contextlib.chdir(folder):
        done = runner.invoke(app, shlex.split(command)[1:], env={"COLUMNS": "400", "TERMINAL_WIDTH": "400"})
    assert done.exit_code == 0, done.output
    return done.stdout


if __name__ == "__main__":
    main()
