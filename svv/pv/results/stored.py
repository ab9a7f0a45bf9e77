"""Scenes in files of which ParaView's own process reads the header only: what draws a scene takes seconds to load."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from svv.errors import BadInput
from svv.io.files.atomic import atomic_path
from svv.io.scene_file import header_in, read_scene_header

if TYPE_CHECKING:
    from svv.fields.scene.region import Region
    from svv.fields.scene.scene import Scene


@dataclass(frozen=True)
class Stored:
    """A scene in a file, and what its header says of it."""

    path: Path
    header: dict[str, Any]
    """Its header (:func:`svv.fields.scene.scene_arrays.arrays_of`)."""

    @classmethod
    def read(cls, path: Path) -> Stored:
        """Return the scene in a file; raises BadInput if it is none, or damaged."""
        return cls(path, read_scene_header(path))

    @classmethod
    def and_content(cls, path: Path) -> tuple[Stored, bytes]:
        """Return the scene in a file, and the file's content; raises BadInput if it is none, or damaged."""
        try:
            content = path.read_bytes()
        except OSError as error:
            raise BadInput(f"The scene file {path} cannot be read: {error.strerror}.") from error
        return cls(path, header_in(content, str(path))), content

    @property
    def made(self) -> dict[str, Any]:
        """How it was made."""
        return dict(self.header["made"])

    def save(self, path: str | Path) -> None:
        """Copy the file; raises BadInput if that fails."""
        with atomic_path(path) as temporary:
            temporary.write_bytes(self.path.read_bytes())

    @property
    def regions(self) -> tuple[Region, ...]:
        """Its regions."""
        from svv.fields.scene.region import Region

        known = {field.name for field in fields(Region)}
        return tuple(Region(**{k: v for k, v in told.items() if k in known}) for told in self.header["regions"])

    @property
    def follows_time(self) -> bool:
        """Whether it is a function of its volume's values, and so can follow the volume to other times."""
        return "values" in self.header and "steps" in self.header


def describe_parts(scene: Scene | Stored) -> str:
    """Return which part of a picture each region has, and its colours from dark to light; '' if none is divided."""
    from svv.fields.scene.region import swatches

    divided = scene.made.get("stylized", {}).get("divided", {})
    return " ".join(f"{label} ({', '.join(colours)})." for colours, label in swatches(divided, scene.regions))
