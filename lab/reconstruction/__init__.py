"""Video from events: reconstructors, and the similarity of their pictures to the true frames."""

from evs_lab.reconstruction.filter import CUTOFF_RAD_S, complementary_filter
from evs_lab.reconstruction.likeness import correlation, equalise, laplacian_energy, ssim
from evs_lab.reconstruction.network import VideoNetwork, read_video_network
from evs_lab.reconstruction.voxels import normalised, voxel_grid

__all__ = [
    "CUTOFF_RAD_S",
    "VideoNetwork",
    "complementary_filter",
    "correlation",
    "equalise",
    "laplacian_energy",
    "normalised",
    "read_video_network",
    "ssim",
    "voxel_grid",
]
