"""Light: renderers behind one protocol. Names are imported at first use.

A new renderer plugs in at registry.py, which the configuration reads too: no renderer is imported
with this package.
"""

import lazy_loader

# the names are those of __init__.pyi
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
