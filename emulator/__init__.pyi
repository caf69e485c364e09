"""The names of evs.emulator, each imported on first use."""

from .camera.camera import Camera as Camera
from .camera.view import View as View
from .simulation.closed_loop import ClosedLoop as ClosedLoop
from .simulation.event_camera import EventCamera as EventCamera
from .simulation.pixels import Pixels as Pixels
from .simulation.world import World as World
from .simulation.worlds import Worlds as Worlds
from .world import (
    LeftOutWarning as LeftOutWarning,
    UnstableError as UnstableError,
    UnstableWarning as UnstableWarning,
)
