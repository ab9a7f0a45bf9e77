"""The frames of a shot: which there are, and their files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, overload

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from svv.core.colour.colour import WHITE
from svv.core.geometry.cameras import Camera
from svv.errors import BadInput, Progress, part, silent
from svv.fields.scene.history import MOST_CUTS
from svv.io.files.atomic import check_writable
from svv.io.files.keyed_results import digest
from svv.io.pictures.output import write_mp4
from svv.options.shots import Shot, Sweep
from svv.render.frames import COLOURS, Played, RenderSettings, draw_frames, write_frames
from svv.render.shots.moves import Moves
from svv.render.shots.tracks import KeyFrames, Moment

if TYPE_CHECKING:
    from svv.fields.scene.scene import Scene

MOST_FRAMES = 1 << 18
"""Most frames of a film: 2.4 hours at 30 a second."""

PREPARED, DRAWN = 0.02, 0.99
"""Parts of the progress at which regions have been measured, and frames drawn; then a movie is completed."""


class Film(Played):
    """A shot of a scene as frames, each of which is found when it is asked for.

    Frame k shows the shot after k / fps seconds. The last one shows its end; a shot that ends as it begins goes without
    that frame, so that it repeats without a doubled one.
    """

    def __init__(
        self, scene: Scene, shot: Shot, size: tuple[int, int] | None = None, fps: float = 30.0,
        progress: Progress = silent,
    ) -> None:  # fmt: skip
        """Prepare the frames, of a width and height in pixels, by default the shot's; ``fps``: frames per second.

        Raises BadInput if the shot does not fit the scene, or has too many frames.
        """
        if shot.painting is not None:
            scene = scene.with_variant(shot.painting)
        super().__init__(scene, ())
        self.shot, self.fps = shot, fps
        count = round(shot.seconds * fps)
        if not 1 <= count < MOST_FRAMES:
            raise BadInput(
                f"A shot of {shot.seconds:g} s has {count} frames at {fps:g} a second: between 1 and {MOST_FRAMES}."
            )
        self._moves = Moves(scene, shot, progress)
        self._keys = KeyFrames(scene, shot.keys, size or shot.size or (800, 800), self._moves.growing)
        self._moment: tuple[int, Moment] | None = None  # the last one that was asked for
        self._check_cuts()
        first, last = self._at(0.0), self._at(shot.seconds)
        self.cameras = _Cameras(self, count if _alike(first, last) else count + 1)

    def _check_cuts(self) -> None:
        """Raise BadInput if moves add so many cuts that there are too many at a time."""
        sweeps = [move for move in self.shot.moves if isinstance(move, Sweep)]
        ends = {t for move in sweeps for t in (move.start, move.start + (move.duration or 0.0))}
        turns = sorted({0.0, self.shot.seconds, *ends, *(key.time for key in self.shot.keys)})
        for time in (*turns, *(0.5 * (one + after) for one, after in pairwise(turns))) if sweeps else ():
            if (count := len(self._at(min(time, self.shot.seconds)).cuts)) > MOST_CUTS:
                raise BadInput(
                    f"At {time:g} s, the shot has {count} cuts with those of its moves, and a scene has at most "
                    f"{MOST_CUTS}: leave some out."
                )

    def moment(self, number: int) -> Moment:
        """Return what a frame shows."""
        if self._moment is None or self._moment[0] != number:
            self._moment = number, self._at(min(number / self.fps, self.shot.seconds))
        return self._moment[1]

    def at(self, number: int) -> Scene:
        """Return the scene of a frame; neighbours of the same time step share its networks."""
        moment = self.moment(number)
        return moment.of(self.scene if moment.step is None else self.at_step(moment.step))

    def told(self, number: int) -> dict[str, object]:
        """Return what a frame depends on besides its camera and the scene."""
        return self.moment(number).told()

    def _at(self, time: float) -> Moment:
        return self._moves.at(time, self._keys.at(time))


class _Cameras(Sequence[Camera]):
    """The cameras of a film's frames, none of which is kept."""

    def __init__(self, film: Film, count: int) -> None:
        self._film, self._count = film, count

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, number: int) -> Camera: ...
    @overload
    def __getitem__(self, number: slice) -> list[Camera]: ...
    def __getitem__(self, number: int | slice) -> Camera | list[Camera]:
        if isinstance(number, slice):
            return [self[k] for k in range(self._count)[number]]
        return self._film.moment(range(self._count)[number]).camera


def _alike(one: Moment, other: Moment) -> bool:
    """Return whether two moments show the same."""
    lens, after = ((c.fov_x, c.span_x or 0.0, *c.principal_point) for c in (one.camera, other.camera))
    near = np.allclose(one.camera.camera_to_world, other.camera.camera_to_world, rtol=1e-9, atol=1e-9)
    return bool(near and np.allclose(lens, after, rtol=1e-9) and digest(one.told()) == digest(other.told()))


def render_shot(
    path: str | Path,
    scene: Scene,
    shot: Shot,
    size: tuple[int, int] | None = None,
    shown: RenderSettings = COLOURS,
    fps: float = 30.0,
    progress: Progress = silent,
    those: slice = slice(None),
) -> None:
    """Render a shot of a scene into a movie, over white unless a background is given, or into a folder of frames.

    An interrupted call can be repeated: frames that are there are not drawn again. Those of a movie lie in the folder
    ``NAME.mp4.frames`` beside it until it is complete.

    Args:
        path: The .mp4 to write, or a folder, as in :func:`svv.render.frames.write_frames`.
        scene: The scene.
        shot: What is seen of it, and when.
        size: Width and height of the frames in pixels, by default the shot's, or 800.
        shown: What the frames show.
        fps: Frames per second.
        progress: Called often.
        those: Which of the frames to render into a folder; others may render the rest.

    Raises:
        BadInput: The shot does not fit the scene, the scene does not have that network, or a file cannot be written.

    >>> shot = svv.read_shot({"duration": 0.5, "moves": [{"move": "turntable"}]})
    >>> svv.render_shot("turn.mp4", scene, shot, (32, 32), fps=6.0)
    """
    path = Path(path)
    movie = path.suffix.lower() == ".mp4"
    if movie and shown.what == "depth":
        raise BadInput("The depths of a shot are pictures of 16 bits: give --out as a folder.")
    if movie:
        check_writable(path)
    shown = replace(shown, background=shown.background or shot.background)
    film = Film(scene, shot, size, fps, part(progress, 0.0, PREPARED))
    if not movie:
        write_frames(path, film, film.cameras, shown, part(progress, PREPARED, 1.0), those)
        return
    shown = replace(shown, background=shown.background or WHITE, temporary=True)
    folder, files = path.with_name(path.name + ".frames"), list[Path]()

    def pictures() -> Iterator[NDArray[np.uint8]]:  # encoded by another process while the next one is drawn
        for file, levels in draw_frames(folder, film, film.cameras, shown, part(progress, PREPARED, DRAWN)):
            files.append(file)
            yield _picture_in(file, shown) if levels is None else levels

    write_mp4(path, pictures(), fps)
    for file in files:
        file.unlink(missing_ok=True)
    with suppress(OSError):  # files of others are in it
        folder.rmdir()
    progress(1.0, "done")


def _picture_in(file: Path, shown: RenderSettings) -> NDArray[np.uint8]:
    """Read a frame over the background."""
    back = Image.new("RGBA", (1, 1), tuple(round(255 * c) for c in shown.background or WHITE))
    with Image.open(file) as picture:
        over = picture.convert("RGBA")
    return np.asarray(Image.alpha_composite(back.resize(over.size), over).convert("RGB"))
