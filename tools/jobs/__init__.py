"""The one way to run jobs apart: here, in processes, or on a cluster; the same bytes each way."""

from evs.tools.jobs.here import job_threads, tell_share
from evs.tools.jobs.job import Job, Ran
from evs.tools.jobs.run import check_workers, run_jobs
from evs.tools.jobs.work import work_off

__all__ = ["Job", "Ran", "check_workers", "job_threads", "run_jobs", "tell_share", "work_off"]
