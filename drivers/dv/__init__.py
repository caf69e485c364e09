"""A camera as iniVation's software sees one on the network: one TCP port a stream."""

from evs.drivers.dv.server import DvServer

__all__ = ["DvServer"]
