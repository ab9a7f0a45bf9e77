"""Write a Cinema database (Spec D) of a volume: ParaView's image extractor turns the camera all around it.

The images have straight alpha. The camera, which a database does not record, is written beside them as camera.json.
Run it with `svv pvpython`. A Catalyst script can import it too: that needs nothing but ParaView (see `set_up`).
"""

import csv
import json
import os
import shutil
import sys
from pathlib import Path

SWEEP = (14, 7)
"""Default numbers of phi and theta: 98 directions, none twice, 26 degrees apart at the equator."""

LEAST_THETA = 5
"""ParaView turns the camera over a pole in steps of 360 / theta degrees; at 90 or more, its view-up is lost."""

EXAMPLES = (
    "svv pvpython extract_views.py foot.vti --tf bones.json --out foot.cdb",
    "svv pvpython extract_views.py session.pvsm --phi 18 --theta 9 --size 800 --out foot.cdb",
    "svv pvpython extract_views.py foot.vti --black-and-white --out foot.cdb    # says how exact ParaView's alpha is",
)


# --- for Catalyst scripts, too: nothing here imports more than ParaView -----------------------------------------------


def set_up(view=None, phi: int = SWEEP[0], theta: int = SWEEP[1], size: int = 400, name: str = "views"):
    """Create an image extractor for a 3D view, by default the active one, that draws it from all around; return it.

    The background is transparent; axes and colour legends, which would be part of the images, are hidden. The camera's
    focal point and distance stay; its direction does not matter. There are ``phi`` angles around the vertical axis (1
    to 360) and ``theta`` over the poles (5 to 360; with an odd number, no direction is drawn twice), and ``size``
    pixels along both sides; the images' names begin with ``name``. In a Catalyst script:

        from extract_views import set_up, write_camera
        set_up(renderView1)
        write_camera(renderView1, "foot.cdb")
        options.ExtractsOutputDirectory = "foot.cdb"
        options.GenerateCinemaSpecification = 1
    """
    from paraview import simple

    view = view or simple.GetActiveView()
    view.OrientationAxesVisibility = 0
    for display in view.Representations:
        if getattr(display, "LookupTable", None):
            display.SetScalarBarVisibility(view, False)
    extractor = simple.CreateExtractor("PNG", view, registrationName=name)
    writer = extractor.Writer
    writer.FileName = name + "_{timestep:06d}{camera}.png"
    writer.ImageResolution = [size, size]
    writer.TransparentBackground = 1
    writer.CameraMode, writer.PhiResolution, writer.ThetaResolution = "Phi-Theta", phi, theta
    return extractor


def write_camera(view, folder) -> None:
    """Write a view's camera, which a database lacks, into its folder as camera.json; only the first rank does."""
    from paraview.modules.vtkRemotingCore import vtkProcessModule

    if vtkProcessModule.GetProcessModule().GetPartitionId():
        return
    camera = view.GetActiveCamera()
    numbers = {
        "focal_point": camera.GetFocalPoint(),
        "distance": camera.GetDistance(),
        "view_angle": camera.GetViewAngle(),
        "parallel_projection": bool(camera.GetParallelProjection()),
        "parallel_scale": camera.GetParallelScale(),
    }
    os.makedirs(folder, exist_ok=True)
    with open(os.path.join(folder, "camera.json"), "w", encoding="utf-8") as file:
        json.dump(numbers, file, indent=2)
        file.write("\n")


def angles(count: int) -> list[float]:
    """Return the angles at which ParaView draws, in degrees; for some counts (13, 19, 25, ...) rounding adds 360."""
    drawn, angle = [], 0.0
    while angle < 360.0:
        drawn.append(angle)
        angle += 360.0 / count
    return drawn


def repeated(phi: int, theta: int) -> tuple[int, int]:
    """Return how many images repeat a direction of another, and how many images there are.

    Beyond a pole, the camera is upside down: (phi, theta) looks from where (phi + 180, 180 - theta) does.
    """
    directions = set()
    for around in angles(phi):
        for over in angles(theta):
            beyond = 90.0 < over % 360.0 < 270.0
            height = 180.0 - over if beyond else (over + 180.0) % 360.0 - 180.0
            pole = abs(abs(height) - 90.0) < 1e-6
            turned = 0.0 if pole else (around + 180.0 * beyond) % 360.0
            directions.add((round(turned, 4) % 360.0, round(height, 4)))
    count = len(angles(phi)) * len(angles(theta))
    return count - len(directions), count


# --- the script -------------------------------------------------------------------------------------------------------


def main() -> None:
    """Read the arguments and write the database."""
    from svv.pv import scripts

    parser = scripts.parser(__doc__, *EXAMPLES)
    parser.add_argument("volume", type=Path, help="a volume that ParaView reads, or a state (.pvsm) that shows one")
    parser.add_argument("--out", "-o", type=Path, required=True, metavar="NAME.cdb", help="folder of the database")
    parser.add_argument("--tf", type=Path, help="transfer function, a ParaView preset; by default as it is shown")
    parser.add_argument("--array", help="name of the array, if the file has several")
    parser.add_argument("--phi", type=int, default=SWEEP[0], metavar="N", help=f"angles around ({SWEEP[0]})")
    parser.add_argument(
        "--theta", type=int, default=SWEEP[1], metavar="N",
        help=f"angles over the poles ({SWEEP[1]}); if odd, no direction is drawn twice, about half of phi is even",
    )  # fmt: skip
    parser.add_argument("--size", type=int, default=400, metavar="PIXELS", help="width and height of the images (400)")
    parser.add_argument(
        "--black-and-white", action="store_true",
        help="draw on black and on white too, take alpha from these, and say how far ParaView's own alpha was off",
    )  # fmt: skip
    chosen = parser.parse_args()
    scripts.run(lambda: extract(chosen), __file__)


