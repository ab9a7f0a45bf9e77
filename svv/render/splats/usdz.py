"""Splats as .usdz: a ParticleField3DGaussianSplat of OpenUSD 26.03 or later, in a package with one binary layer.

Scales and opacities are linear, quaternions real part first, coefficients by splat. Regions are the primvar ``region``,
their names custom data of the same prim. https://openusd.org/release/user_guides/schemas/usdVol
"""

from __future__ import annotations

import zipfile
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from svv.errors import BadInput, Progress, silent
from svv.fields.splats.splats import Splats
from svv.io.files.atomic import atomic_path, partial_folder
from svv.render.splats.placing import Place

LAYER, ALIGNED = "splats.usdc", 64
"""The file in the package, and what its place in that is a multiple of."""

MISSING = "OpenUSD's files (.usdz) need the package usd-core, version 26.3 or later: pip install 'svv[usd]'."

REACH = 3.0
"""Standard deviations that count as a splat's extent, as in OpenUSD's words on its kernel."""


def usd() -> Any:
    """Return the module pxr, which can write splats; raises BadInput if it is missing or too old."""
    try:
        volumes = import_module("pxr.UsdVol")
        for name in ("Gf", "Sdf", "Tf", "Usd", "UsdGeom", "Vt"):
            import_module(f"pxr.{name}")
    except ImportError as error:
        raise BadInput(MISSING) from error
    if not hasattr(volumes, "ParticleField3DGaussianSplat"):
        raise BadInput(MISSING)
    return import_module("pxr")


def write_usdz(path: Path, splats: Splats, place: Place, progress: Progress = silent) -> None:
    """Write splats, whose positions are those of ``place``, whole or not at all; raises BadInput as `atomic_path`.

    The prim's transform puts them where they are in the world, in the place's unit; y is up.
    """
    pxr = usd()
    progress(0.0, "writing")
    with partial_folder(path) as folder:
        layer = folder / LAYER
        try:
            _write_layer(pxr, layer, splats, place)
        except pxr.Tf.ErrorException as error:
            reason = str(error).strip().splitlines()[0].rpartition(": ")[2].strip("'")
            raise BadInput(f"Cannot write {path}: {reason}. Free some space or choose another place.") from error
        progress(0.7, "writing")
        told = zipfile.ZipInfo(LAYER)
        extra = -(30 + len(LAYER) + 4) % ALIGNED  # after the entry's header, its name and that of the extra field
        told.extra = b"\x86\x19" + extra.to_bytes(2, "little") + bytes(extra)
        with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w") as package:
            package.writestr(told, layer.read_bytes())
    progress(1.0, "writing")


def _write_layer(pxr: Any, layer: Path, splats: Splats, place: Place) -> None:
    vt, tokens = pxr.Vt, pxr.UsdGeom.Tokens
    stage = pxr.Usd.Stage.CreateInMemory()  # one of a file that failed would stay registered, and keep the next out
    pxr.UsdGeom.SetStageUpAxis(stage, tokens.y)
    pxr.UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    world = pxr.UsdGeom.Xform.Define(stage, "/scene")
    stage.SetDefaultPrim(world.GetPrim())
    field = pxr.UsdVol.ParticleField3DGaussianSplat.Define(stage, "/scene/splats")
    prim, reach = field.GetPrim(), REACH * splats.scales.max(axis=1, keepdims=True)
    box = np.stack([(splats.centres - reach).min(axis=0), (splats.centres + reach).max(axis=0)])
    field.CreateExtentAttr(vt.Vec3fArray.FromNumpy(box))
    field.CreatePositionsAttr(vt.Vec3fArray.FromNumpy(splats.centres))
    field.CreateScalesAttr(vt.Vec3fArray.FromNumpy(splats.scales))
    # NumPy's rows are as they lie in memory: the real part last.
    field.CreateOrientationsAttr(vt.QuatfArray.FromNumpy(np.roll(splats.rotations, -1, axis=1)))
    field.CreateOpacitiesAttr(vt.FloatArray.FromNumpy(splats.opacities))
    field.CreateRadianceSphericalHarmonicsDegreeAttr(int(np.sqrt(splats.harmonics.shape[1])) - 1)
    field.CreateRadianceSphericalHarmonicsCoefficientsAttr(vt.Vec3fArray.FromNumpy(splats.harmonics.reshape(-1, 3)))
    primvars = pxr.UsdGeom.PrimvarsAPI(prim)
    region = primvars.CreatePrimvar("region", pxr.Sdf.ValueTypeNames.IntArray, tokens.vertex)
    region.Set(vt.IntArray.FromNumpy(splats.regions.astype(np.int32)))
    told = {"regions": vt.StringArray(splats.names), "background": pxr.Gf.Vec3f(*splats.background), "unit": place.unit}
    for key, value in told.items():
        prim.SetCustomDataByKey(f"svv:{key}", value)
    if any(place.origin):
        field.AddTranslateOp().Set(tuple(x / place.unit for x in place.origin))
    stage.GetRootLayer().Export(str(layer))
