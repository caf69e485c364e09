"""MakeIn: a job made in a folder, and what it raises with its name."""

from __future__ import annotations

import errno
import shutil
from dataclasses import dataclass
from pathlib import Path

from evs.msgs import EvsError
from evs.tools.jobs.job import Job


@dataclass(frozen=True)
class MakeIn:
    """Makes a job in a new folder below `making`."""

    making: Path

    def __call__(self, job: Job) -> Path:
        """That folder. Raises EvsError, which names the job."""
        folder = self.making / job.name
        # a worker that died may have left half of it
        shutil.rmtree(folder, ignore_errors=True)
        try:
            folder.mkdir(parents=True)
            job.make(folder)
        except EvsError as reason:
            raise EvsError(f"{job.name}: {reason}") from None
        except OSError as reason:
            told = reason.strerror or str(reason)
            where = f": '{reason.filename}'" if reason.filename else ""
            raise EvsError(f"{job.name}: {told}{where}{mend_of(reason)}") from None
        except Exception as error:
            error.add_note(f"in job {job.name}")
            raise
        return folder


def mend_of(reason: OSError) -> str:
    """What to do about a disk that is full; nothing for other faults."""
    if reason.errno not in (errno.ENOSPC, errno.EDQUOT):
        return ""
    return "; the jobs before it are whole: free some space and give the command again"
