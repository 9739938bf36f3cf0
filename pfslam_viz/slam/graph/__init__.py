"""Key scans, matching them with each other, the pose graph over them, and loops: the trajectory in hindsight."""
