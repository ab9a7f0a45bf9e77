"""Read movies back with ffmpeg."""

from __future__ import annotations

import subprocess
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray


def frames_of(path: str | Path) -> NDArray[np.uint8]:
    """All frames of a movie. (n, h, w, 3)"""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(path)]
    pictures = subprocess.run([*command, "-f", "image2pipe", "-vcodec", "ppm", "-"], capture_output=True, check=True)
    content = pictures.stdout  # each: P6, width and height, 255, and the pixels
    head = content.index(b"\n255\n") + 5
    width, height = (int(number) for number in content[:head].split()[1:3])
    frames = np.frombuffer(content, np.uint8).reshape(-1, head + 3 * width * height)
    return frames[:, head:].reshape(-1, height, width, 3)
