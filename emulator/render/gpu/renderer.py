"""What all renderers on a GPU have in common."""

from __future__ import annotations

from evs.emulator.base.gpu.arrays import DeviceLight
from evs.emulator.render.direct import DirectRenderer
from evs.emulator.render.gpu.scene import UploadedScene


class CudaRenderer(DirectRenderer):
    """A renderer whose pixels are traced on a GPU, all of them in every tick."""

    _there: UploadedScene

    def device_light(self) -> DeviceLight:
        """As of DeviceRenderer."""
        return self._there.device_light()

    @property
    def features(self) -> dict[str, bool]:
        """As of DirectRenderer."""
        return {**super().features, "full_retrace": True}
