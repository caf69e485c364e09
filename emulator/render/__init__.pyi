"""The names of evs.emulator.render, each imported on first use."""

from .flicker import flicker_warnings as flicker_warnings
from .native import NativeRenderer as NativeRenderer
from .renderer_factory import make_renderer as make_renderer
