"""Transfer functions, masks' points, records of stages, Cinema databases, series, and headers of mapped volumes."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from campaign.mutate import byte_like, json_like, npy_header, text_like
from campaign.of_views import HEADERS, PICKLE
from campaign.running import Parser, Read
from svv.bricks.formats.mapped import open_npy, open_vti
from svv.bricks.opened import open_bricks
from svv.dvr.functions.transfer_functions import TransferFunction
from svv.io.cinema.placing import cameras_by_rows, rotations_of
from svv.io.cinema.shot import read_shot
from svv.io.cinema.table import check_files, read_table, select
from svv.io.cinema.transfer import opacity_function
from svv.io.files.keyed_results import read_record
from svv.io.pictures.mask_file import read_selection
from svv.io.series_file import read_series
from svv.job.stages import Stages

PRESET = {
    "Name": "a", "ColorSpace": "Diverging", "RGBPoints": [0, 0, 0, 1, 0.5, 1, 1, 1, 1, 1, 0, 0],
    "Points": [0, 0, 0.5, 0, 0.4, 1, 0.5, 0, 1, 0, 0.5, 0.5], "ScalarOpacityUnitDistance": 0.5, "NanColor": [1, 1, 0],
}  # fmt: skip
BUMPS = {"bumps": [{"centre": 0.3, "width": 0.2, "opacity": 0.8}, {"centre": 0.7, "width": 0.1, "opacity": 0.5,
                                                                   "colour": [1, 0, 0]}], "Name": "b"}  # fmt: skip


def _of_file(path: Path, read: Callable[[Path], object]) -> Read:
    """Return a reader of bytes from a reader of a file."""

    def of_bytes(content: bytes) -> None:
        path.write_bytes(content)
        read(path)

    return of_bytes


def functions(folder: Path) -> Parser:
    """Transfer functions: presets and bumps, read, sampled, and fitted to data."""
    plain = json_like(PRESET, [PRESET], BUMPS)

    def make(random: Random) -> bytes:
        if random.random() < 0.999:
            return plain(random)
        points = [
            x for k in range(random.choice((5000, 100_000))) for x in (random.choice((k, 1e308, 5e-324)), 0.5, 0.5, 0.0)
        ]
        return json.dumps({**PRESET, random.choice(("Points", "RGBPoints")): points}).encode()

    def read(path: Path) -> None:
        function = TransferFunction.read(path)
        function.to_dict()
        function.fitted(0.0, 1.0)
        function.visible_ranges(0.0, 1.0)

    return Parser("transfer functions", _of_file(folder / "tf.json", read), make, lambda content: 100 * len(content))


def selections(folder: Path) -> Parser:
    """The points of a mask."""
    seed = {
        "svv": "selection",
        "size": [8, 8],
        "positive": [[1, 2], [3, 4.5]],
        "negative": [[5, 5]],
        "grown": False,
        "segmenter": "scikit-image",
    }

    def read(path: Path) -> None:
        found = read_selection(path.with_suffix(".png"))
        if found is not None:
            found.scaled((4, 4))

    return Parser("points of masks", _of_file(folder / "mask.json", read), json_like(seed))


def records(folder: Path) -> Parser:
    """Records of finished stages, and of results with their keys."""
    done = folder / "done"
    done.mkdir(exist_ok=True)
    stages = Stages(done)
    stages.do("train", "Training", {"a": 1}, [], lambda progress: None)
    seed = json.loads((done / "stages.json").read_text())

    def read(path: Path) -> None:
        read_record(path, "k")
        for told in Stages(done)._record.values():  # what a page of costs reads
            assert f"{told['title']}: {told['seconds']:.1f} s, {told['peak_rss_bytes'] / 1e9:.1f} GB, {told['key'][:4]}"

    return Parser("stage records", _of_file(done / "stages.json", read), json_like(seed, {"key": "k", "step": 1.0}))


def _database(folder: Path) -> list[dict[str, str]]:
    for k in range(6):
        (folder / f"{k}.png").write_bytes(b"a picture")
    return [
        {"phi": f"{60 * k}", "theta": "30", "time": f"{k // 3}", "CameraPos": "[1 2 3]", "FILE": f"{k}.png"}
        for k in range(6)
    ]


def cinema(folder: Path) -> Parser:
    """Tables of Cinema databases, of both kinds, to the cameras of their rows."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]) if (rows := _database(folder)) else [])
    writer.writeheader()
    writer.writerows(rows)
    table = text_like(text.getvalue())
    views: dict[str, Any] = {"values": [str(k) for k in range(6)]}
    info = {"name_pattern": "{phi}_{theta}_x.png", "arguments": {"phi": views, "theta": {"values": "30"}}}
    other = json_like(info)

    def make(random: Random) -> bytes:
        return table(random) if random.random() < 0.6 else b"\xff" + other(random)

    def read(content: bytes) -> None:
        (folder / "data.csv").unlink(missing_ok=True)
        (folder / "info.json").unlink(missing_ok=True)
        (folder / ("info.json" if content[:1] == b"\xff" else "data.csv")).write_bytes(content.removeprefix(b"\xff"))
        found, _ = select(read_table(folder), {})
        rotations_of(found)
        cameras_by_rows(found, [{} for _ in found.files], (8, 8))
        check_files(found)

    return Parser("Cinema tables", read, make)


