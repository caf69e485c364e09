"""evs-lab measures the event camera evs and trains its networks.

evs_lab.characterise    a sensor as manufacturers measure it, against its parameters
evs_lab.fit             a sensor file from recordings of a camera
evs_lab.realism         sensors and streams beside real recordings
evs_lab.metrics         two event streams: matched and false events, stamps, counts, distance
evs_lab.evaluation      event models on noisy light against those of converged light
evs_lab.sweep           speed against error around the presets
evs_lab.tuning          the search of `evs tune`
evs_lab.training        training data, and the network in JAX
evs_lab.reconstruction  pictures from events
evs_lab.stress          the stress cases of `evs doctor`
"""
