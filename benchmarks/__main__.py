"""``python -m benchmarks NAME``, with NAME one of NAMES below; speed when nothing is named."""

import sys
from importlib import import_module

from benchmarks import machine

NAMES = (
    "speed",
    "profile",
    "scaling",
    "memory",
    "long-drive",
    "recording",
    "startup",
    "digest",
    "logging",
    "accuracy",
    "yardstick",
    "drives",
    "sweep",
    "claims",
    "report",
    "contact-sheet",
)
TELL_THEMSELVES = ("digest", "accuracy", "claims", "report", "contact-sheet")  # on what machine they ran, or need not


def main() -> None:
    """Hand the arguments to the benchmark that is named first."""
    name, arguments = NAMES[0], sys.argv[1:]
    if arguments and not arguments[0].startswith("-"):
        name, *arguments = arguments
    if name not in NAMES:
        sys.exit(f"no benchmark is called '{name}'; there are {', '.join(NAMES)}")
    if name not in TELL_THEMSELVES and not {"-h", "--help"} & set(arguments):
        print(machine.describe(), "\n")
    import_module(f"benchmarks.{name.replace('-', '_')}").main(arguments)


if __name__ == "__main__":
    main()
