"""Pictures of events: arrays in, arrays out, and thin writers. The only door to Pillow."""

from evs.drivers.pictures.channels import channel_page
from evs.drivers.pictures.clip import clip_frames
from evs.drivers.pictures.colours import OFF_RGB, ON_RGB, U8, exposure_for, to_srgb8
from evs.drivers.pictures.frame import count_polarities, event_frame, events_between, upscale
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
    "OFF_RGB",
    "ON_RGB",
    "SUFFIXES",
    "U8",
    "LightLog",
    "Playback",
    "Shot",
    "channel_page",
    "clip_frames",
    "count_polarities",
    "event_frame",
    "events_between",
    "exposure_for",
    "need_video",
    "preview",
    "recorded_light",
    "shot_times",
    "span_us",
    "speed_words",
    "suffix_of",
    "to_srgb8",
    "upscale",
    "write_gif",
    "write_mp4",
    "write_png",
]
