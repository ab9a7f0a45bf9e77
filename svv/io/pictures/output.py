"""Rendered pictures on disk: PNG, movies (.mp4), and VTK image data (.vti) without VTK, which svv does not need.

h and w are height and width in pixels. Row 0 is at the top everywhere except inside a .vti, where it is at the bottom.
"""

from __future__ import annotations

import re
import struct
import subprocess
import zlib
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from svv.errors import BadInput, Progress, part, silent
from svv.io.files.atomic import atomic_path, cannot_write

EMPTY_REGION = 255
"""Index of pixels without a region in a region PNG."""

VTK_BLOCK = 1 << 24
"""Bytes of an array that are compressed together."""

COLOURS = (
    *("-vf", "scale=out_color_matrix=bt601:out_range=tv,setparams=colorspace=smpte170m:color_primaries=bt709:"
      "color_trc=iec61966-2-1:range=tv"),
    *("-x264-params", "colormatrix=smpte170m:colorprim=bt709:transfer=iec61966-2-1"),
)  # fmt: skip
"""FFmpeg's options that make a movie's colours of sRGB, and tag them as what they are.

Browsers guess what a movie without tags means: Firefox always takes ITU-R BT.709, Chromium from 720 rows on, while
FFmpeg makes BT.601 of RGB, which is off by up to 39 of 255. Chromium ignores tags of matrix and range alone, and BT.709
throughout is right to 12 levels only. FFmpeg 4 does not pass the filter's tags on, FFmpeg 9 ignores its own options for
primaries and transfer function; with both of these, it tags the stream, and from FFmpeg 5 on the file as well.
"""

_VTK_TYPES = {"uint8": "UInt8", "int16": "Int16", "float32": "Float32"}


def to_bytes(image: ArrayLike) -> NDArray[np.uint8]:
    """Return values in [0, 1] (clamped; NaN becomes 0) as rounded 8-bit levels."""
    values = np.nan_to_num(np.asarray(image, dtype=np.float32), nan=0.0)
    return np.rint(np.clip(values, 0.0, 1.0) * 255.0).astype(np.uint8)


def write_png(path: str | Path, image: ArrayLike, made: str = "", compression: int = 4) -> None:
    """Write a picture (h, w, 3 or 4) with straight alpha, 8-bit levels or values in [0, 1], as 8-bit PNG.

    Args:
        path: The file.
        image: The picture.
        made: What it was made from, for :func:`made_of`.
        compression: 0 (quick) to 9 (small).

    Raises:
        BadInput: The file cannot be written (see :func:`svv.io.files.atomic.atomic_path`).

    >>> svv.write_png("grey.png", np.full((32, 48, 3), 0.5))
    """
    values = np.asarray(image)
    levels = values if values.dtype == np.uint8 else to_bytes(values)
    with atomic_path(path) as temporary:
        Image.fromarray(levels).save(temporary, format="PNG", compress_level=compression, pnginfo=_text(made))


FRAME = re.compile(r"(\d{4}|[1-9]\d{4,})\.png")
"""Names of the frames in a folder, as all who write some name them: ``0000.png`` and so on."""

MADE = "svv:made"
"""Name of the text of a PNG that says what it was made from."""


def made_of(path: Path) -> str:
    """Return what a PNG says that it was made from; empty if there is no such file, or it does not say."""
    try:
        with Image.open(path) as picture:
            return str(picture.info.get(MADE, ""))
    except (OSError, ValueError, SyntaxError):
        return ""


def is_frame(path: Path) -> bool:
    """Return whether a file is named as the frames in a folder are: ``0000.png`` and so on."""
    return FRAME.fullmatch(path.name) is not None


def remove_other_frames(folder: Path, count: int, made: Mapping[int, str]) -> None:
    """Remove numbered PNGs (``0000.png`` and so on) of other runs from a folder, so that it never mixes two runs.

    Only PNGs that say what they were made from (:func:`made_of`) are removed, because only svv writes such files: those
    from the number ``count`` on, and those that were made from something else than ``made`` says of their number.
    Frames below ``count`` that it does not list belong to another process of the same run, and are left alone. Raises
    BadInput, and removes nothing, if the folder has numbered PNGs that svv did not write, and that are not to be
    replaced by frames of a folder in which svv wrote others.
    """
    try:
        found = {int(path.stem): path for path in folder.iterdir() if is_frame(path)}
        told = {number: made_of(path) for number, path in found.items()}
        ours = any(told.values())  # a frame that is damaged, or was replaced, is made again
        unknown = [number for number in found if not told[number] and not (ours and number < count)]
        others = sorted(found[number].name for number in unknown if found[number].exists())
        if others:
            raise BadInput(
                f"{folder} has pictures that svv did not write as frames ({', '.join(others[:3])}"
                f"{' ...' * (len(others) > 3)}): choose another folder, or move them."
            )
        for number, path in found.items():
            if number >= count or told[number] != made.get(number, told[number]):
                path.unlink(missing_ok=True)
    except OSError as error:
        raise cannot_write(folder, error) from error


