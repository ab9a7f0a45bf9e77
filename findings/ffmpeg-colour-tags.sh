#!/usr/bin/env bash
# FFmpeg 9 in imageio-ffmpeg 0.8.1: the options that tag a movie's primaries and transfer function are dropped,
# while FFmpeg 7 in 0.7.0 writes them.
#
# A movie that libx264 makes of RGB frames is converted by the matrix of BT.601 and has no tag at all, in both.
# Browsers guess: Firefox takes BT.709 at every size, Chromium from 720 rows on, so pure red becomes (255, 24, 0).
# Tags of the matrix alone do not help in Chromium. With FFmpeg 9, -color_primaries and -color_trc are accepted and
# leave "unknown"; the filter setparams writes all three in both versions.
#
# Seen: what FFmpeg says of the pixels of three files: without options, with the options, with the filter.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
for version in 0.7.0 0.8.1; do
    python3 -m venv "$version"
    "$version/bin/pip" install -q --disable-pip-version-check "imageio-ffmpeg==$version" setuptools
done
for version in 0.7.0 0.8.1; do
    "$version/bin/python" - >>seen <<'PY'
import subprocess

import imageio_ffmpeg

ffmpeg = imageio_ffmpeg.get_ffmpeg_exe()
print("FFmpeg", imageio_ffmpeg.get_ffmpeg_version().lstrip("n").split(".")[0])
red = b"\xff\0\0" * 64 * 64
tags = ["-colorspace", "smpte170m", "-color_primaries", "bt709", "-color_trc", "iec61966-2-1", "-color_range", "tv"]
tagged = "scale=out_color_matrix=bt601:out_range=tv,setparams=colorspace=smpte170m:color_primaries=bt709:color_trc=iec61966-2-1:range=tv"
for options in ([], tags, ["-vf", tagged]):
    frames = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", "64x64", "-r", "10", "-i", "-"]
    subprocess.run(
        [ffmpeg, "-y", "-v", "error", *frames, "-c:v", "libx264", "-pix_fmt", "yuv420p", *options, "red.mp4"],
        input=red * 3, check=True,
    )
    said = subprocess.run([ffmpeg, "-i", "red.mp4"], capture_output=True, text=True).stderr
    print(next(line for line in said.splitlines() if "Video: h264" in line).split("yuv420p")[1].split(", 64x")[0])
PY
done
diff - seen <<'SEEN'
FFmpeg 7
(progressive)
(tv, smpte170m/bt709/iec61966-2-1, progressive)
(tv, smpte170m/bt709/iec61966-2-1, progressive)
FFmpeg 9
(progressive)
(tv, smpte170m/unknown/unknown, progressive)
(tv, smpte170m/bt709/iec61966-2-1, progressive)
SEEN
echo "as described"
