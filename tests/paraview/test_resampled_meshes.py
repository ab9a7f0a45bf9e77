"""Grids that are no images in the real ParaView: the filters resample what the view shows as a volume."""

from __future__ import annotations

import pytest

MESHES = """
wavelet = Wavelet(WholeExtent=[-6, 6] * 3)

def shown(source, array=("POINTS", "RTData")):
    view = CreateView("RenderView")
    display = Show(source, view)
    display.SetRepresentationType("Volume")
    ColorBy(display, array)
    Render(view)
    return view

def views(source, array=("POINTS", "RTData"), **changes):
    view = shown(source, array)
    filter = StyleRFViews(Input=source, Views=12, TestViews=0, ViewSize=48, RayCaster="cpu", **changes)
    filter.Shade = 0
    if array == ("POINTS", "RTData"):
        filter.OpacityUnitDistance = 1.7
    found = arrays(filter)["RGBA"].astype(float)
    Delete(view)
    filter.UpdatePropertyInformation()
    return found, filter.Status

image, said["image"] = views(wavelet)

def compare(name, source, **changes):
    found, said[name] = views(source, **changes)
    said[name + " off"] = float(np.abs(found - image).mean())

compare("unstructured", AppendDatasets(Input=[wavelet]))
compare("tetrahedra", Tetrahedralize(Input=wavelet))
compare("structured", Transform(Input=wavelet))
halves = [ExtractSubset(Input=wavelet, VOI=[*ends, -6, 6, -6, 6]) for ends in ((-6, 0), (0, 6))]
compare("blocks", GroupDatasets(Input=halves))
compare("finer", AppendDatasets(Input=[wavelet]), ResampleTo=30)
ball = Clip(Input=wavelet, ClipType="Sphere")
ball.ClipType.Radius = 5.0
found, said["ball"] = views(ball)
said["corners"] = float(found[:8, :8, 3].max())
said["middle"] = float(found[24, 24, 3])
levels = AMRGaussianPulseSource()
found, said["levels"] = views(levels, ("CELLS", "Gaussian-Pulse"))
said["seen"] = float(found[..., 3].max())
tree = (RandomHyperTreeGridSource if "RandomHyperTreeGridSource" in globals() else HyperTreeGridRandom)()
tree.MaxDepth = 3
tree.UpdatePipeline()
GetColorTransferFunction("Depth").RescaleTransferFunction(0, 3)
seen = StyleRFViews(Input=tree, Views=12, TestViews=0, ViewSize=48, RayCaster="cpu")
seen.TransferFunction = GetColorTransferFunction("Depth")  # no view shows such grids as volumes
said["tree"] = status(seen)
surface = StyleRFViews(Input=Sphere())
surface.TransferFunction = GetColorTransferFunction("RTData")
said["surface"] = status(surface)
said["next"] = views(wavelet, ResampleTo=4)[1]  # works, and an image is left as it is
"""


@pytest.mark.slow
def test_the_filters_resample_what_is_no_image(inside) -> None:
    said = inside(MESHES)
    for name, kind in (("unstructured", "vtkUnstructuredGrid"), ("structured", "vtkStructuredGrid"),
                       ("blocks", "vtkMultiBlockDataSet"), ("tetrahedra", "vtkUnstructuredGrid")):  # fmt: skip
        assert f"The input, a {kind}, was resampled to 13 x 13 x 13 points." in said[name]
        assert said[f"{name} off"] < 0.5
    assert "30 x 30 x 30 points" in said["finer"] and said["finer off"] < 3
    assert "96 x 96 x 96 points" in said["ball"] and (said["corners"], said["middle"] > 0) == (0, True)
    assert "vtkOverlappingAMR, was resampled to 10 x 10 x 10" in said["levels"] and said["seen"] > 0
    assert "12 views" in said["tree"] and "The input, a vtkHyperTreeGrid, was resampled to " in said["tree"]
    assert "surfaces, which fill no space" in said["surface"]
    assert "12 views" in said["next"] and "resampled" not in said["next"] + said["image"]


@pytest.mark.slow
def test_training_resamples_too(inside) -> None:
    said = inside(
        """
mesh = AppendDatasets(Input=[Wavelet(WholeExtent=[-4, 4] * 3)])
view = GetActiveViewOrCreate("RenderView")
display = Show(mesh, view)
display.SetRepresentationType("Volume")
ColorBy(display, ("POINTS", "RTData"))
Render(view)
train = StyleRFTrain(Input=mesh, Preset="draft", Settings=FEW, Views=12, ViewSize=32, RayCaster="cpu")
said["status"] = status(train)
"""
    )
    assert "vtkUnstructuredGrid, was resampled to 9 x 9 x 9 points" in said["status"]
