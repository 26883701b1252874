"""Long work: tasks that run here, on all cores or on a cluster, and that go on where they were stopped."""

from qsframework.work.checkpoint import Checkpoint
from qsframework.work.cluster import Dask
from qsframework.work.executors import Executor, InProcess, Local, WorkerLost
from qsframework.work.job import job_of
from qsframework.work.run import HERE, Work, run

__all__ = ["HERE", "Checkpoint", "Dask", "Executor", "InProcess", "Local", "Work", "WorkerLost", "job_of", "run"]
