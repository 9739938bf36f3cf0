"""What is timed, and how to repeat it: see benchmarks/README.md."""
