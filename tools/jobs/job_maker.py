"""JobMaker: run a job in a new folder; errors name the job."""

from __future__ import annotations

import errno
import shutil
from dataclasses import dataclass
from pathlib import Path

from evs.msgs import EvsError
from evs.tools.jobs.job import Job


@dataclass(frozen=True)
class JobMaker:
    """Runs a job in a new folder below `staging`."""

    staging: Path

    def __call__(self, job: Job) -> Path:
        """Run the job.

        Returns:
            The folder with its files.

        Raises:
            EvsError: the job failed; the message names it.
        """
        folder = self.staging / job.name
        # a worker that died may have left half of it
        shutil.rmtree(folder, ignore_errors=True)
        try:
            folder.mkdir(parents=True)
            job.make(folder)
        except EvsError as reason:
            raise EvsError(f"{job.name}: {reason}") from None
        except OSError as reason:
            text = reason.strerror or str(reason)
            where = f": '{reason.filename}'" if reason.filename else ""
            raise EvsError(f"{job.name}: {text}{where}{remedy_for(reason)}") from None
        except Exception as error:
            error.add_note(f"in job {job.name}")
            raise
        return folder


def remedy_for(reason: OSError) -> str:
    """What to do if the disk is full, for the end of a message; empty for other errors."""
    if reason.errno not in (errno.ENOSPC, errno.EDQUOT):
        return ""
    return "; the jobs before it are whole: free some space and give the command again"
