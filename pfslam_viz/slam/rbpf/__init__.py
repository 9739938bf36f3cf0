"""The Rao-Blackwellized particle filter: N trajectories, each with a map of its own."""
