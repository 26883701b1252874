"""Long work: tasks that run here, on all cores or on a cluster, and that go on where they were stopped."""

from qsframework.work.checkpoint import Checkpoint
from qsframework.work.executors import Dask, Local, WorkerLost, Workers
from qsframework.work.job import job_of
from qsframework.work.run import HERE, Work, run

__all__ = ["HERE", "Checkpoint", "Dask", "Local", "Work", "WorkerLost", "Workers", "job_of", "run"]
