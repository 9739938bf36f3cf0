"""The floor texture map: section K of the paper. Its names are loaded on first use: `info` needs no kernels."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pfslam_viz.texture.floor_camera import FloorCamera, find_camera
    from pfslam_viz.texture.floor_texture import FloorTexture
    from pfslam_viz.texture.kinect import depth_from_disparity
    from pfslam_viz.texture.painter import SkippedFrames, TexturePainter

__all__ = ["FloorCamera", "FloorTexture", "SkippedFrames", "TexturePainter", "depth_from_disparity", "find_camera"]

_HOMES = {
    "FloorCamera": "pfslam_viz.texture.floor_camera",
    "FloorTexture": "pfslam_viz.texture.floor_texture",
    "SkippedFrames": "pfslam_viz.texture.painter",
    "TexturePainter": "pfslam_viz.texture.painter",
    "depth_from_disparity": "pfslam_viz.texture.kinect",
    "find_camera": "pfslam_viz.texture.floor_camera",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
