"""Messages: events, packets, topics and their encodings. Names are imported at first use.

Needs only numpy and msgpack, and neither for the errors.
"""

import lazy_loader

# the names are those of __init__.pyi
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
