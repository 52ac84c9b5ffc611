"""`python -m basset`: the commands without an installed script; an interrupt prints one sentence, also while modules are still being loaded."""

import importlib
import os
import signal
from typing import Any


def leave(*_: Any) -> None:
    """End at once: while modules are loaded there is nothing to clean up, and no handler for an exception."""
    os.write(2, b"stopped: nothing is kept\n")
    os._exit(130)


def start(name: str) -> None:
    """Load the commands of a package and run one."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:
        signal.signal(signal.SIGINT, leave)
    cli = importlib.import_module(f"{name}.cli")
    signal.signal(signal.SIGINT, before)
    cli.main(prog_name=name)


def main() -> None:
    """The commands of basset."""
    start("basset")


if __name__ == "__main__":
    main()
