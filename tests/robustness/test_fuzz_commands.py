"""Lines made from the parser of every command: exit code 0, or a refusal that says where, and whole, finite outputs.

The long run of the same is `benchmarks/fuzz.py commands`; its record stands in docs/results.md.
"""

from __future__ import annotations

import command_lines
import pytest
from fuzzing import Outcome

COUNT = 4
SLOW = {"demo": 1, "robots": 2, "diagnose": 2}


@pytest.fixture(scope="module")
def benches(tmp_path_factory: pytest.TempPathFactory) -> dict[str, command_lines.Commands]:
    return command_lines.benches(tmp_path_factory.mktemp("commands"))


@pytest.mark.parametrize("name", command_lines.commands())
def test_no_line_is_a_fault(benches: dict[str, command_lines.Commands], name: str) -> None:
    for seed in range(SLOW.get(name, COUNT)):
        found = benches[f"qsf {name}"].try_seed(seed)
        assert found.outcome is not Outcome.FAULT, f"seed {seed}: {found.words}"


def test_every_option_of_every_command_is_tried(benches: dict[str, command_lines.Commands]) -> None:
    """A new option is tried as soon as the parser has it."""
    for bench in benches.values():
        known = {o for p in command_lines.commands()[bench.name].params for o in (*p.opts, *p.secondary_opts)}
        left = {o for o in known if o.startswith("-")} - {"--help", "-h", *command_lines.NEVER.get(bench.name, ())}
        for seed in range(300):
            left -= set(bench.line(seed).words)
            if not left:
                break
        assert not left, bench.name


def test_a_seed_is_one_line(benches: dict[str, command_lines.Commands]) -> None:
    for bench in benches.values():
        assert bench.line(5) == bench.line(5)


def test_a_fault_is_seen(benches: dict[str, command_lines.Commands], monkeypatch: pytest.MonkeyPatch) -> None:
    """Tracebacks, numbers that are not finite, refusals without a place, and an input that is gone."""
    bench = benches["qsf check"]

    def finds(main: object) -> str:
        monkeypatch.setattr(command_lines, "main", main)
        return bench.try_seed(3).words

    def refuses() -> None:
        import sys

        print("error: no", file=sys.stderr)
        sys.exit(2)

    from pathlib import Path

    assert "ZeroDivisionError" in finds(lambda: 1 / 0)
    assert "a number NaN" in finds(lambda: Path("new.json").write_text("[NaN]"))
    assert "a cell inf" in finds(lambda: Path("new.csv").write_text("a,b\n1,inf\n"))
    assert "neither file nor option" in finds(refuses)
    assert "was overwritten" in finds(lambda: Path("small/robot.yaml").write_text("x"))
    assert "half a file" in finds(lambda: Path(".a.qsf-part").write_text("x"))
