"""The floor texture map: section K of the paper."""

from pfslam_viz.texture.floor_texture import FloorTexture
from pfslam_viz.texture.kinect import depth_from_disparity
from pfslam_viz.texture.painter import SkippedFrames, TexturePainter

__all__ = ["FloorTexture", "SkippedFrames", "TexturePainter", "depth_from_disparity"]
