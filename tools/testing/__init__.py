"""The pytest plugin: run a controller against a scene, and check claims about the loop.

pytest loads it on request: `pytest -p evs`, or `from evs.tools.testing import
evs_loop` in a conftest.py. Names are imported on first use.
"""

import lazy_loader

# the names are those of __init__.pyi
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
