"""What a DAVIS gives beside its events: intensity frames and an IMU."""
