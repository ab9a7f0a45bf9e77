"""Render an orbit around a scene as a movie or as frames, optionally next to the volume as ParaView renders it.

Run it with `svv pvpython`.
"""

from pathlib import Path

import numpy as np

from svv.errors import BadInput
from svv.pv import scripts

EXAMPLES = (
    "svv pvpython render_orbit.py styled.svv --out orbit.mp4",
    "svv pvpython render_orbit.py styled.svv --volume foot.vti --tf bones.json --network pcn styled --out orbit.mp4",
    "svv pvpython render_orbit.py scene.svv --volume session.pvsm --frames 61 --size 800 --out frames",
)


def main() -> None:
    """Read the arguments and render."""
    parser = scripts.parser(__doc__, *EXAMPLES)
    parser.add_argument("scene", type=Path, help="a trained scene (.svv)")
    parser.add_argument("--out", "-o", type=Path, required=True, help="an .mp4 file, or a folder for the frames")
    parser.add_argument(
        "--network", nargs="+", choices=("base", "pcn", "styled"), help="a column for each; by default the last network"
    )
    parser.add_argument("--volume", type=Path, help="an additional column: this volume, or that of this state (.pvsm)")
    parser.add_argument("--tf", type=Path, help="its transfer function, a ParaView preset; by default as it is shown")
    parser.add_argument("--array", help="name of its array, if the file has several")
    parser.add_argument("--frames", type=int, default=181, metavar="N", help="number of frames (181)")
    parser.add_argument("--size", type=int, default=400, metavar="PIXELS", help="width and height of each column (400)")
    parser.add_argument("--fps", type=float, default=30.0, help="frames per second of a movie (30)")
    chosen = parser.parse_args()
    scripts.run(lambda: render(chosen), __file__)


def render(chosen) -> None:
    """Render the orbit frame by frame."""
    from svv.fields.scene.scene import Scene
    from svv.io.files.atomic import check_writable, make_folder
    from svv.io.pictures.output import remove_other_frames, write_mp4, write_png
    from svv.progress import shown
    from svv.render.frames import orbit
    from svv.render.pictures import over_white, sheet

    if chosen.frames < 2 or not 16 <= chosen.size <= 4096:
        raise BadInput("An orbit needs at least 2 frames, and a size of 16 to 4096 pixels.")
    movie = chosen.out.suffix == ".mp4"
    if movie:
        check_writable(chosen.out)
    scene = Scene.load(chosen.scene)
    cameras = orbit(scene, chosen.frames, chosen.size, chosen.size)
    networks = chosen.network or [scene.networks[-1]]
    view = None if chosen.volume is None else scripts.open_volume(chosen.volume, chosen.tf, chosen.array)[1]

    def frames(progress):
        for number, camera in enumerate(cameras):
            progress(number / len(cameras), f"frame {number + 1} of {len(cameras)}")
            columns = [] if view is None else [as_paraview_renders(view, camera)]
            columns += [over_white(scene.render(camera, network).rgba) for network in networks]
            labels = ["volume rendering"] * (view is not None) + networks
            yield sheet([columns], labels) if len(columns) > 1 else np.asarray(columns[0])
        progress(1.0, "")

    with shown("Rendering") as progress:
        if movie:
            write_mp4(chosen.out, frames(progress), chosen.fps)
        else:
            folder = make_folder(chosen.out)
            remove_other_frames(folder, 0, {})
            for number, picture in enumerate(frames(progress)):
                write_png(folder / f"{number:04d}.png", picture, made="render_orbit.py")
    print(chosen.out)


def as_paraview_renders(view, camera) -> np.ndarray:
    """Return what a 3D view of ParaView shows from a camera, on white. (height, width, 3) uint8"""
    from paraview import simple
    from vtkmodules.util.numpy_support import vtk_to_numpy

    matrix = camera.camera_to_world
    view.ViewSize = [camera.width, camera.height]
    view.UseColorPaletteForBackground, view.BackgroundColorMode, view.Background = 0, "Single Color", [1.0] * 3
    view.OrientationAxesVisibility = 0
    view.CameraPosition, view.CameraViewUp = matrix[:3, 3].tolist(), matrix[:3, 1].tolist()
    view.CameraFocalPoint = (matrix[:3, 3] - np.linalg.norm(matrix[:3, 3]) * matrix[:3, 2]).tolist()
    view.CameraParallelProjection = int(camera.is_orthographic)
    half = 0.5 * camera.height / camera.focal
    if camera.is_orthographic:
        view.CameraParallelScale = half
    else:
        view.CameraViewAngle = float(np.degrees(2.0 * np.arctan(half)))
    simple.Render(view)
    image = view.CaptureWindow(1)
    width, height, _ = image.GetDimensions()
    pixels = vtk_to_numpy(image.GetPointData().GetScalars()).reshape(height, width, -1)
    return np.ascontiguousarray(pixels[::-1, :, :3])


if __name__ == "__main__":
    main()
