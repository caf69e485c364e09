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
    """[realtime]: how pace = "realtime" handles lateness."""

    catch_up_s: float = CATCH_UP_S
    """largest lateness that the next ticks make up for, s; beyond it, simulated time slips"""
    serve: bool = False
    """true: controllers may connect as in lock-step ([lockstep], [loop]); a control acts when it
    arrives, and simulated time never waits for it"""


@dataclass(frozen=True)
class LockstepConfig:
    """[lockstep]: the server of pace = "lockstep" and of realtime.serve; see also [loop]."""

    address: str = LOCKSTEP_ADDRESS
    """address for controllers: tcp://HOST:PORT, or ipc:///PATH on this machine"""
    controllers: int = 1
    """number of controllers that must join before the simulation starts, each with its own
    actuators"""
    timeout_s: float = 10.0
    """how long to wait for a controller's decision before the controller is removed, s"""
    cameras: tuple[str, ...] = ()
    """cameras of the model, all with this pipeline's sensor; none: the pipeline's one camera"""
    key: str = ""
    """file of the server's secret key (evs keygen makes one); encrypts all traffic"""
    allow: tuple[str, ...] = ()
    """public keys of the controllers that may connect (files, folders, or the keys themselves);
    none: every controller that has the server's public key"""
    insecure: bool = False
    """true: controllers on other machines may connect without a key"""
