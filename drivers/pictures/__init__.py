"""Pictures of events, as arrays and as files. Only this package imports Pillow."""

from evs.drivers.pictures.channels import channel_page
from evs.drivers.pictures.clip import clip_frames
from evs.drivers.pictures.frame import count_polarities, events_between, upscale
from evs.drivers.pictures.image_files import (
    MAX_FRAMES,
    SUFFIXES,
    need_video,
    suffix_of,
    write_gif,
    write_mp4,
    write_png,
)
from evs.drivers.pictures.light_log import LightLog, recorded_light
from evs.drivers.pictures.playback import Playback, span_us, speed_words
from evs.drivers.pictures.preview import Shot, preview, shot_times

__all__ = [
    "MAX_FRAMES",
    "SUFFIXES",
    "LightLog",
    "Playback",
    "Shot",
    "channel_page",
    "clip_frames",
    "count_polarities",
    "events_between",
    "need_video",
    "preview",
    "recorded_light",
    "shot_times",
    "span_us",
    "speed_words",
    "suffix_of",
    "upscale",
    "write_gif",
    "write_mp4",
    "write_png",
]
