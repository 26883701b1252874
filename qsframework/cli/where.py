"""Options of long commands: where the work is done, and the file that keeps its results."""

from __future__ import annotations

import sys
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from qsframework.errors import InputError

if TYPE_CHECKING:
    from qsframework.work import Work

Jobs = Annotated[int, typer.Option("--jobs", help="Processes of this machine; 0: one per core.", min=0)]
DaskAddress = Annotated[
    str | None, typer.Option("--dask", help="Work on a Dask cluster: its address, as tcp://10.0.0.5:8786.")
]
Kept = Annotated[
    Path | None, typer.Option("--checkpoint", help="Keep results in this file as they come, and go on from it.")
]


@dataclass(frozen=True)
class Where:
    """What was asked for."""

    jobs: int = 1
    dask: str | None = None
    checkpoint: Path | None = None


@contextmanager
def at_work(where: Where, job: Callable[[], dict[str, str]]) -> Generator[Work, None, None]:
    """The executor and the checkpoint, let go of in the end. job: what the results depend on."""
    from qsframework.work import Checkpoint, Dask, Local, Work

    if where.dask is not None and where.jobs != 1:
        raise InputError("--jobs is for this machine, --dask for a cluster; give one of them")
    with ExitStack() as stack:
        checkpoint = None
        if where.checkpoint is not None:
            checkpoint = stack.enter_context(Checkpoint(where.checkpoint, job()))
            if checkpoint.loaded:
                print(f"checkpoint: {where.checkpoint} holds {checkpoint.loaded} results", file=sys.stderr)
        executor = None
        if where.dask is not None or where.jobs != 1:
            executor = stack.enter_context(Local(where.jobs) if where.dask is None else Dask(where.dask))
        yield Work(executor, checkpoint)


ALONE = Where()
"""In this process, with nothing kept."""
