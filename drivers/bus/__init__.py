"""The bus sends packets to any number of processes over ZeroMQ. Only this package imports zmq."""

from evs.drivers.bus.control import Described, discover, request
from evs.drivers.bus.latest import Latest
from evs.drivers.bus.losses import Gaps, Tally
from evs.drivers.bus.publisher import Publisher
from evs.drivers.bus.rates import Rate, Rates
from evs.drivers.bus.subscriber import Connection, Subscription, subscribe

__all__ = [
    "Connection",
    "Described",
    "Gaps",
    "Latest",
    "Publisher",
    "Rate",
    "Rates",
    "Subscription",
    "Tally",
    "discover",
    "request",
    "subscribe",
]
