"""A scene: the result of training on views of a volume, with its edits; used by the command, scripts and ParaView."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from svv.fields.scene import doubt, edits, images, probing, variants
from svv.fields.scene.images import Rendering as Rendering
from svv.fields.scene.joined import split_at
from svv.fields.scene.model import Model, on_device
from svv.fields.scene.scene_arrays import Arrays, arrays_of, info_of, restored, scene_of
from svv.io.scene_file import parse_scene, read_scene_file, scene_bytes, told_of, write_scene_file

if TYPE_CHECKING:
    from typing_extensions import Self


@dataclass(frozen=True)
class Scene(Model):
    """Networks, geometry and edits of a scene. Every edit returns a new scene that shares the networks.

    Its fields are those of the record :class:`svv.fields.scene.model.Model`. Its methods are the functions of other
    modules that work on such a record, which is their first argument.

    >>> scene.save("balls.svv")
    >>> again = svv.Scene.load("balls.svv").hidden(0)
    >>> again.networks, [region.hidden for region in again.regions]
    (('base', 'pcn'), [True, False])
    """

    on = on_device
    info = info_of
    to_arrays = arrays_of

    edited = edits.edited
    with_light = edits.with_light
    with_shadow = edits.with_shadow
    cut = edits.cut
    uncut = edits.uncut
    hidden = edits.hidden
    shown = edits.shown
    isolated = edits.isolated
    split_at = split_at
    with_part = edits.with_part
    with_strength = edits.with_strength
    with_paint_light = edits.with_paint_light
    with_stroke_opacity = edits.with_stroke_opacity
    with_occlusion = edits.with_occlusion
    with_section = edits.with_section
    with_strokes = edits.with_strokes
    with_outline = edits.with_outline
    reset = edits.reset
    undone = edits.undone
    redone = edits.redone
    as_step = edits.as_step
    as_one_step = edits.as_one_step
    with_edits_of = edits.with_edits_of

    with_variant = variants.with_variant
    without_variant = variants.without_variant
    painted = variants.painted
    free_name = variants.free_name

    while_moving = images.while_moving
    resolving = images.resolving
    render = images.render
    point_at = images.point_at
    probe = probing.probe
    value_image = probing.value_image
    visible_samples = images.visible_samples
    shade = images.shade
    doubt = doubt.doubt

    def save(self, path: str | Path) -> None:
        """Write the scene to one ``.svv`` file, completely or not at all; raises BadInput if it cannot be written."""
        header, tensors = arrays_of(self, packed=True, whole=False)
        write_scene_file(path, header | told_of(info_of(self)), tensors)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a scene; raises BadInput if the file is missing, damaged, not a scene or of another version."""
        return restored(cls, *read_scene_file(path), str(path))

    def to_bytes(self, whole: bool = True) -> bytes:
        """Return what :meth:`save` writes, tables uncompressed, with those that follow from strokes if ``whole``."""
        return scene_bytes(*arrays_of(self, packed=True, whole=whole))

    @classmethod
    def from_bytes(cls, content: bytes, name: str = "The scene") -> Self:
        """Read the content from :meth:`to_bytes`; raises BadInput as :meth:`load` does."""
        return restored(cls, *parse_scene(content, name), name)

    @classmethod
    def from_arrays(cls, header: dict[str, Any], tensors: Arrays) -> Self:
        """Restore a scene from the result of :meth:`to_arrays`."""
        return scene_of(cls, header, tensors)
