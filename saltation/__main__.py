"""`python -m saltation`: the commands without an installed script."""

from basset.__main__ import start


def main() -> None:
    """The commands of saltation."""
    start("saltation")


if __name__ == "__main__":
    main()
