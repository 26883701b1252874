"""Long work: tasks that run here, on the cores of this machine or on a Dask cluster, with the same results."""

from qsframework.work.run import HERE, Work, WorkerLost, run

__all__ = ["HERE", "Work", "WorkerLost", "run"]