def _text(made: str) -> PngInfo:
    text = PngInfo()
    if made:
        text.add_text(MADE, made)
    return text


def write_small_png(path: str | Path, levels: NDArray[np.uint8], bright: bool = False) -> None:
    """Write 8-bit levels (h, w, 3) as PNG with 256 colours, for viewing only: it has a third of the size.

    ``bright`` preserves small spots of strong colour rather than fine shades. Raises BadInput as :func:`write_png`.
    """
    method = Image.Quantize.MAXCOVERAGE if bright else Image.Quantize.MEDIANCUT
    few = Image.fromarray(levels).quantize(256, method, dither=Image.Dither.NONE)
    with atomic_path(path) as temporary:
        few.save(temporary, format="PNG", optimize=True)


def write_depth_png(path: str | Path, depth: ArrayLike, made: str = "") -> tuple[float, float]:
    """Write depth (h, w) in world units, NaN where empty, as 16-bit greyscale PNG.

    Level 0 means empty; levels 1 ... 65535 are linear from the nearest to the farthest depth, which are stored in the
    text of the file under ``svv:near`` and ``svv:far``, and returned, NaN if the picture is empty. For ``made``, see
    :func:`write_png`.
    """
    values = np.asarray(depth, dtype=np.float64)
    seen = values[np.isfinite(values)]
    near, far = (float(seen.min()), float(seen.max())) if seen.size else (np.nan, np.nan)
    _write_grey(path, values, (near, far), {"svv:near": near, "svv:far": far}, made)
    return near, far


def write_doubt_png(path: str | Path, doubt: ArrayLike, made: str = "") -> float:
    """Write expected errors (h, w) in [0, 1], NaN where empty, as 16-bit greyscale PNG.

    Level 0 means empty; levels 1 ... 65535 are linear from 0 to the largest error, which is stored in the text of the
    file under ``svv:largest``, and returned, 0 if there is none. For ``made``, see :func:`write_png`.
    """
    values = np.asarray(doubt, dtype=np.float64)
    largest = float(np.nan_to_num(values).max(initial=0.0))
    _write_grey(path, values, (0.0, largest), {"svv:largest": largest}, made)
    return largest


def _write_grey(
    path: str | Path, values: NDArray[np.float64], span: tuple[float, float], told: Mapping[str, float], made: str
) -> None:
    """Write values in a span, NaN where empty, as levels of 16 bits, 0 where empty."""
    seen, levels = np.isfinite(values), np.zeros(values.shape, np.uint16)
    levels[seen] = 1 + np.rint(65534.0 * (values[seen] - span[0]) / max(span[1] - span[0], np.finfo(float).tiny))
    text = _text(made)
    for name, value in told.items():
        text.add_text(name, repr(value))
    with atomic_path(path) as temporary:
        Image.fromarray(levels).save(temporary, format="PNG", pnginfo=text)


def write_region_png(path: str | Path, region: ArrayLike, colours: ArrayLike, made: str = "") -> None:
    """Write a map of regions (h, w), -1 ... 254, -1 where empty, as indexed PNG whose indices are the regions.

    ``colours`` (regions, 3) in [0, 1] show them; for ``made``, see :func:`write_png`.
    """
    indices = np.asarray(region, dtype=np.int64)
    table = np.full((256, 3), 255, np.uint8)
    shown = to_bytes(colours)
    table[: len(shown)] = shown
    picture = Image.fromarray(np.where(indices < 0, EMPTY_REGION, indices).astype(np.uint8))
    picture.putpalette(table.tobytes())
    with atomic_path(path) as temporary:
        picture.save(temporary, format="PNG", transparency=EMPTY_REGION, pnginfo=_text(made))


def region_picture(region: ArrayLike, colours: ArrayLike) -> NDArray[np.float32]:
    """Return a region map (h, w) as an RGBA picture (h, w, 4), transparent where -1; colours (regions, 3)."""
    table = np.zeros((len(np.asarray(colours)) + 1, 4), np.float32)
    table[:-1, :3] = np.asarray(colours)
    table[:-1, 3] = 1.0
    return table[np.asarray(region)]  # -1 is the last row


def depth_picture(depth: ArrayLike, near: float, far: float) -> NDArray[np.float32]:
    """Return depth (h, w) as an RGBA picture (h, w, 4): dark at ``near``, light at ``far``, transparent where empty."""
    values = np.asarray(depth, dtype=np.float32)
    grey = 0.1 + 0.75 * np.clip((np.nan_to_num(values, nan=far) - near) / max(far - near, 1e-30), 0.0, 1.0)
    return np.stack([grey, grey, grey, np.isfinite(values)], axis=-1).astype(np.float32)


