"""`python -m saltation`: the commands without an installed script."""

from saltation.cli import main

if __name__ == "__main__":
    main(prog_name="python -m saltation")
