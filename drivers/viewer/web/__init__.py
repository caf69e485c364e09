"""Our own page: live cameras in a browser, with sliders for their parameters."""
