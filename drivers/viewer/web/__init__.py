"""The page that shows live cameras in a browser, with sliders for their parameters."""
