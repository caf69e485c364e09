"""The bus: packets to any number of other processes, over ZeroMQ. The only door to zmq."""

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
