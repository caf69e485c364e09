"""A server for iniVation's software, with one TCP port for each stream."""

from evs.drivers.dv.server import DvServer

__all__ = ["DvServer"]
