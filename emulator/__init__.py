"""How events come about: world -> light -> sensor -> events. Names are imported at first use.

    world/        a MuJoCo model: physics in exact ticks, and what is seen of it
    render/       snapshots into light; renderers plug in at render/registry.py
    optics/       the lens in front
    sensor/       light into events: pixels, noise, readout, presets, frames (APS), IMU
    evsnet/       light into events by a trained network
    camera/       one camera: lens, renderer, event model and packets together
    simulation/   loops of worlds and cameras: World, EventCamera, Pixels, ClosedLoop
    state/        saved states

base/ and config/ are what all of them share; core/ is the C++ below.
"""

import lazy_loader

# the names are those of __init__.pyi
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
