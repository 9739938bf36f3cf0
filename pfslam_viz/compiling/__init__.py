"""Kernels: how they are declared, compiled beforehand, and kept for the next run."""