HEAT = np.array([[1.0, 0.98, 0.82], [0.99, 0.75, 0.29], [0.89, 0.25, 0.13], [0.35, 0.0, 0.12]])
"""Colours of expected errors, from none to the largest: ever darker, so that a grey print shows them, too. (4, 3)"""


def darkest_from(doubt: ArrayLike) -> float:
    """Return the expected error that 1 % of the pixels of an image exceed, NaN where empty; 0 if it shows nothing."""
    values = np.asarray(doubt, dtype=np.float64)
    seen = values[np.isfinite(values)]
    return float(np.quantile(seen, 0.99)) if seen.size else 0.0


def doubt_picture(doubt: ArrayLike, largest: float) -> NDArray[np.float32]:
    """Return expected errors (h, w) as an RGBA picture (h, w, 4), transparent where NaN: dark red from ``largest`` on.

    >>> doubt_picture([[0.0, np.nan]], 0.1)[0, :, 3].tolist()
    [1.0, 0.0]
    """
    values = np.asarray(doubt, dtype=np.float64)
    at = np.clip(np.nan_to_num(values) / max(largest, 1e-12), 0.0, 1.0)
    colours = [np.interp(at, np.linspace(0.0, 1.0, len(HEAT)), column) for column in HEAT.T]
    return np.stack([*colours, np.isfinite(values)], axis=-1).astype(np.float32)


def write_vti(
    path: str | Path, rgba: ArrayLike, depth: ArrayLike, region: ArrayLike, value: ArrayLike | None = None,
    doubt: ArrayLike | None = None,
) -> None:  # fmt: skip
    """Write one view as VTK image data: a slice of scalars ``RGBA``, with ``Depth``, ``Region``, ``Value``, ``Doubt``.

    It uses VTK's XML format with appended, zlib-compressed arrays. Row 0 is at the bottom; the spacing is one pixel.
    Colour (h, w, 4) in [0, 1] with straight alpha is stored as uint8, depth (h, w) in world units, NaN where empty, as
    float32, and the number of the region (h, w), -1 where empty, as int16; the volume's value (h, w), NaN where it is
    not known, and expected errors, as float32, if they are given. Raises BadInput as :func:`write_png`.
    """
    arrays: dict[str, NDArray[np.generic]] = {
        "RGBA": to_bytes(rgba),
        "Depth": np.asarray(depth, dtype=np.float32),
        "Region": np.asarray(region, dtype=np.int16),
    }
    also = {"Value": value, "Doubt": doubt}
    arrays |= {name: np.asarray(given, np.float32) for name, given in also.items() if given is not None}
    write_volume(path, {name: np.flipud(array)[None] for name, array in arrays.items()})


def write_volume(
    path: str | Path,
    arrays: Mapping[str, NDArray[np.generic]],
    origin: Sequence[float] = (0.0, 0.0, 0.0),
    spacing: Sequence[float] = (1.0, 1.0, 1.0),
    fields: Mapping[str, NDArray[np.float64]] | None = None,
    progress: Progress = silent,
) -> None:
    """Write a regular grid of points as VTK image data, by convention ``NAME.vti``.

    ``arrays`` of points by name, the first of which become the scalars, are (nz, ny, nx) or (nz, ny, nx, channels);
    ``origin`` and ``spacing`` (x, y, z) are the first point and the distances between points in world units; ``fields``
    are field data by name (n, channels). Raises BadInput as :func:`write_png`.
    """
    from xml.sax.saxutils import quoteattr  # takes 20 ms: it imports what reads web pages

    depth, height, width = next(iter(arrays.values())).shape[:3]
    entries, blocks, offset = [], [], 0
    for number, (name, array) in enumerate(arrays.items()):
        block = _vtk_block(array, part(progress, number / len(arrays), (number + 1) / len(arrays)))
        components = 1 if array.ndim == 3 else array.shape[3]
        entries.append(
            f'<DataArray type="{_VTK_TYPES[array.dtype.name]}" Name={quoteattr(name)} '
            f'NumberOfComponents="{components}" format="appended" offset="{offset}"/>'
        )
        blocks.append(block)
        offset += len(block)
    extent = f"0 {width - 1} 0 {height - 1} 0 {depth - 1}"
    head = (
        '<?xml version="1.0"?>\n'
        '<VTKFile type="ImageData" version="1.0" byte_order="LittleEndian" header_type="UInt64" '
        'compressor="vtkZLibDataCompressor">\n'
        f'<ImageData WholeExtent="{extent}" Origin="{_format_numbers(origin)}" Spacing="{_format_numbers(spacing)}">\n'
        f'{_field_data(fields or {})}<Piece Extent="{extent}">\n'
        f"<PointData Scalars={quoteattr(next(iter(arrays)))}>\n" + "\n".join(entries) + "\n</PointData>\n</Piece>\n"
        '</ImageData>\n<AppendedData encoding="raw">\n_'
    )
    with atomic_path(path) as temporary:
        temporary.write_bytes(head.encode() + b"".join(blocks) + b"\n</AppendedData>\n</VTKFile>\n")