def extract(chosen) -> None:
    """Draw the views into a folder beside the database's, which gets its name when it is complete."""
    from svv.errors import BadInput
    from svv.io.files.atomic import make_folder
    from svv.pv import scripts

    if not (1 <= chosen.phi <= 360 and LEAST_THETA <= chosen.theta <= 360 and 16 <= chosen.size <= 4096):
        raise BadInput(
            f"Choose 1 to 360 for phi, {LEAST_THETA} to 360 for theta (with fewer, ParaView's camera loses its "
            "direction at the poles), and a size of 16 to 4096 pixels."
        )
    if chosen.out.exists():
        raise BadInput(f"{chosen.out} exists already; delete it or choose another name.")
    twice, count = repeated(chosen.phi, chosen.theta)
    if twice:
        print(
            f"{twice} of {count} images repeat a direction of another; an odd number of thetas, such as "
            f"{SWEEP[1]} or 9, repeats none.",
            file=sys.stderr,
        )
    _, view = scripts.open_volume(chosen.volume, chosen.tf, chosen.array)
    temporary = make_folder(chosen.out.with_name(f".{chosen.out.name}-partial"))
    try:
        rows = draw(view, chosen, temporary)
        if chosen.black_and_white:
            rows = with_exact_alpha(rows, temporary)
        write_camera(view, temporary)
        write_table(temporary / "data.csv", rows)
        os.replace(temporary, chosen.out)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    print(f"{chosen.out}: {len(rows)} images of {chosen.size} x {chosen.size} pixels")


def draw(view, chosen, folder: Path) -> list[dict[str, str]]:
    """Let the extractors write their images at ParaView's current time; return their rows of the database."""
    from paraview import servermanager, simple

    from svv.errors import BadInput, Cancelled
    from svv.progress import shown
    from svv.pv import scripts

    sweep = (chosen.phi, chosen.theta, chosen.size)
    extractors = [set_up(view, *sweep)]
    for name in ("black", "white") if chosen.black_and_white else ():
        extractors.append(set_up(view, *sweep, name=name))
        extractors[-1].Writer.TransparentBackground = 0
        extractors[-1].Writer.OverrideColorPalette = f"{name.capitalize()}Background"
    images = repeated(chosen.phi, chosen.theta)[1] * len(extractors)
    # Not simple.SaveExtracts: it draws still data ten times, once for each frame of the default animation, and its
    # table needs pandas, which not every ParaView has.
    controller = servermanager.vtkSMExtractsController()
    controller.SetExtractsOutputDirectory(str(folder.resolve()))
    controller.SetTime(simple.GetTimeKeeper().Time)
    stopped = []
    with shown("Extracting") as progress:

        def tell(*_) -> None:
            try:
                progress(min(len(list(folder.glob("*.png"))) / images, 1.0), "")
            except Cancelled as cancelled:  # an exception does not get past VTK, which calls this after each image
                stopped.append(cancelled)
                for extractor in extractors:
                    extractor.Writer.ImageResolution = [1, 1]  # the rest of the sweep takes no time

        watch = view.SMProxy.AddObserver("EndEvent", tell)
        try:
            written = [controller.Extract(extractor.SMProxy) for extractor in extractors if not stopped]
        finally:
            view.SMProxy.RemoveObserver(watch)
            for extractor in extractors:
                simple.Delete(extractor)  # it holds the view, which must close before the program ends
    if stopped:
        raise stopped[0]
    every = scripts.rows_of(controller.GetSummaryTable())
    rows = [{name: value for name, value in row.items() if value} for row in every]
    if not all(written) or len(rows) != images:
        raise BadInput(f"ParaView wrote {len(rows)} of {images} images; its messages are above.")
    return rows


def with_exact_alpha(rows: list[dict[str, str]], folder: Path) -> list[dict[str, str]]:
    """Replace colour and alpha by those from the images on black and on white, which are deleted.

    Returns:
        The rows of the images that remain.
    """
    import numpy as np

    from svv.dvr.draw.casters import straight_alpha
    from svv.io.pictures.output import write_png
    from svv.render.pictures import read_png

    by_direction: dict[tuple[str, str], dict[str, Path]] = {}
    for row in rows:
        by_direction.setdefault((row["phi"], row["theta"]), {})[row["producer"]] = folder / row["FILE_png"]
    off, wrong = 0, 0.0
    for files in by_direction.values():
        black, white = (read_png(files[name])[..., :3].astype(np.float32) for name in ("black", "white"))
        exact, own = straight_alpha(black, white), read_png(files["views"])
        difference = np.abs(exact[..., 3].astype(int) - own[..., 3])
        off = max(off, int(difference.max()))
        wrong += float((difference > 1).mean()) / len(by_direction)
        write_png(files["views"], exact)
        files["black"].unlink()
        files["white"].unlink()
    print(f"ParaView's own alpha differed by up to {off}/255, by more than 1/255 in {wrong:.3%} of the pixels.")
    return [row for row in rows if row["producer"] == "views"]


def write_table(path: Path, rows: list[dict[str, str]]) -> None:
    """Write the table of a Cinema database: parameters first, columns with files last."""
    names = sorted({name for row in rows for name in row}, key=lambda name: (name.startswith("FILE"), name))
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, names, lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


if __name__ == "__main__":
    main()
