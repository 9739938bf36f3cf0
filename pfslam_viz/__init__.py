"""Interactive replay of particle-filter SLAM in the Rerun viewer.

Importing this package imports nothing heavy; every command brings in what it needs.
"""

__version__ = "0.1.0"
