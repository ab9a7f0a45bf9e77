"""Draws an OpenVDB file of a scene in Blender as svv does, without light, from a camera of svv.

    python docs/measurements/blender_scene.py SCENE.svv drawn            # writes drawn/camera.json and drawn/svv.png
    blender -b --python docs/measurements/blender_scene.py -- SCENE.vdb drawn [--raw]

The second command writes drawn/blender.png. With --raw, colours are blended as the screen shows them, like svv's,
instead of in linear light. The last command compares both:

    python docs/measurements/blender_scene.py SCENE.svv drawn --compare
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

SIZE, FRAME, SAMPLES, STEP = 256, 60, 16, 0.5
"""Side of the picture in pixels, frame of the orbit of 181, samples a pixel, and ray step in voxels."""


def in_svv(scene_file: str, folder: Path, compare: bool) -> None:
    """Write the camera and the renderer's picture, or say how close Blender's is to it."""
    import numpy as np
    from PIL import Image

    import svv
    from svv.core.colour.colour import over
    from svv.io.files.atomic import write_json

    if compare:
        ours, theirs = (
            np.asarray(Image.open(folder / name).convert("RGB")) / 255 for name in ("svv.png", "blender.png")
        )
        print(f"{-10 * np.log10(np.square(ours - theirs).mean()):.1f} dB")
        return
    folder.mkdir(exist_ok=True)
    scene = svv.Scene.load(scene_file)
    for region in range(len(scene.regions)):
        scene = scene.edited(region, lighting=0.0)
    (camera,) = scene.rig.orbit(181, SIZE, frames=[FRAME])
    write_json(folder / "camera.json", {"camera_to_world": camera.camera_to_world, "fov_x": camera.fov_x})
    svv.write_png(folder / "svv.png", over(scene.render(camera).rgba))


def in_blender(file: str, folder: Path, raw: bool) -> None:
    """Write Blender's picture."""
    import bpy
    from mathutils import Matrix

    told = json.loads((folder / "camera.json").read_text())
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.object.volume_import(filepath=str(Path(file).resolve()))
    volume = bpy.context.object
    volume.rotation_euler = (0.0, 0.0, 0.0)  # newer versions of Blender turn what they import
    volume.data.materials.append(flat_material(raw))
    lens = bpy.data.cameras.new("camera")
    lens.sensor_fit, lens.angle = "HORIZONTAL", told["fov_x"]
    camera = bpy.data.objects.new("camera", lens)
    camera.matrix_world = Matrix(told["camera_to_world"])
    bpy.context.collection.objects.link(camera)
    scene = bpy.context.scene
    scene.camera, scene.world = camera, bpy.data.worlds.new("white")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs[0].default_value = (1.0, 1.0, 1.0, 1.0)
    scene.render.engine, cycles = "CYCLES", scene.cycles
    cycles.samples, cycles.use_denoising, cycles.volume_step_rate, cycles.max_bounces = SAMPLES, False, STEP, 0
    scene.view_settings.view_transform = "Raw" if raw else "Standard"
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.render.filepath = str((folder / "blender.png").resolve())
    bpy.ops.render.render(write_still=True)


def flat_material(raw: bool):  # type: ignore[no-untyped-def]
    """Return a material that absorbs and emits as svv's optical model does: the colour times the extinction."""
    import bpy

    material = bpy.data.materials.new("scene")
    material.use_nodes = True
    nodes, link = material.node_tree.nodes, material.node_tree.links.new
    nodes.clear()
    density, colour, gamma, absorb, emit, add, out = (
        nodes.new(f"ShaderNode{kind}")
        for kind in ("Attribute", "Attribute", "Gamma", "VolumeAbsorption", "Emission", "AddShader", "OutputMaterial")
    )
    density.attribute_name, colour.attribute_name = "density", "Cd"
    absorb.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    gamma.inputs["Gamma"].default_value = 1.0 / 2.2 if raw else 1.0
    link(density.outputs["Fac"], absorb.inputs["Density"])
    link(density.outputs["Fac"], emit.inputs["Strength"])
    link(colour.outputs["Color"], gamma.inputs["Color"])
    link(gamma.outputs["Color"], emit.inputs["Color"])
    link(absorb.outputs[0], add.inputs[0])
    link(emit.outputs[0], add.inputs[1])
    link(add.outputs[0], out.inputs["Volume"])
    return material


if __name__ == "__main__":
    given = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    if "--" in sys.argv:
        in_blender(given[0], Path(given[1]), "--raw" in given)
    else:
        in_svv(given[0], Path(given[1]), "--compare" in given)
