"""What all tests share, those of evs too."""

from fixtures import *  # noqa: F403 - fixtures are found by their names here
