"""From a world to events: world -> light -> sensor -> events. Names are imported on first use.

    world/        a MuJoCo model: physics in exact ticks, snapshots for the renderers
    render/       turns snapshots into light; render/renderer_table.py lists the renderers
    optics/       the lens
    sensor/       turns light into events: pixels, noise, readout, presets, frames (APS), IMU
    evsnet/       turns light into events with a trained network
    camera/       one camera: lens, renderer, event model and packets
    simulation/   loops over worlds and cameras: World, EventCamera, Pixels, ClosedLoop
    state/        saved states

All of them share base/ and config/; core/ is the native part in C++.
"""

import lazy_loader

# the names are those of __init__.pyi
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
