"""Programs around the emulator: training, evaluation, data sets, jobs, doctor."""
