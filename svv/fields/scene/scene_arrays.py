"""Conversion of a scene to the header and arrays of its file, and back, and to plain values for people to read."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from svv.core.colour.light import COEFFICIENTS, Lamp
from svv.core.geometry.cameras import CameraRig
from svv.core.json_values import number_in, text_in, whole_in
from svv.errors import BadInput, is_lack_of_memory
from svv.fields.radiance.encodings import Encoding, SparseLattice
from svv.fields.radiance.kept_values import KeptValues
from svv.fields.radiance.networks import BaseField, PaletteField, UnrestrictedField
from svv.fields.radiance.occupancy import Occupancy
from svv.fields.radiance.of_values import SLOPES, TABLES, VALUES, fill_base, fill_palette
from svv.fields.radiance.rendering import Marching
from svv.fields.radiance.time_steps import TimeSteps
from svv.fields.radiance.value_function import ValueFunction
from svv.fields.scene.doubt import told_in_words
from svv.fields.scene.expected import ExpectedErrors
from svv.fields.scene.history import History, cuts_in
from svv.fields.scene.joined import members
from svv.fields.scene.model import MOST_VERTICES_A_CELL, NETWORKS, Model, S, Variant, own_networks
from svv.fields.scene.parts import FINEST, Parts, counted
from svv.fields.scene.region import Region, of_layer
from svv.fields.scene.scene_validation import box_of, check_finite, check_sizes, occupied_of, settings_of, values_of
from svv.fields.scene.style_pictures import drop_styles, made_in, put_apart
from svv.fields.strokes.stored_strokes import Brushed

Arrays = dict[str, NDArray[np.generic]]


def arrays_of(  # long: one record
    scene: Model, packed: bool = True, whole: bool = True
) -> tuple[dict[str, Any], Arrays]:
    """Return header and arrays of the file, with tables that follow from strokes if ``whole``.

    ``packed`` tables of lattices are bytes, and those of the hash grid in half precision.
    """
    # Packed, tables that follow from the values would come back less exact than they are made again.
    given = TABLES if scene.steps is not None and scene.values is not None and packed else ()
    box, tensors = scene.occupancy.box, Arrays()
    header: dict[str, Any] = {
        "box": {"low": box.low, "size": box.size, "extent": box.extent},
        "cells": scene.occupancy.cells,
        "shape": scene.occupancy.occupied.shape,
        "settings": scene.settings.to_json(),
        "marching": {k: getattr(scene.marching, k) for k in ("step", "least_weight", "stop")},
        "images": {"stride": scene.stride, "joined": scene.joined},
        "vertices_a_cell": scene.vertices_a_cell,
        "normal_resolutions": _normal_resolutions(scene),
        "lamp": scene.lamp.to_json(),
        "cuts": [vars(cut) for cut in scene.cuts],
        "density_resolutions": None if scene.base.density is None else scene.base.density.resolutions,
        "networks": [name for name, network in own_networks(scene) if network is not None],
        "regions": [vars(r) for r in scene.regions],
        "undone": [vars(r) for r in scene.unsplit],
        "history": scene.history.to_json(),
        "painting": scene.painting,
        "paint_resolutions": None if scene.styled is None else scene.styled.resolutions,
        "paint_direct": scene.styled is not None and scene.styled.direct,
        "variants": [
            {
                "name": v.name,
                "styles": v.styles,
                "glazes": v.glazes,
                "made": put_apart(v.made, tensors),
                "resolutions": v.network.resolutions,
                "direct": v.network.direct,
            }
            for v in scene.others
        ],
        "camera_rig": {} if scene.camera_rig is None else scene.camera_rig.to_json(),
        "made": {name: put_apart(value, tensors) for name, value in scene.made.items()},
    }
    tensors |= {"occupied": np.packbits(scene.occupancy.occupied > 0)[:, None]}  # tables are deflated
    if scene.values is not None:
        own = scene.values
        header["values"] = {"interval": own.interval, "visible": own.visible, "size": own.size}
        tensors["extinction_table"] = own.table.cpu().numpy()
    if scene.parts is not None:
        header["parts"] = {"cells": scene.parts.cells}
        tensors |= {f"parts.{name}": array for name, array in _packed(scene.parts, scene.occupancy).items()}
    if scene.expected is not None:
        header["expected"] = scene.expected.to_json()
        tensors["expected.level"] = scene.expected.level
    named = own_networks(scene) + [(f"variant{number}", other.network) for number, other in enumerate(scene.others)]
    given = (*given, *_add_brushed(named, header, tensors, whole))
    for name, network in named:
        if network is not None:
            for key, value in network.state_dict().items():
                tensors[f"{name}.{key}"] = value.cpu().numpy()
            for key, encoding in _encodings(name, network) if packed else ():
                if key in given:
                    continue
                tensors |= {key + suffix: array for suffix, array in encoding.packed().items()}
    if scene.steps is not None:
        header["steps"] = scene.steps.to_json()
        tensors |= scene.steps.to_arrays()
    if scene.kept is not None:
        header["kept"] = scene.kept.to_json()
        tensors |= scene.kept.to_arrays()
    tensors = {name: array for name, array in tensors.items() if name not in given}
    _add_layers(scene, header, tensors, packed, whole)
    return header, tensors


def _add_brushed(
    named: Sequence[tuple[str, nn.Module | None]], header: dict[str, Any], tensors: Arrays, whole: bool
) -> list[str]:
    """Add the strokes of paintings; returns the tables that a file need not have, because they follow from strokes.

    All other tables of paint are computed now if they have not been yet.
    """
    follow: list[str] = []
    for name, network in named:
        if not isinstance(network, UnrestrictedField):
            continue
        if whole or network.brushed is None or not network.brushed.complete:
            _ = network.encoding
        if network.brushed is not None:
            told, arrays = network.brushed.to_file(name)
            header.setdefault("brushed", {})[name] = told
            tensors |= arrays
            if network.brushed.complete and not whole:
                follow.append(f"{name}.encoding.table")
    return follow


def _add_layers(scene: Model, header: dict[str, Any], tensors: Arrays, packed: bool, whole: bool) -> None:
    """Add what a joined scene is joined from."""
    for number, layer in enumerate(scene.layers):
        told, arrays = arrays_of(layer if layer.steps else replace(layer, steps=scene.steps), packed, whole)
        if layer.steps is None and scene.steps is not None:  # the scene's own are its steps, too
            arrays = {name: array for name, array in arrays.items() if name not in scene.steps.to_arrays()}
            del told["steps"]
        header.setdefault("layers", []).append(told)
        tensors |= {f"layer{number}.{name}": array for name, array in arrays.items()}


def _layers_of(header: dict[str, Any], tensors: Arrays, scene: Model) -> list[tuple[dict[str, Any], Arrays]]:
    """Return header and arrays of each further scene of a joined one; the first has their regions and steps."""
    found, steps = [], scene.steps
    for number, told in enumerate(header.get("layers", [])):
        start = f"layer{number}."
        every = of_layer(scene.every_region, number + 1)
        count = sum(region.layer == number + 1 for region in scene.regions)
        told = {**told, "regions": [vars(r) for r in every[:count]], "undone": [vars(r) for r in every[count:]]}
        arrays = {name.removeprefix(start): array for name, array in tensors.items() if name.startswith(start)}
        if "steps" not in told and steps is not None:
            told, arrays = {**told, "steps": steps.to_json()}, {**arrays, **steps.to_arrays()}
        found.append((told, arrays))
    return found


def scene_of(kind: type[S], header: dict[str, Any], tensors: Arrays) -> S:
    """Return a scene from the result of :func:`arrays_of`, with its layers and its history."""
    scene = _alone(kind, header, tensors)
    layers = (scene_of(kind, *layer) for layer in _layers_of(header, tensors, scene))
    scene = replace(scene, layers=tuple(replace(layer, regions=(), unsplit=()) for layer in layers))
    if "history" not in header:
        return scene
    return replace(scene, history=History.from_json(header["history"], scene.every_region))


def restored(kind: type[S], header: dict[str, Any], tensors: Arrays, name: str) -> S:
    """Return a scene as :func:`scene_of` does; raises BadInput if the content of the file of this name is damaged."""
    try:
        return scene_of(kind, header, tensors)
    except Exception as error:  # a damaged file may say anything, and so fail anywhere
        if is_lack_of_memory(error):
            raise
        raise BadInput(f"{name} is damaged ({type(error).__name__}: {error}): train it again.") from error


def _alone(kind: type[S], header: dict[str, Any], tensors: Arrays) -> S:  # long: one record
    """Return a scene without its layers and its history."""
    check_finite(tensors)
    box = box_of(header["box"])
    occupancy = Occupancy(box, header["cells"], occupied_of(header, tensors, box))
    settings = settings_of(header["settings"])
    check_sizes(header, tensors, settings, occupancy.occupied)
    base = BaseField(settings, occupancy, header["density_resolutions"])
    palette, styled = None, None
    regions, unsplit, parts = _regions(header, tensors, occupancy)
    own = of_layer((*regions, *unsplit), 0)
    count = sum(region.part_of is None for region in own)
    if "pcn" in header["networks"]:
        if tensors["pcn.colours"].shape != (count, 3):
            raise ValueError(f"the palette does not have {count} colours")
        colours, normals = torch.zeros(count, 3), header.get("normal_resolutions")
        palette = PaletteField(settings, occupancy, base.geometry_width, colours, normals)
    if "styled" in header["networks"]:
        styled = UnrestrictedField(
            settings, occupancy, header.get("paint_resolutions"), bool(header.get("paint_direct", False))
        )
    values = _value_function(header, tensors)
    steps = TimeSteps.from_file(header["steps"], tensors) if "steps" in header else None
    told = header.get("kept")
    kept = None if told is None else KeptValues.from_file(told, tensors, box_of(told["box"]))
    left_out = {name for name in TABLES if name not in tensors} if steps is not None else set()
    told = header.get("variants", [])
    others = [UnrestrictedField(settings, occupancy, v.get("resolutions"), bool(v.get("direct", False))) for v in told]
    named: list[tuple[str, nn.Module | None]] = [*zip(NETWORKS, (base, palette, styled), strict=True)]
    named += [(f"variant{number}", network) for number, network in enumerate(others)]
    there = 0 if steps is None else len(steps)
    for name, network in named:
        if network is not None:
            arrays = {k: v for k, v in tensors.items() if k.startswith(f"{name}.")}
            encodings = _encodings(name, network)
            tables = tuple(key for key, _ in encodings)
            state = {k: torch.from_numpy(v.astype(np.float32)) for k, v in arrays.items() if not k.startswith(tables)}
            for key, encoding in encodings:
                if name in header.get("brushed", {}) and _add_strokes(name, network, header, tensors, there):
                    left_out.add(key)
                packed = {k.removeprefix(key): v for k, v in arrays.items() if k.startswith(key)}
                state[key] = encoding.table.detach() if key in left_out else encoding.unpacked(packed)
            network.load_state_dict({k.removeprefix(f"{name}."): v for k, v in state.items()})
            network.requires_grad_(False)
    if "base.density.table" in left_out:
        _fill(base, palette, occupancy, values, steps)
    rig = CameraRig.from_json(header["camera_rig"]) if header["camera_rig"] else None
    marching = Marching(**values_of(Marching, header["marching"]))
    images = values_of(Model, header.get("images", {}))
    if not (marching.step > 0.0 and images.get("stride", 1.0) > 0.0):
        raise ValueError("the distance of samples is not above 0")
    images["vertices_a_cell"] = whole_in(header.get("vertices_a_cell", 0), "vertices_a_cell")
    if not 0 <= images["vertices_a_cell"] <= MOST_VERTICES_A_CELL:
        raise ValueError(f"a cell has 0 to {MOST_VERTICES_A_CELL} vertices, not {images['vertices_a_cell']}")
    expected = None
    if "expected" in header:
        expected = ExpectedErrors.from_file(header["expected"], tensors["expected.level"], occupancy)
    variants = [_variant_in(v, network, tensors) for v, network in zip(told, others, strict=True)]
    painting = None if header.get("painting") is None else text_in(header["painting"], "painting")
    if not all(count <= len(v.styles) <= len(own) for v in variants):
        raise ValueError("a variant does not have the scene's regions")
    return kind(
        settings, occupancy, marching, base, palette, styled, values, steps, rig, made_in(header["made"], tensors),
        expected, regions=regions, unsplit=unsplit, parts=parts, lamp=Lamp(**values_of(Lamp, header.get("lamp", {}))),
        cuts=cuts_in(header.get("cuts", [])), painting=painting, others=tuple(variants), kept=kept, **images,
    )  # fmt: skip


def _add_strokes(name: str, network: nn.Module, header: dict[str, Any], tensors: Arrays, steps: int) -> bool:
    """Give a network its strokes; returns whether the file leaves out its lattice, which follows from them."""
    lattice = network.encoding
    if not isinstance(network, UnrestrictedField) or not isinstance(lattice, SparseLattice) or not network.direct:
        raise ValueError("strokes need paint on a lattice")
    network.brushed = Brushed.from_file(name, header["brushed"][name], tensors, len(lattice.table))
    if not all(lives.are_within(steps) for lives in network.brushed.lives.values()):
        raise ValueError("strokes live at time steps that there are not")
    if not network.brushed.complete or f"{name}.encoding.table" in tensors:
        return False
    network.bake_later(network.brushed, network.brushed.baked)
    return True


def _fill(
    base: BaseField,
    palette: PaletteField | None,
    occupancy: Occupancy,
    function: ValueFunction | None,
    steps: TimeSteps | None,
) -> None:
    """Fill the tables that a file leaves out because they follow from the values; raises ValueError if it has none."""
    if function is None or steps is None:
        raise ValueError("tables are missing")
    grid = steps.grid(steps.own, function.visible).over(function.interval, function.visible)
    fill_base(base, function, grid, occupancy)
    if palette is not None:
        fill_palette(palette, base)


def _value_function(header: dict[str, Any], tensors: Arrays) -> ValueFunction | None:
    """Return the function of the values; raises KeyError, TypeError or ValueError if the content does not fit."""
    if "values" not in header:
        return None
    told, table = header["values"], torch.from_numpy(tensors["extinction_table"].astype(np.float32))
    (low, high), (least, most), size = told["interval"], told["visible"], float(told["size"])
    if table.shape != (VALUES * SLOPES,) or not (low < high and 0.0 <= least <= most <= 1.0 and size > 0.0):
        raise ValueError("the function of the values is damaged")
    return ValueFunction((float(low), float(high)), (float(least), float(most)), size, table)


def _packed(parts: Parts, occupancy: Occupancy) -> Arrays:
    """Return the zones of occupied cells, a row for each cell of the occupancy, and the bits of their table."""
    finer = parts.cells // occupancy.cells
    rows = _rows(parts.zone, finer)[occupancy.occupied > 0].reshape(-1, finer**3)
    return {"zone": rows, "inside": parts.inside.astype(np.uint8)}


def _unpacked(header: dict[str, Any], tensors: Arrays, occupancy: Occupancy) -> Parts:
    """Invert :func:`_packed`; raises KeyError, TypeError or ValueError if the content does not fit."""
    finer = int(header["cells"]) // occupancy.cells
    if not 1 <= finer <= FINEST or header["cells"] != finer * occupancy.cells:
        raise ValueError(f"parts of {header['cells']} cells do not fit {occupancy.cells}")
    zone = np.zeros([finer * n for n in occupancy.occupied.shape], np.uint8)
    _rows(zone, finer)[occupancy.occupied > 0] = tensors["parts.zone"].reshape(-1, finer, finer, finer)
    return Parts(int(header["cells"]), zone, np.greater(tensors["parts.inside"], 0))


def _rows(zone: NDArray[np.uint8], finer: int) -> NDArray[np.uint8]:
    """View a grid as the finer cells of each cell of the occupancy. (X, Y, Z, finer, finer, finer)"""
    x, y, z = (n // finer for n in zone.shape)
    return zone.reshape(x, finer, y, finer, z, finer).transpose(0, 2, 4, 1, 3, 5)


def _regions(
    header: dict[str, Any], tensors: Arrays, occupancy: Occupancy
) -> tuple[tuple[Region, ...], tuple[Region, ...], Parts | None]:
    """Return regions, those whose split was undone, and parts; raises ValueError if they do not fit each other."""
    parts = _unpacked(header["parts"], tensors, occupancy) if "parts" in header else None
    told = header.get("undone", header.get("parts", {}).get("undone", []))  # in older files, parts have it
    regions, unsplit = (tuple(Region(**values_of(Region, r)) for r in values) for values in (header["regions"], told))
    if any(not 0 <= region.layer <= len(header.get("layers", [])) for region in (*regions, *unsplit)):
        raise ValueError("a region belongs to none of the transfer functions")
    own = [region.part_of is not None for region in of_layer((*regions, *unsplit), 0)]
    if own != sorted(own):
        raise ValueError("the parts of regions are out of order")
    if sum(own) != (0 if parts is None else parts.inside.shape[1]):
        raise ValueError("the parts of regions do not fit their table")
    return regions, unsplit, counted(parts, regions, 0)


def _normal_resolutions(scene: Model) -> tuple[int, ...] | None:
    phong = None if scene.palette_network is None else scene.palette_network.phong
    return None if phong is None else phong.normals.resolutions


def _encodings(name: str, network: nn.Module) -> list[tuple[str, Encoding]]:
    """Return the network's encodings, each with the name of its table in a file."""
    return [(f"{name}.{k}.table", m) for k, m in network.named_modules() if isinstance(m, Encoding)]


