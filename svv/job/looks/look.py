"""A look: what somebody chose for the regions of one scene, in a form that fits the regions of others.

It holds names, colours, opacities, light, styles with their pictures, edits of strokes, outlines, a camera and the
settings of figures. Places are relative to the volume's box, so that they fit volumes of any size.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from svv.core.geometry.given_cameras import GivenCamera, camera_of
from svv.errors import BadInput, Progress, silent
from svv.fields.scene.history import edits_of
from svv.fields.scene.style_pictures import KEPT
from svv.job.looks.file import read, write
from svv.job.looks.look_content import Laid, LookContent, LookRegion, moved, style_in
from svv.options.described import chosen
from svv.options.figures import FigureOptions
from svv.train.paint.ink import StyleInput, ink_named

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene
    from svv.job.looks.applying import Applied
    from svv.job.looks.matching import Matches


@dataclass(frozen=True)
class Look(LookContent):
    """A look of scenes; :meth:`of` takes it from one, :meth:`applied` gives it to another.

    >>> look = svv.Look.of(scene.edited(0, name="core", colour=(0.8, 0.2, 0.1)))
    >>> applied = look.applied(scene)
    >>> applied.scene.regions[0].edited_colour, applied.notes
    ((0.8, 0.2, 0.1), ())
    """

    @classmethod
    def of(
        cls,
        scene: Scene,
        camera: GivenCamera | None = None,
        figure: FigureOptions | None = None,
        styles: Mapping[str, StyleInput] | None = None,
        title: str = "",
    ) -> Look:
        """Return the look of a scene.

        Args:
            scene: A scene with regions.
            camera: Camera to keep, in world units, as for :func:`svv.show`.
            figure: Settings of figures to keep.
            styles: Pictures of styles by name, for scenes that were painted before scenes kept them.
            title: One line about the look.

        Raises:
            BadInput: The scene has no regions, or the picture of one of its styles is neither in it nor given.

        Example:
            >>> svv.Look.of(svv.Scene.load("head.svv")).save("head.json")  # doctest: +SKIP
        """
        if not scene.regions:
            raise BadInput("The scene has no regions because it holds no palette network; train it again.")
        kept = scene.made.get("stylized", {}).get(KEPT, {"styles": {}, "laid": {}})
        regions, found = [], dict[str, StyleInput]()
        for number, region in enumerate(scene.regions):
            style, laid = None, Laid()
            if region.style is not None:
                how = kept["laid"].get(str(scene.roots[number]), {})
                laid = Laid(**{key: how[key] for key in ("manner", "hand", "stroke_size") if key in how})
                style = how.get("style", region.style)
                found[style] = _style_of(style, region.style, kept["styles"], styles or {})
            regions.append(LookRegion(edits_of(region), region.colour, region.values, style, laid))
        return cls(
            tuple(regions), found,
            scene.lamp if scene.settings.lighting == "phong" or scene.lamp.shadow > 0.0 else None,
            None if camera is None else moved(camera_of(camera, scene), scene, to_box=True),
            changed_settings(figure), title,
        )  # fmt: skip

    @classmethod
    def load(cls, path: str | Path) -> Look:
        """Read a look from a file, or take ``gallery:NAME``; raises BadInput as :func:`svv.job.looks.file.read`."""
        return cls(**vars(read(path)))

    def save(self, path: str | Path) -> None:
        """Write the look to one JSON file, with its pictures inside; raises BadInput if it cannot be written."""
        write(self, path)

    def matched(self, scene: Scene, mapping: Mapping[int, int] | None = None) -> Matches:
        """Return which region of a scene gets the look of which of this one's; see :func:`.matching.matched`."""
        from svv.job.looks.matching import matched

        return matched(self, scene, mapping)

    def applied(
        self,
        scene: Scene,
        mapping: Mapping[int, int] | None = None,
        progress: Progress = silent,
        checkpoint: Path | None = None,
        **paint: object,
    ) -> Applied:
        """Return a scene with this look; see :func:`.applying.applied`."""
        from svv.job.looks.applying import applied

        return applied(self, scene, mapping, progress, checkpoint, **paint)


def changed_settings(figure: FigureOptions | None) -> dict[str, object]:
    """Return the settings of figures that differ from the defaults and do not depend on a scene, by name."""
    if figure is None:
        return {}
    plain, given = chosen(FigureOptions()), chosen(figure)
    return {name: value for name, value in given.items() if value != plain[name] and name != "network"}


def _style_of(
    key: str, name: str, kept: Mapping[str, Mapping[str, str]], given: Mapping[str, StyleInput]
) -> StyleInput:
    """Return a style: an ink, one that was given, or one that the scene keeps."""
    if (ink := ink_named(name)) is not None:
        return StyleInput(ink)
    if name in given:
        return replace(given[name], name=key)
    if "picture" not in kept.get(key, {}):
        raise BadInput(
            f"The scene does not hold the picture of its style '{name}': give it with --style FILE (in Python, "
            "styles), or paint the scene again."
        )
    return style_in(kept[key], key, "The", name)
