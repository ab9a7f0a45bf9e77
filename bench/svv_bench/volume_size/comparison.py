"""Table and chart of direct volume rendering (DVR) against palette networks (PCN), over the size of the volume."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import vtkmodules.vtkRenderingContextOpenGL2  # noqa: F401  # registers what draws charts
from vtkmodules.vtkChartsCore import vtkAxis, vtkChart, vtkChartLegend, vtkChartXY
from vtkmodules.vtkCommonCore import vtkDoubleArray, vtkStringArray
from vtkmodules.vtkCommonDataModel import vtkRectf, vtkTable
from vtkmodules.vtkIOImage import vtkPNGWriter
from vtkmodules.vtkRenderingCore import vtkWindowToImageFilter
from vtkmodules.vtkViewsContext2D import vtkContextView

from svv.dvr.draw.casters import off_screen_window

Row = Mapping[str, Any]
"""Measurement of one side at one size: the columns of compare.csv."""

SIDES = {"DVR": (200, 30, 30), "bricks": (30, 140, 60), "PCN": (20, 70, 190)}
"""VTK's ray caster, our own and the palette network, and their colours in the chart."""


def table(rows: Sequence[Row]) -> str:
    """Return a table with all sides in one line per size, as in the paper, and the sizes at which they cross."""
    head = ["volume", "image", "VTK time", "VTK memory", "bricks time", "bricks memory", "volume file"]
    head += ["PCN time", "PCN memory", "scene file", "PSNR", "foreground", "SSIM", "LPIPS"]
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for other in (row for row in rows if row["side"] == "PCN"):
        mine, size = (other["volume"], other["image"]), f"{other['volume']}"
        sides = {r["side"]: r for r in rows if (r["volume"], r["image"]) == mine}
        cells = [size, f"{other['image']}^2", *(costs(sides["DVR"]) if "DVR" in sides else ["does not fit", ""])]
        cells += [*costs(sides["bricks"]), megabytes(sides["bricks"]), *costs(other), megabytes(other)]
        cells += [f"{other['psnr']:.2f} dB", f"{other['psnr_foreground']:.2f} dB", f"{other['ssim']:.4f}"]
        cells += [f"{other['lpips']:.4f}" if "lpips" in other else ""]
        lines.append(f"| {' | '.join(cells)} |")
    keys = ("seconds_median", "time"), ("memory_bytes", "memory")
    crossings = [crossing(rows, side, *key) for side in ("DVR", "bricks") for key in keys]
    return "\n".join([*lines, "", *crossings, ""])


def costs(row: Row) -> list[str]:
    """Return one side's time with its range, and memory, as texts."""
    seconds = [1e3 * row[f"seconds_{name}"] for name in ("median", "least", "most")]
    return [f"{seconds[0]:.0f} ms ({seconds[1]:.0f} to {seconds[2]:.0f})", f"{row['memory_bytes'] / 1e9:.2f} GB"]


def megabytes(row: Row) -> str:
    """Return the size of one side's file as a text."""
    return f"{row['data_bytes'] / 1e6:.1f} MB"


def crossing(rows: Sequence[Row], side: str, key: str, name: str) -> str:
    """Return a sentence about the volume size at which a side's and the PCN's curves cross, for the largest image."""
    image = max(row["image"] for row in rows)
    one, other = ({r["volume"]: r[key] for r in rows if (r["side"], r["image"]) == (s, image)} for s in (side, "PCN"))
    volumes, said = sorted(one), {"DVR": "VTK's ray caster", "bricks": "the ray caster of bricks"}[side]
    where = f"In {name}, at {image}^2 pixels,"
    if not volumes:
        return f"{where} {said} was not measured: no volume fits."
    ratio = np.log([one[n] / other[n] for n in volumes])
    for k in range(len(volumes) - 1):
        if ratio[k] < 0 <= ratio[k + 1]:
            share = ratio[k] / (ratio[k] - ratio[k + 1])
            size = np.exp((1 - share) * np.log(volumes[k]) + share * np.log(volumes[k + 1]))
            return f"{where} {said} passes the PCN at about {size:.0f}^3 voxels (between those measured)."
    less = "the PCN" if ratio[0] >= 0 else said
    return f"{where} {less} takes less at all volumes that were measured, {volumes[0]}^3 to {volumes[-1]}^3."


