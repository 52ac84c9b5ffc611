"""`python -m basset`: the commands without an installed script."""

from basset.cli import main

if __name__ == "__main__":
    main(prog_name="python -m basset")
