"""Messages: events, packets, topics and their encodings. Names are imported on first use.

It needs only NumPy and msgpack; the errors need neither.
"""

import lazy_loader

# the names are those of __init__.pyi
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