def draw_chart(rows: Sequence[Row], path: Path) -> None:
    """Draw time and memory over the size of the volume, on logarithmic axes, with VTK's charts, which ParaView has."""
    window = off_screen_window()
    window.SetSize(1280, 520)
    window.SetMultiSamples(8)
    view = vtkContextView()
    view.SetRenderWindow(window)
    view.GetRenderer().SetBackground(1.0, 1.0, 1.0)
    panels = ("seconds_median", "seconds for an image"), ("memory_bytes", "bytes of memory while rendering")
    for place, (key, title) in enumerate(panels):
        chart = chart_of(rows, key, title)
        chart.SetSize(vtkRectf(640 * place, 0, 630, 510))
        view.GetScene().AddItem(chart)
    window.Render()
    taken = vtkWindowToImageFilter()
    taken.SetInput(window)
    taken.ReadFrontBufferOff()
    writer = vtkPNGWriter()
    writer.SetFileName(str(path))
    writer.SetInputConnection(taken.GetOutputPort())
    writer.Write()
    window.Finalize()


def chart_of(rows: Sequence[Row], key: str, title: str) -> vtkChartXY:
    """Return a chart with VTK's DVR in red, ours in green and the PCN in blue, darker for larger images."""
    chart = vtkChartXY()
    chart.SetAutoSize(False)
    chart.SetShowLegend(True)
    chart.GetLegend().SetVerticalAlignment(vtkChartLegend.TOP)
    chart.GetLegend().SetHorizontalAlignment(vtkChartLegend.LEFT)
    images = sorted({row["image"] for row in rows})
    numbers = [row[key] for row in rows]
    for side, colour in SIDES.items():
        for step, image in enumerate(images):
            points = sorted((r["volume"], r[key]) for r in rows if (r["side"], r["image"]) == (side, image))
            if not points:
                continue
            data = vtkTable()
            data.AddColumn(column("x", np.log2([point[0] for point in points])))
            data.AddColumn(column(f"{side}, {image}^2", np.log10([point[1] for point in points])))
            light = 0.55 * (len(images) - 1 - step) / max(len(images) - 1, 1)
            line = chart.AddPlot(vtkChart.LINE if len(points) > 1 else vtkChart.POINTS)  # VTK warns of one-point lines
            line.SetInputData(data, 0, 1)
            red, green, blue = (int(c + (255 - c) * light) for c in colour)
            line.SetColor(red, green, blue, 255)
            line.SetWidth(2.5)
            line.SetMarkerStyle(4)  # a disc
            line.SetMarkerSize(9.0)
    volumes = sorted({row["volume"] for row in rows})
    low, high = np.floor(np.log10(min(numbers))), np.ceil(np.log10(max(numbers)) + 0.7)  # room for the legend
    for place, name, least, most, ticks in (
        (vtkAxis.BOTTOM, "voxels along a side", np.log2(volumes[0]) - 0.2, np.log2(volumes[-1]) + 0.2,
         {float(np.log2(n)): str(n) for n in volumes}),
        (vtkAxis.LEFT, title, low, high, {float(k): f"{10.0**k:g}" for k in np.arange(low, high + 1)}),
    ):  # fmt: skip
        axis = chart.GetAxis(int(place))
        axis.SetTitle(name)
        axis.SetBehavior(vtkAxis.FIXED)
        axis.SetRange(float(least), float(most))
        axis.SetCustomTickPositions(column("", list(ticks)), words(ticks.values()))
        axis.GetLabelProperties().SetFontSize(14)
        axis.GetTitleProperties().SetFontSize(15)
    return chart


def column(name: str, values: Iterable[float]) -> vtkDoubleArray:
    """Return numbers as a VTK array."""
    array = vtkDoubleArray()
    array.SetName(name)
    for value in values:
        array.InsertNextValue(float(value))
    return array


def words(texts: Iterable[str]) -> vtkStringArray:
    """Return texts as a VTK array."""
    array = vtkStringArray()
    for text in texts:
        array.InsertNextValue(text)
    return array
