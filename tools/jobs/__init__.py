"""Run jobs in this process, in several processes or on a Ray cluster, with the same result."""

from evs.tools.jobs.job import Job, JobSummary, job_threads, report_progress
from evs.tools.jobs.ray_batches import cluster_batches
from evs.tools.jobs.runner import check_workers, run_jobs
from evs.tools.jobs.worker_pool import run_units

__all__ = [
    "Job",
    "JobSummary",
    "check_workers",
    "cluster_batches",
    "job_threads",
    "report_progress",
    "run_jobs",
    "run_units",
]