def _variant_in(told: Mapping[str, Any], network: UnrestrictedField, tensors: Arrays) -> Variant:
    """Return a variant from a file's header; files from before glazes were kept have none."""
    styles = tuple(None if style is None else text_in(style, "style") for style in told["styles"])
    glazes = tuple(number_in(glaze, "glaze") for glaze in told.get("glazes", ()))
    return Variant(text_in(told["name"], "name"), network, styles, made_in(told["made"], tensors), glazes)


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
        "image_vertices_a_cell": scene.vertices_a_cell,
        "bounds": scene.occupancy.box.bounds.tolist(),
        "regions": [vars(r) for r in scene.regions],
        **_light_of(scene),
        **({} if scene.kept is None else {"kept_values": {"bytes": scene.kept.bytes, "vertices": scene.kept.count}}),
        "cuts": [cut.describe() for cut in scene.cuts],
        "times": [] if scene.steps is None or len(scene.steps) < 2 else scene.steps.times,
        "variant": scene.variant,
        "variants": {v.name: {str(k): s for k, s in enumerate(v.styles) if s} for v in scene.every_variant},
        "undo": [step.what for step in scene.history.past],
        "redo": [step.what for step in scene.history.future],
        "camera_rig": {} if scene.camera_rig is None else scene.camera_rig.to_json(),
        "doubt": told_in_words(scene),
        "made": drop_styles(scene.made),
    }


def _light_of(scene: Model) -> dict[str, object]:
    every = [member.coefficients() for member in members(scene)]
    if any(coefficients is None for coefficients in every):
        plain: dict[str, object] = {"lighting": scene.settings.lighting}
        return plain | ({"shadows": scene.lamp.describe_shadow()} if scene.lamp.shadow else {})
    rows = [row for coefficients in every if coefficients is not None for row in coefficients.tolist()]
    reflects = [dict(zip(COEFFICIENTS, row, strict=True)) for row in rows]
    return {"lighting": scene.settings.lighting, "light": scene.lamp.describe(), "reflects": reflects}
