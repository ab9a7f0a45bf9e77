"""The filter StyleRF Look: a scene takes over how another one looks, from a file or from those that ship."""

from __future__ import annotations

from typing import TYPE_CHECKING

from paraview.util.vtkAlgorithm import smproxy

from svv.errors import BadInput
from svv.io.files.keyed_results import digest_of_file
from svv.job.looks.offered import LOOKS
from svv.options.making import PREFIX, DeviceOptions, PaintOptions
from svv.pv.panel.groups import device, menu, save_properties, takes_scene
from svv.pv.panel.option_panel import options_in, properties_of
from svv.pv.panel.properties import button, choice, file, panel, status, text
from svv.pv.vtk_types import Data, OutInfo
from svv.pv.work.cached import SceneOutput
from svv.pv.work.vtk_data import finished_scene_of, key_of_scene

if TYPE_CHECKING:
    from svv.job.looks.applying import Applied

__all__ = ["StyleRFLook"]

FILE = "the file below"


@smproxy.filter(label="StyleRF Look", support_reload=False)
@menu
@panel(
    choice("Look", (FILE, *LOOKS), FILE, "The look: a file, or one that ships; the largest region gets its first one."),
    file("LookFile", "json", "Looks", "A look that Save Look or `svv look save` wrote."),
    text("Pairs", "Pairs of regions of the scene and the look, such as 0=1, 1=0; empty: by name, by values, then by "
                  "colour."),
    *(made for made in properties_of(PaintOptions()) if made.name == "Preset"),
    device(),
    file("SaveLookFile", "json", "Looks", "File to which Save Look writes how the input looks.", save=True),
    button("SaveLook", "Write how the input's scene looks to the file above, for other scenes."),
    *save_properties(),
    status(),
)  # fmt: skip
@takes_scene
class StyleRFLook(SceneOutput):
    """Give a scene the look of another one: names, colours, opacities, light, MatCaps and outlines at once, and styles
    by painting. Save Look keeps how the input looks.
    """

    def work(self, inputs: list[Data], outputs: list[Data], out_info: OutInfo) -> str:
        from svv.fields.devices.gpu import device_named
        from svv.job.looks.look import Look
        from svv.pv.work.editing import describe_edits

        scene, values = finished_scene_of(inputs[0]), self.values
        self.get_or_make("input", object(), lambda: scene)
        shipped = values["Look"] != FILE
        if not shipped and not values["LookFile"]:
            self.give(scene, outputs[0])
            return "Choose a look."
        source = PREFIX + values["Look"] if shipped else values["LookFile"]
        look = Look.load(source)
        named = source if shipped else digest_of_file(source)

        def apply() -> Applied:
            with self.training() as progress:
                on = scene.on(device_named(options_in(DeviceOptions, values).device))
                return look.applied(on, pairs_in(values["Pairs"]), progress, preset=values["Preset"])

        key = (key_of_scene(inputs[0]), named, values["Pairs"], values["Preset"])
        found = self.get_or_make("applied", key, apply)
        self.give(found.scene, outputs[0])
        return (
            "; ".join([*found.matches.describe(look, found.scene), *found.notes]) + ". " + describe_edits(found.scene)
        )

    def SaveLook(self) -> None:
        """Write the input's look to a file."""
        from svv.job.looks.look import Look

        self.save("input", "SaveLookFile", lambda file: Look.of(self.last("input")).save(file))


def pairs_in(text: str) -> dict[int, int] | None:
    """Return '0=1, 1=0' as {0: 1, 1: 0}, None for an empty text; raises BadInput for any other."""
    if not text.strip():
        return None
    pairs = [[side.strip() for side in pair.split("=")] for pair in text.split(",")]
    if not all(len(pair) == 2 and all(side.isascii() and side.isdigit() for side in pair) for pair in pairs):
        raise BadInput(f"Pairs '{text}' must be regions of the scene and of the look, such as 0=1, 1=0.")
    return {int(own): int(theirs) for own, theirs in pairs}
