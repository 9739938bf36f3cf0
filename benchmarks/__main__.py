"""``python -m benchmarks [speed|scaling|memory|recording]``: speed when nothing is named."""

import sys


def main() -> None:
    """Hand the arguments to the benchmark that is named first."""
    name, arguments = "speed", sys.argv[1:]
    if arguments and not arguments[0].startswith("-"):
        name, *arguments = arguments
    if name == "speed":
        from benchmarks.speed import main as run
    elif name == "scaling":
        from benchmarks.scaling import main as run
    elif name == "memory":
        from benchmarks.memory import main as run
    elif name == "recording":
        from benchmarks.recording import main as run
    else:
        sys.exit(f"no benchmark is called '{name}'; there are speed, scaling, memory and recording")
    run(arguments)


if __name__ == "__main__":
    main()