def _field_data(fields: Mapping[str, NDArray[np.float64]]) -> str:
    from xml.sax.saxutils import quoteattr

    lines = [
        f'<DataArray type="Float64" Name={quoteattr(name)} NumberOfComponents="{values.shape[1]}" '
        f'NumberOfTuples="{len(values)}" format="ascii">{_format_numbers(values.ravel().tolist())}</DataArray>\n'
        for name, values in fields.items()
    ]
    return f"<FieldData>\n{''.join(lines)}</FieldData>\n" if lines else ""


def _format_numbers(numbers: Sequence[float]) -> str:
    return " ".join(f"{number:.17g}" for number in numbers)


def _vtk_block(array: NDArray[np.generic], progress: Progress = silent) -> bytes:
    """Return a compressed array with its header.

    The header has the number of blocks, their size, that of a last smaller one or 0, and each one's compressed size.
    """
    content = np.ascontiguousarray(array.astype(array.dtype.newbyteorder("<"), copy=False)).data.cast("B")
    packed = []
    for first in range(0, len(content), VTK_BLOCK):
        progress(first / len(content), "compressing")
        packed.append(zlib.compress(content[first : first + VTK_BLOCK], 3))
    size = VTK_BLOCK if len(packed) > 1 else len(content)
    rest = len(content) % VTK_BLOCK if len(packed) > 1 else 0
    return struct.pack(f"<{3 + len(packed)}Q", len(packed), size, rest, *map(len, packed)) + b"".join(packed)


def write_mp4(path: str | Path, frames: Iterable[NDArray[np.uint8]], fps: float = 30.0, crf: int = 18) -> None:
    """Write frames (h, w, 3) uint8, all of the same size, as an H.264 movie that browsers and players can show.

    Its colours are those of the frames, which are sRGB, to 3 levels where they are flat, in browsers as well. An odd
    width or height grows by one pixel (the last one is repeated), because the pixel format needs even sizes. ``fps``
    are frames per second; ``crf`` is the constant rate factor: 18 looks like the frames, 30 takes a quarter of the
    bytes. Raises BadInput if there is no frame, or the file cannot be written.
    """
    rest = iter(frames)
    first = next(rest, None)
    if first is None:
        raise BadInput("A movie needs at least one frame.")
    try:
        import imageio_ffmpeg as encoder
    except ImportError as error:
        raise BadInput(
            "Movies need the package imageio-ffmpeg, which is missing here: install it with "
            "`pip install imageio-ffmpeg`, or write the frames as pictures."
        ) from error
    more = [(0, size % 2) for size in first.shape[:2]]
    height, width = (size + size % 2 for size in first.shape[:2])
    with atomic_path(path) as temporary:
        writer = encoder.write_frames(
            str(temporary),
            (width, height),
            fps=fps,
            codec="libx264",
            quality=None,
            macro_block_size=2,
            output_params=[*COLOURS, "-crf", str(crf), "-preset", "fast", "-movflags", "+faststart"],
            ffmpeg_log_level="error",
        )
        count = 0
        try:
            writer.send(None)
            for frame in chain([first], rest):
                writer.send(np.ascontiguousarray(np.pad(frame, (*more, (0, 0)), mode="edge")))
                count += 1
        except OSError as error:
            if error.errno is not None:
                raise
            # imageio-ffmpeg raises its own error, which contains the encoder's whole log.
            raise BadInput(f"Cannot write {path}: the movie encoder stopped; is the disk full?") from error
        finally:
            writer.close()
        if not _is_whole(encoder, temporary, count):  # imageio-ffmpeg does not say how the encoder ended
            raise BadInput(f"Cannot write {path}: the movie encoder stopped at its end; is the disk full?")


def _is_whole(encoder: ModuleType, movie: Path, frames: int) -> bool:
    """Return whether a movie can be read to its end and has this number of frames; they are not decoded."""
    read = [encoder.get_ffmpeg_exe(), "-nostdin", "-v", "error", "-i", str(movie)]
    done = subprocess.run([*read, "-c", "copy", "-f", "framecrc", "-"], capture_output=True)
    found = sum(not line.startswith(b"#") for line in done.stdout.splitlines())
    return done.returncode == 0 and not done.stderr and found == frames
