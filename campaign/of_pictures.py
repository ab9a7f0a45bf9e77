"""Pictures through Pillow, and volumes through VTK's readers: libraries in C, so they run in processes of their own."""

from __future__ import annotations

import io
import struct
import time
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from PIL import Image, ImageCms

from campaign.mutate import TEXTS, some_bytes, text_like
from campaign.of_tables import META, VTI
from campaign.running import Parser
from svv.io.files.declared_sizes import FEW_PIXELS, MOST_INFLATED
from svv.io.pictures.mask_file import picture_size, read_mask
from svv.io.pictures.style_picture import read_style
from svv.io.views.view_images import decode

SIDE = 20
FORMATS = ("PNG", "JPEG", "TIFF", "GIF", "WEBP", "BMP", "PPM", "ICO", "TGA", "PCX", "SGI", "JPEG2000", "DDS")


@cache
def pictures() -> tuple[bytes, ...]:
    """Return pictures of every mode and of many formats, animated, turned, in tiles, and with profiles."""
    y, x = np.mgrid[:SIDE, :SIDE]
    colour = np.stack([12 * x, 12 * y, 6 * (x + y), 255 - 10 * x], axis=-1).astype(np.uint8)
    rgba = Image.fromarray(colour, "RGBA")
    modes = {m: rgba.convert(m) for m in ("RGB", "L", "LA", "P", "1", "CMYK", "YCbCr", "LAB", "HSV") if m != "LAB"}
    modes |= {"RGBA": rgba, "I;16": Image.fromarray((400 * x).astype(np.uint16)), "F": Image.fromarray(x / 20.0, "F")}
    modes |= {"I": Image.fromarray((x * 70000).astype(np.int32)), "PA": rgba.convert("PA")}
    exif = Image.Exif()
    exif[0x0112] = 6
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    every: list[dict[str, Any]] = [{}, {"exif": exif}, {"icc_profile": profile, "exif": exif}]
    every += [{"compression": name} for name in ("tiff_lzw", "tiff_adobe_deflate", "packbits", "jpeg", "group4")]
    every += [{"progressive": True}, {"save_all": True, "append_images": [rgba.convert("RGB")] * 2}, {"lossless": True}]
    found = set()
    for name in FORMATS:
        for image in modes.values():
            for options in every:
                file = io.BytesIO()
                try:
                    image.save(file, name, **options)
                except (OSError, ValueError, KeyError, TypeError, AttributeError):
                    continue  # a format without this mode
                found.add(file.getvalue())
    return tuple(sorted(found))


def png_like(random: Random) -> bytes:
    """Return a PNG file whose chunks have right checksums but say anything."""
    width, height = (random.choice((1, 8, 16, 20, 20, 0, 2**31 - 1, 20_000)) for _ in range(2))
    head = struct.pack(">IIBBBBB", width, height, random.choice((1, 2, 4, 8, 16, 3)), random.choice((0, 2, 3, 4, 6, 1)),
                       random.choice((0, 0, 0, 1)), 0, random.choice((0, 0, 1, 2)))  # fmt: skip
    data = zlib.compress(random.randbytes(random.choice((0, 8, 300, 1700))))
    chunks = [(b"IHDR", head), (b"IDAT", data), (b"IEND", b"")]
    extra = [(b"tRNS", random.randbytes(6)), (b"PLTE", random.randbytes(random.choice((3, 48, 7)))),
             (b"iCCP", b"a\0\0" + data), (b"zTXt", b"a\0\0" + zlib.compress(bytes(1 << 20))), (b"eXIf", data),
             (b"acTL", struct.pack(">II", 2**31, 0)), (b"gAMA", b"\0\0\0\0"), (b"IHDR", head)]  # fmt: skip
    for _ in range(random.randrange(3)):
        chunks.insert(random.randrange(len(chunks)), random.choice(extra))
    out = b"\x89PNG\r\n\x1a\n"
    for kind, content in chunks:
        out += struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
    return out


def picture_like(random: Random) -> bytes:
    """Return a damaged picture of any format."""
    kind = random.random()
    if kind < 0.2:
        return png_like(random)
    content = random.choice(pictures())
    return content if kind < 0.25 else some_bytes(content, random)


def shown(content: bytes) -> int:
    """Return what a picture of the declared size takes, in floating-point numbers."""
    try:
        with Image.open(io.BytesIO(content)) as image:
            pixels = image.width * image.height
    except Exception:  # what cannot be opened declares nothing
        pixels = 0
    # What has too few bytes for its pixels, or is a bomb in Pillow's opinion, is not decoded.
    return 40 * len(content) + 40 * min(pixels, max(FEW_PIXELS, 8 * MOST_INFLATED * len(content)), 180_000_000)


def _picture(name: str, read: Callable[[Path], object]) -> Callable[[Path], Parser]:
    def parser(folder: Path) -> Parser:
        path = folder / "picture.png"

        def of_bytes(content: bytes) -> None:
            path.write_bytes(content)
            read(path)

        return Parser(name, of_bytes, picture_like, shown)

    return parser


def _size_and_mask(path: Path) -> None:
    read_mask(path)
    picture_size(path)


