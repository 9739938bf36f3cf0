"""``pfslam-viz simulate``: make a recording with known truth."""

from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from pfslam_viz import console
from pfslam_viz.files import check_writable

if TYPE_CHECKING:
    from pfslam_viz.simulation.camera_errors import CameraErrors


def run(
    out: Path,
    seed: int,
    duration: float | None,
    building: str,
    frames: bool,
    wheel_scale: float,
    slip: float,
    gyro_bias: float | None,
    camera: "CameraErrors",
    scan_rate: float | None,
) -> None:
    """Write the recording into the folder ``out``."""
    from pfslam_viz.simulation.recording import simulate

    check_writable(out, folder=True)
    started = perf_counter()
    with console.status(f"simulating a drive through '{building}'"):
        simulate(
            out,
            seed=seed,
            duration=duration,
            building=building,
            frames=frames,
            wheel_scale=wheel_scale,
            slip=slip,
            gyro_bias=gyro_bias,
            camera=camera,
            scan_rate=scan_rate,
        )
    console.results().print(
        f"{out}: a drive through '{building}', seed {seed}, made in {perf_counter() - started:.1f} s;"
        f" replay it with: pfslam-viz replay {out}",
        markup=False,
        soft_wrap=True,
    )
