"""Light: renderers with a common protocol. Names are imported on first use.

List a new renderer in renderer_table.py, which the configuration reads too. Importing this package
imports no renderer.
"""

import lazy_loader

# the names are those of __init__.pyi
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