STATE = (
    '<ParaView><ServerManagerState version="5.11"><Proxy group="views" type="RenderView" id="7" servers="21">'
    '<Property name="CameraPosition" id="1"><Element index="0" value="1"/><Element index="1" value="2"/>'
    '<Element index="2" value="3"/></Property><Property name="CameraFocalPoint"><Element index="0" value="0"/>'
    '<Element index="1" value="0"/><Element index="2" value="0"/></Property><Property name="CameraViewAngle">'
    '<Element index="0" value="30"/></Property></Proxy></ServerManagerState></ParaView>'
)
SCRIPT = "v = CreateView('RenderView')\nv.CameraPosition = [1.0, 2.0, -3.0e0]\nv.CameraFocalPoint = (0, 0, 0)\n" \
         "v.CameraViewAngle = 30\nv.CameraParallelProjection = 0\nimport os\nos.system('touch ran')\n"  # fmt: skip
LAUGHS = (
    '<?xml version="1.0"?><!DOCTYPE a [<!ENTITY a "aaaaaaaaaa">'
    + "".join(f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in zip("abcdefgh", "bcdefghi"))
    + "]><a>&i;</a>"
)


def shots(folder: Path) -> Parser:
    """Cameras from ParaView's states and scripts, which are never run, and from JSON."""
    state, script = text_like(STATE), text_like(SCRIPT)
    told = json_like({"focal_point": [0, 0, 0], "distance": 3.0, "view_angle": 30, "parallel_projection": False})

    def make(random: Random) -> bytes:
        kind = random.randrange(3)
        if random.random() < 0.001:
            deep = ("v.CameraPosition = " + "(" * 100, "v.CameraPosition = " + "[" * 5000, LAUGHS, "<a>" * 100_000,
                    "-" * 100_000 + "1", "v.CameraPosition = " + "1+" * 50_000 + "1",
                    "v" + ".CameraA" * 9000 + " = 1")  # fmt: skip
            return bytes([48 + kind]) + random.choice(deep).encode()
        return bytes([48 + kind]) + (state, script, told)[kind](random)

    def read(content: bytes) -> None:
        path = folder / ("a.pvsm", "a.py", "a.json")[content[0] - 48]
        path.write_bytes(content[1:])
        read_shot(path)

    return Parser("ParaView's cameras", read, make, lambda content: 2000 * len(content))


def opacity(folder: Path) -> Parser:
    """Opacity functions beside a Cinema database."""

    def read(path: Path) -> None:
        found = opacity_function(folder, "0")
        if found is not None:
            TransferFunction.from_dict(found)

    return Parser("Cinema's functions", _of_file(folder / "cinemavolume_0.json", read), json_like(PRESET, [PRESET]))


def series(folder: Path) -> Parser:
    """Lists of time steps: XML and JSON."""
    xml = text_like('<VTKFile type="Collection"><Collection><DataSet timestep="0" part="0" file="a.vti"/>'
                    '<DataSet timestep="1.5" file="sub/b.vti"/></Collection></VTKFile>', LAUGHS)  # fmt: skip
    plain = json_like({"file-series-version": "1.0", "files": [{"name": "a", "time": 0}, {"name": "b", "time": 1.5}]})

    def make(random: Random) -> bytes:
        return b"x" + xml(random) if random.random() < 0.5 else b"j" + plain(random)

    def read(content: bytes) -> None:
        path = folder / ("a.pvd" if content[:1] == b"x" else "a.series")
        path.write_bytes(content[1:])
        read_series(path)

    return Parser("time series", read, make, lambda content: 200 * len(content))


META = (
    "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\nCompressedData = False\n"
    "TransformMatrix = 1 0 0 0 1 0 0 0 1\nOffset = 0 0 0\nElementSpacing = 1 1 1\nDimSize = 2 2 2\n"
    "ElementType = MET_UCHAR\nElementDataFile = LOCAL\n"
)
VTI = (
    '<?xml version="1.0"?><VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64">'
    '<ImageData WholeExtent="0 1 0 1 0 1" Origin="0 0 0" Spacing="1 1 1"><Piece Extent="0 1 0 1 0 1">'
    '<PointData Scalars="s"><DataArray type="UInt8" Name="s" format="appended" offset="0"/></PointData><CellData/>'
    '</Piece></ImageData><AppendedData encoding="raw">_\x08\0\0\0\0\0\0\0abcdefgh</AppendedData></VTKFile>'
)


def mapped(folder: Path) -> Parser:
    """Headers of volumes that are mapped into memory: MetaImage, VTK XML and NumPy."""
    meta, vti = text_like(META + "abcdefgh", META.replace("LOCAL", "other.raw")), text_like(VTI)
    whole = npy_header("{'descr': '|u1', 'fortran_order': False, 'shape': (2, 2, 2), }", b"abcdefgh")
    plain = byte_like(whole)
    (folder / "other.raw").write_bytes(b"abcdefgh")

    def make(random: Random) -> bytes:
        kind = random.randrange(3)
        if kind == 2 and random.random() < 0.2:
            return b"2" + npy_header(random.choice(HEADERS), PICKLE)
        return bytes([48 + kind]) + (meta, vti, plain)[kind](random)

    def read(content: bytes) -> None:
        kind = content[0] - 48
        path = folder / ("a.mha", "a.vti", "a.npy")[kind]
        path.write_bytes(content[1:])
        source = open_npy(path) if kind == 2 else open_bricks(path) if kind == 0 else open_vti(path, None)
        if source is not None and np.prod(source.levels[0].shape, dtype=object) < 1000:
            source.read(0, (0, 0, 0), source.levels[0].shape)

    return Parser("mapped volumes", read, make, lambda content: 200 * len(content))


ALL = {
    "tf": functions, "selections": selections, "records": records, "cinema": cinema, "shots": shots,
    "opacity": opacity, "series": series, "mapped": mapped,
}  # fmt: skip
