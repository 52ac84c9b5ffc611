"""Keys under which results are kept: another scene, version or state of the compiled code gives another key."""

from __future__ import annotations

import hashlib

from basset import __version__
from basset._compile import digest_of
from saltation.scene import Scene


def text_of(scene: Scene) -> str:
    """A scene as JSON; floats come back bit for bit."""
    text: str = scene.model_dump_json(exclude_none=True)
    return text


def key_of(scene: Scene) -> str:
    """The key under which a scene's results are kept."""
    return hash_of(__version__, digest_of("saltation"), text_of(scene))


def hash_of(*parts: str) -> str:
    """SHA-256 of some texts."""
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()
