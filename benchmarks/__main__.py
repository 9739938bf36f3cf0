"""``python -m benchmarks [speed|scaling|memory|recording|accuracy]``: speed when nothing is named."""

import sys
from importlib import import_module

NAMES = ("speed", "scaling", "memory", "recording", "accuracy")


def main() -> None:
    """Hand the arguments to the benchmark that is named first."""
    name, arguments = NAMES[0], sys.argv[1:]
    if arguments and not arguments[0].startswith("-"):
        name, *arguments = arguments
    if name not in NAMES:
        sys.exit(f"no benchmark is called '{name}'; there are {', '.join(NAMES)}")
    import_module(f"benchmarks.{name}").main(arguments)


if __name__ == "__main__":
    main()
