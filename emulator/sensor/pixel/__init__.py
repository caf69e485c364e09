"""The pixel: its state, its fixed pattern, its native form and its oracle."""
