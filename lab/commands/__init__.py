"""The commands that evs-lab adds to `evs`."""

GROUPS = {
    "Measure and choose": {
        "characterise": (
            "measure a virtual sensor: thresholds, latency, bandwidth, noise, range, peak rate"
        ),
        "evaluate": "measure event models (error, recall, timing, cost) against converged light",
        "fit": "fit a sensor file to recordings of your own camera",
        "realism": "compare sensors or streams of events with real recordings",
        "sweep": "measure speed and error around each preset, compared with frame-based simulators",
        "tune": (
            "find the pipeline for a scene that reaches a speed, or keeps an error, and write it"
        ),
    },
    "Data and training": {
        "train": "train the network: `data` makes scenes and their light, `fit` learns from them",
    },
}
"""Heading -> command -> what it does, in one line; a command is the module of its name here."""
