"""``python -m pfslam_viz`` is ``pfslam-viz``."""

from pfslam_viz.cli import main

if __name__ == "__main__":
    main()
