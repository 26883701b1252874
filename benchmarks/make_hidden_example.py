"""Make examples/hidden_effect: readings of an M-900iB whose third gear grows stiffer with torque.

    python benchmarks/make_hidden_example.py [--folder examples/hidden_effect]

The experiment file does not mention the effect; README.md says what was hidden.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import hidden
from threadpoolctl import threadpool_limits

SEED = 11
S = 20.0
PLACE = "joint_hardening[joint_3]"
README = """# Simulated readings with a hidden effect

60 poses of a FANUC M-900iB/700 with three reflectors, under a weight of 4 kN, every second pose with a side pull
of 1.5 kN as well; 0.03 mm noise on each coordinate. `experiment.yaml` describes the robot as `robots/fanuc_m900ib`
does: six joint springs, the parallelogram, the balancers and the mass compensators. The readings hold something more:

```sh
qsf diagnose examples/hidden_effect/experiment.yaml --report r.html --json r.json --extend out/
```

<details><summary>What was hidden</summary>

{truth}

Made by `python benchmarks/make_hidden_example.py`: the markers are placed by the full equilibrium under gravity and
load, with the exact law; seed {seed}.

</details>
"""
HARDENS = """The gear of joint 3 hardens: beside its compliance of {c:.4f} urad/(N m) it follows the cubic law with
{value:.3g} rad/(N m)^3, which adds {add:.2f} mrad at 10 kN m. The readings show it with s = {s:.1f}, the
norm of what it adds to them in units of noise after the springs have been fitted to it. All six compliances differ from
the nominal ones: {springs} urad/(N m) for joints 1 to 6."""


def tidy(path: Path) -> None:
    """Numbers as an instrument shows them, without columns that say nothing."""
    head, *lines = path.read_text().splitlines()
    names, *rows = [line.split(",") for line in lines]
    kept = [i for i, name in enumerate(names) if name not in ("mx_Nm", "my_Nm", "mz_Nm", "repeat", "cycle", "use")]
    text = {names.index(name) for name in ("pose", "marker")}
    shown = [[row[i] if i in text else f"{round(float(row[i]), 4):g}" for i in kept] for row in rows]
    path.write_text("\n".join([head, *(",".join(cells) for cells in ([names[i] for i in kept], *shown))]) + "\n")


def main() -> None:
    """Write the three files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--folder", type=Path, default=Path(__file__).resolve().parent.parent / "examples/hidden_effect"
    )
    given = parser.parse_args()
    case = hidden.Case("example", "example", SEED, effects=(("joint_hardening", S),), at=(PLACE,), sign=-1.0)
    with threadpool_limits(1):
        truth = hidden.hide(case)
        hidden.write_case(truth, given.folder)
    tidy(given.folder / "readings.csv")
    true = dict(zip(truth.model.names, truth.x.tolist(), strict=True))
    springs = [1e6 * true[f"joint_compliance[joint_{k}]"] for k in range(1, 7)]
    value = truth.values[PLACE]
    said = HARDENS.format(
        c=springs[2], value=value, add=1e3 * value * 1e12, s=truth.s[0], springs=", ".join(f"{c:.4f}" for c in springs)
    )
    (given.folder / "README.md").write_text(README.format(truth=said, seed=SEED))
    print(said)


if __name__ == "__main__":
    main()
