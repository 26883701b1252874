"""Robot files as strangers bring them, from qsf new over a small campaign to the export of its plan.

    python benchmarks/strangers.py [--only NAME ...] [--write]

About five minutes. `--write` writes benchmarks/strangers.md.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from datetime import date
from pathlib import Path

from common import machine

from qsframework.files import write_text

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "robots"))

from strangers import Stranger  # noqa: E402
from strangers_chain import COMMANDS, EVERY, Step, chain  # noqa: E402

PAGE = ROOT / "benchmarks" / "strangers.md"
HEAD = """# Strangers' files

Robot files as people bring them. Each is built as public descriptions of the maker named are, written anew with other
numbers (`tests/robots/strangers.py` and `strangers_more.py`), and goes through what a user types: `qsf new`,
`qsf check --conformance`, `qsf design`, `simulate`, `identify`, `diagnose`, `export --to csv`. What is refused is
refused by `qsf new`, with what to do instead, or, of a balancer that is drawn without its stiffness, by `qsf check`,
which names the values to state: a campaign on the arm without it would be of another arm. [Add your
robot](../docs/add-a-robot.md) says what happens to such files.

"""


def main() -> None:
    """Print the table, or write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", default=[], help="names of strangers")
    parser.add_argument("--write", action="store_true", help="write benchmarks/strangers.md")
    options = parser.parse_args()
    lines = ["| file | angles | what happened | `qsf new`, CPU s | all, CPU s |", "|---|---|---|---|---|"]
    for stranger in EVERY:
        if options.only and stranger.name not in options.only:
            continue
        with tempfile.TemporaryDirectory() as folder:
            steps = list(chain(stranger, Path(folder)))
            lines.append(row(stranger, steps, folder))
        print(lines[-1], flush=True)
    if options.write:
        told = f"\nMade on {date.today():%Y-%m-%d}, {machine()}, by `python benchmarks/strangers.py --write`.\n"
        told += "All went through one process: a `qsf new` of its own takes half a second more, to start.\n"
        write_text(PAGE, HEAD + "\n".join(lines) + "\n" + told)


def row(stranger: Stranger, steps: list[Step], folder: str) -> str:
    """A line of the table."""
    last, whole = steps[-1], sum(step.seconds for step in steps)
    if not last.refusal:
        what = f"all {len(COMMANDS) + 1} steps"
    else:
        said = last.refusal.splitlines()[0].replace(folder, "").split(": ", 1)[-1].replace("|", "/")
        what = f"`qsf {last.name}` refuses: {said}"
    return f"| {stranger.like} | {stranger.axes} | {what} | {steps[0].seconds:.2f} | {whole:.1f} |"


if __name__ == "__main__":
    main()
