"""The paces of a run and their configuration."""

from __future__ import annotations

from dataclasses import dataclass

from evs.drivers.clock import CATCH_UP_S
from evs.msgs.lockstep import LOCKSTEP_ADDRESS

PACES = {"free": 0.0, "realtime": 1.0}
"""pace -> simulated seconds per wall second; 0: as fast as it goes"""

LOCKSTEP = "lockstep"
"""the pace of a run that controllers drive"""


@dataclass(frozen=True)
class RealtimeConfig:
    """[realtime]: what pace = "realtime" does about being late."""

    catch_up_s: float = CATCH_UP_S
    """lateness that the next ticks catch up with, s; beyond it simulated time slips; 0: none"""
    serve: bool = False
    """true: controllers may connect as in lock-step ([lockstep], [loop]); a control acts when it
    arrives, and time waits for nobody"""


@dataclass(frozen=True)
class LockstepConfig:
    """[lockstep]: the server of pace = "lockstep", and of realtime.serve; [loop] is of its loop."""

    address: str = LOCKSTEP_ADDRESS
    """where controllers connect: tcp://HOST:PORT, or ipc:///PATH on this machine"""
    controllers: int = 1
    """how many have to have joined, each with actuators of its own, before anything moves"""
    timeout_s: float = 10.0
    """how long the others wait for a controller's decision before it loses its seat, s"""
    cameras: tuple[str, ...] = ()
    """cameras of the model, all with this pipeline's sensor; none: the pipeline's one camera"""
    key: str = ""
    """file of the server's secret key (evs keygen makes one); all is encrypted then"""
    allow: tuple[str, ...] = ()
    """public keys that may control it (files, folders, or written out); else who knows its own"""
    insecure: bool = False
    """true: other machines may control it although there is no key"""
