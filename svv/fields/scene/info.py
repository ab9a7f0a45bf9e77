"""What a scene is and how it was made, as plain values for people to read."""

from __future__ import annotations

from typing import Any

from svv.core.colour.light import COEFFICIENTS
from svv.fields.scene.joined import members
from svv.fields.scene.kept_styles import without_kept
from svv.fields.scene.model import Model, own_networks


def info_of(scene: Model) -> dict[str, Any]:
    """Describe the scene and how it was made, as plain values."""
    networks = dict(own_networks(scene))
    networks |= {f"variant {other.name}": other.network for other in scene.others}
    parameters = {k: sum(p.numel() for p in n.parameters()) for k, n in networks.items() if n is not None}
    return {
        "networks": scene.networks,
        "parameters": {**parameters, "total": sum(parameters.values())},
        "encoding": scene.settings.encoding,
        "resolutions": scene.settings.resolutions,
        "paint_resolutions": None if scene.styled is None else scene.styled.resolutions,
        "finest_world_units": scene.occupancy.box.size / scene.settings.resolutions[-1],
        "occupied_fraction": scene.occupancy.fraction,
        "image_step_world_units": scene.stride * scene.marching.step * scene.occupancy.box.size,
        "bounds": scene.occupancy.box.bounds.tolist(),
        "regions": [vars(r) for r in scene.regions],
        **_light_of(scene),
        "times": [] if scene.steps is None or len(scene.steps) < 2 else scene.steps.times,
        "variant": scene.variant,
        "variants": {v.name: {str(k): s for k, s in enumerate(v.styles) if s} for v in scene.every_variant},
        "undo": [step.what for step in scene.history.past],
        "redo": [step.what for step in scene.history.future],
        "camera_rig": {} if scene.camera_rig is None else scene.camera_rig.to_json(),
        "made": without_kept(scene.made),
    }


def _light_of(scene: Model) -> dict[str, object]:
    every = [member.coefficients() for member in members(scene)]
    if any(coefficients is None for coefficients in every):
        return {"lighting": scene.settings.lighting}
    rows = [row for coefficients in every if coefficients is not None for row in coefficients.tolist()]
    reflects = [dict(zip(COEFFICIENTS, row, strict=True)) for row in rows]
    return {"lighting": scene.settings.lighting, "light": scene.lamp.said(), "reflects": reflects}
