"""The floor texture map: section K of the paper."""

from pfslam_viz.texture.floor_camera import FloorCamera, find_camera
from pfslam_viz.texture.floor_texture import FloorTexture
from pfslam_viz.texture.kinect import depth_from_disparity
from pfslam_viz.texture.painter import SkippedFrames, TexturePainter

__all__ = ["FloorCamera", "FloorTexture", "SkippedFrames", "TexturePainter", "depth_from_disparity", "find_camera"]
