"""One timed run in a process of its own, so that its peak memory is its own.

``measure(case)`` starts ``python -m benchmarks.case`` with the case as JSON and reads its numbers back.
"""

import json
import resource
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

ROOT = Path(__file__).resolve().parent.parent


@dataclass(frozen=True)
class Case:
    """What to run.

    ``filter`` is ``pfslam`` or ``literal``; ``log`` writes a .rrd too, which is then measured and deleted. None leaves
    a setting to the configuration. Scans ``start`` to ``stop`` - 1 are replayed.
    """

    recording: str = "demo"
    data: str | None = None
    config: str = "paper"
    particles: int | None = None
    beams: int | None = None
    cell: float | None = None
    start: int = 0
    stop: int | None = None
    seed: int = 0
    filter: str = "pfslam"
    log: bool = True
    texture: bool = True
    settings: tuple[str, ...] = field(default_factory=tuple)

    def all_settings(self) -> list[str]:
        """As ``section.key=value``."""
        named = {
            "particles": self.particles,
            "observation.max_beams": self.beams,
            "map.cell": self.cell,
            "seed": self.seed,
        }
        chosen = [f"{key}={value}" for key, value in named.items() if value is not None]
        return [*chosen, *([] if self.texture else ["texture.enabled=false"]), *self.settings]


def measure(case: Case) -> dict[str, Any]:
    """Numbers of the case: ``phases`` (name: median, p95, mean in ms a scan), ``scans``, ``seconds`` of the loop,
    ``real_time`` (recorded ÷ loop), ``peak_mb``, ``file_mb`` (None without a file), ``load_seconds``."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.case", json.dumps(asdict(case))],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        sys.exit(f"{case}: {done.stderr.strip()}")
    numbers: dict[str, Any] = json.loads(done.stdout)
    return numbers


def load(case: Case) -> tuple[Any, Any]:
    """The case's recording and configuration."""
    from pfslam_viz.config import load_config
    from pfslam_viz.recordings.catalog import load_recording

    recording = load_recording(case.recording, Path(case.data) if case.data else None)
    return recording.select(case.start, case.stop), load_config(case.config, case.all_settings())


def run(case: Case) -> dict[str, Any]:
    """Run the case in this process."""
    import numpy as np

    started = perf_counter()
    recording, config = load(case)
    load_seconds = perf_counter() - started
    file_bytes = None
    if case.filter == "literal":
        from benchmarks.literal_filter import LiteralFilter
        from pfslam_viz.slam.paper.settings import PaperConfig

        if not isinstance(config, PaperConfig):
            raise SystemExit(f"the literal filter is the paper's: it cannot run configuration {case.config!r}")
        literal = LiteralFilter(recording, config)
        started = perf_counter()
        literal.run()
        seconds, phases = perf_counter() - started, literal.seconds
    else:
        seconds, phases, file_bytes = _replay(recording, config, case.log)
    return {
        "scans": len(recording),
        "beams": recording.ranges.shape[1] if case.beams is None else min(case.beams, recording.ranges.shape[1]),
        "particles": config.particles,
        "cell": config.map.cell,
        "phases": {
            name: {
                "median": float(np.median(values)) * 1e3,
                "p95": float(np.percentile(values, 95)) * 1e3,
                "mean": float(np.mean(values)) * 1e3,
            }
            for name, values in phases.items()
            if np.any(values)
        },
        "seconds": seconds,
        "real_time": recording.duration / seconds,
        "peak_mb": peak_mb(),
        "file_mb": None if file_bytes is None else file_bytes / 1e6,
        "load_seconds": load_seconds,
    }


def _replay(recording: Any, config: Any, log: bool) -> tuple[float, dict[str, Any], int | None]:
    """Seconds of the whole loop with closing the file, seconds per phase and scan, bytes of the file."""
    import numpy as np

    from pfslam_viz.compiling.compile import compile_all
    from pfslam_viz.compiling.needed import needed
    from pfslam_viz.replay import Replay

    compile_all(needed([config], viewer=log, texture=recording.frames is not None))
    for _ in Replay(recording.select(0, 5), config):  # whatever else is loaded at the first scan
        pass
    replay = Replay(recording, config)
    if not log:
        started = perf_counter()
        for _ in replay:
            pass
        return perf_counter() - started, replay.result().seconds, None
    from pfslam_viz.commands.choices import DetailChoice, SinkChoice
    from pfslam_viz.commands.replay import open_stream

    logging = np.zeros(len(recording))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "out.rrd"
        started = perf_counter()
        with ExitStack() as stack:
            stream = open_stream(stack, recording, config, SinkChoice(save=path), DetailChoice())
            assert stream is not None
            for k, step in enumerate(replay):
                before = perf_counter()
                stream.log(step)
                logging[k] = perf_counter() - before
            stream.finish(replay.result())
        seconds = perf_counter() - started
        return seconds, {**replay.result().seconds, "log": logging}, path.stat().st_size


def peak_mb() -> float:
    """Peak resident memory of this process in MB."""
    try:  # the kernel's own high-water mark; ru_maxrss would count what the parent had before exec
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024 / 1e6
    except OSError:
        pass
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


if __name__ == "__main__":
    values = json.loads(sys.argv[1])
    values["settings"] = tuple(values["settings"])
    print(json.dumps(run(Case(**values))))
