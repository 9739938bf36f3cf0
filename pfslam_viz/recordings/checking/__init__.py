"""The check of a whole recording after it was loaded: units, clocks, odometry and ranges that cannot be right.

:func:`~pfslam_viz.recordings.checking.check.check` is all that the rest of the program needs.
"""
