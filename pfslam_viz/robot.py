"""The robot's geometry, read from ``configs/robots/*.toml``."""

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, field_validator
from pydantic_core import PydanticCustomError

Meters = Annotated[float, Field(allow_inf_nan=False)]
Radians = Annotated[float, Field(allow_inf_nan=False, ge=-math.pi, le=math.pi)]
Turn = Annotated[float, Field(allow_inf_nan=False, ge=-2 * math.pi, le=2 * math.pi)]
Position = tuple[Meters, Meters, Meters]

LEVEL = 0.1
"""rad; a lidar that leans no more than this is taken as level."""


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class LidarMount(_Model):
    """Where the lidar sits: ``position`` m in the robot's frame (height from the axle), turned by R_z(yaw) R_x(roll).

    ``yaw`` rad, counter-clockwise from the robot's x axis; ``roll`` is 0, or pi where the lidar hangs upside down;
    ``pitch`` is 0: a scan is one of a level plane. Roll and pitch may be off by :data:`LEVEL`.
    """

    position: Position
    yaw: Turn = 0.0
    pitch: Turn = 0.0
    roll: Turn = 0.0

    @field_validator("pitch")
    @classmethod
    def _level(cls, pitch: float) -> float:
        if abs(math.remainder(pitch, 2 * math.pi)) > LEVEL:
            raise PydanticCustomError("mount", "a lidar that looks up or down scans no level plane; 0 rad is expected")
        return pitch

    @field_validator("roll")
    @classmethod
    def _upright_or_upside_down(cls, roll: float) -> float:
        if abs(math.remainder(roll, math.pi)) > LEVEL:
            raise PydanticCustomError("mount", "0 rad is expected, or 3.14159 for a lidar that hangs upside down")
        return roll

    @property
    def upside_down(self) -> bool:
        """Whether it is mounted with its z axis down, so that it turns the other way round."""
        return math.cos(self.roll) < 0


class Intrinsics(_Model):
    """Pinhole of the depth camera, in pixels: u is the column, v the row."""

    fx: float = Field(585.05108211, gt=0)
    fy: float = Field(585.05108211, gt=0)
    cx: float = 315.83800193
    cy: float = 242.94140713
    width: int = Field(640, gt=0)
    height: int = Field(480, gt=0)


class CameraGeometry(_Model):
    """Where the depth camera sits and how it projects.

    ``position`` m in the robot's frame, height from the axle's centre until :meth:`Robot.ground_camera` makes it a
    height above the ground; ``pitch`` positive looks down.
    """

    position: Position
    pitch: Radians = 0.0
    roll: Radians = 0.0
    yaw: Radians = 0.0
    intrinsics: Intrinsics = Intrinsics()

    def robot_from_optical(self) -> NDArray[np.float64]:
        """(4, 4) transform from the optical frame (x right, y down, z ahead) to the robot's: equations (36) and (37).

        (36) as printed tilts the camera up; here R = R_z(yaw) R_y(pitch) R_x(roll), which looks down for pitch > 0.
        """
        cr, sr, cp, sp = math.cos(self.roll), math.sin(self.roll), math.cos(self.pitch), math.sin(self.pitch)
        cy, sy = math.cos(self.yaw), math.sin(self.yaw)
        roll = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
        pitch = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        yaw = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
        optical = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
        out = np.eye(4)
        out[:3, :3] = yaw @ pitch @ roll @ optical
        out[:3, 3] = self.position
        return out


class Robot(_Model):
    """One robot file. Heights are from the axle's centre, which is ``axle_height`` m above the ground."""

    axle_height: float = Field(ge=0, lt=10)
    wheel_diameter: float = Field(gt=0, lt=10)
    ticks_per_revolution: int = Field(gt=0)
    lidar: LidarMount
    camera: CameraGeometry | None = None

    @property
    def meters_per_tick(self) -> float:
        """Metres that a wheel rolls per encoder tick."""
        return math.pi * self.wheel_diameter / self.ticks_per_revolution

    def ground_camera(self) -> CameraGeometry | None:
        """The camera with its height counted from the ground, where z = 0 is the floor."""
        if self.camera is None:
            return None
        x, y, z = self.camera.position
        return self.camera.model_copy(update={"position": (x, y, z + self.axle_height)})