@cache
def volumes() -> tuple[tuple[str, bytes], ...]:
    """Return files of volumes in every format: suffix and content."""
    import tempfile

    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkIOImage import vtkMetaImageWriter, vtkNIFTIImageWriter
    from vtkmodules.vtkIOLegacy import vtkStructuredPointsWriter
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

    from svv.dvr.read.grids import from_array

    image = from_array(np.arange(60, dtype=np.int16).reshape(3, 4, 5))
    labelled = numpy_to_vtk(np.arange(60, dtype=np.float32), deep=True)
    labelled.SetName("b")
    image.GetPointData().AddArray(labelled)
    found = [(".mha", (META + "abcdefgh").encode()), (".vti", VTI.encode("latin-1"))]
    with tempfile.TemporaryDirectory() as folder:
        for suffix, writer in ((".vti", vtkXMLImageDataWriter), (".vtk", vtkStructuredPointsWriter),
                               (".mha", vtkMetaImageWriter), (".nii", vtkNIFTIImageWriter)):  # fmt: skip
            for mode in range(3 if suffix != ".nii" else 1):
                made, path = writer(), Path(folder) / f"v{suffix}"
                made.SetInputData(image)
                made.SetFileName(str(path))
                if suffix == ".vti":
                    (made.SetDataModeToAscii, made.SetDataModeToBinary, made.SetDataModeToAppended)[mode]()
                elif suffix == ".vtk":
                    (made.SetFileTypeToASCII, made.SetFileTypeToBinary, made.SetFileTypeToBinary)[mode]()
                elif suffix == ".mha":
                    made.SetCompression(mode == 1)
                made.Write()
                found.append((suffix, path.read_bytes()))
    head = "NRRD0004\ntype: short\ndimension: 3\nsizes: 5 4 3\nspacings: 1 2 3\nspace origin: (0,0,0)\nendian: little\n"
    data = np.arange(60, dtype=np.int16).tobytes()
    import gzip

    found.append((".nrrd", f"{head}encoding: raw\n\n".encode() + data))
    found.append((".nrrd", f"{head}encoding: gzip\n\n".encode() + gzip.compress(data)))
    for compression in (None, "tiff_lzw", "tiff_adobe_deflate"):
        pages, file = [Image.fromarray(page) for page in np.zeros((3, 4, 5), np.uint16)], io.BytesIO()
        pages[0].save(file, "TIFF", save_all=True, append_images=pages[1:], compression=compression)
        found.append((".tif", file.getvalue()))
    file = io.BytesIO()
    np.save(file, np.zeros((3, 4, 5), np.float32))
    found.append((".npy", file.getvalue()))
    found.append((".slc", b"11111 5 4 3 8 1.0 1.0 1.0 0 0 0 0 2 2 X" + b"abcdefgh" * 60))
    return tuple(found)


def started(folder: Path) -> Callable[[], object]:
    """Return a function that starts the process of VTK's readers, if a crash has ended it."""
    from svv.dvr.read.reader_process import apart
    from svv.dvr.read.volumes import read_volume

    def ready() -> None:
        if apart._process is None:
            (folder / "whole.vti").write_bytes(VTI.encode("latin-1"))
            read_volume(folder / "whole.vti")

    return ready


def read_apart(folder: Path) -> Parser:
    """Volumes of all formats, as ``svv`` reads them: VTK's readers run in a process apart from this one."""
    from svv.dvr.read.volumes import read_volume

    every = volumes()
    worded = {
        number: text_like(content.decode("latin-1"))
        for number, (suffix, content) in enumerate(every)
        if suffix in (".vti", ".vtk", ".mha", ".nrrd", ".slc")
    }

    def make(random: Random) -> bytes:
        number = random.randrange(len(every))
        content = every[number][1]
        if number in worded and random.random() < 0.6:
            content = worded[number](random).decode("utf-8", "replace").encode("latin-1", "replace")
        elif random.random() < 0.98:
            content = some_bytes(content, random)
        return bytes([number]) + content

    def read(content: bytes) -> None:
        suffix = every[content[0] % len(every)][0]
        path = folder / f"volume{suffix}"
        path.write_bytes(content[1:])
        read_volume(path)

    return Parser("volumes", read, make, lambda content: 1 << 20, time.perf_counter, started(folder))


def names(folder: Path) -> Parser:
    """Volumes whose files have odd names and headers that name other files."""
    from svv.dvr.read.volumes import read_volume

    (folder / "other.raw").write_bytes(b"abcdefgh")

    def make(random: Random) -> bytes:
        return META.replace("LOCAL", random.choice((*TEXTS, "other.raw", "LIST", "o%d.raw 1 2 1"))).encode(
            "utf-8", "surrogatepass"
        )

    def read(content: bytes) -> None:
        path = folder / "named.mhd"
        path.write_bytes(content)
        read_volume(path)

    return Parser("volumes that name files", read, make, clock=time.perf_counter, ready=started(folder))


ALL = {
    "styles": _picture("style pictures", read_style), "masks": _picture("masks", _size_and_mask),
    "images": _picture("images of views", decode), "volumes": read_apart, "names": names,
}  # fmt: skip
