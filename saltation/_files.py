"""Files that are written whole or not at all: as in basset."""

from basset._files import replacing, write

__all__ = ["replacing", "write"]
