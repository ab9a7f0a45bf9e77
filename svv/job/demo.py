"""The demo: the whole job on a generated volume and generated style pictures."""

from __future__ import annotations

from pathlib import Path

from svv.errors import BadInput, Progress, silent
from svv.io.files.atomic import atomic_path, write_json
from svv.io.pictures.output import write_png
from svv.job.run import check, run_job
from svv.job.source import VolumeSource
from svv.job.stages import Show, Stages, unseen
from svv.job.steps import JobSettings

STYLES = ("oil", "impasto", "watercolour")
"""Gallery pictures for the sheet, the vortex and the shell (:data:`svv.styles.gallery.GALLERY`), most visible first."""


def run_demo(out: Path, settings: JobSettings, resolution: int = 128, show: Show = unseen) -> Path:
    """Generate the input, then do the whole job, or whatever part of it is not done yet; return its page.

    ``out`` is created if missing; the volume has ``resolution`` voxels along each side. Raises BadInput if the folder
    cannot be written to, or a setting is out of range, and Cancelled if the progress that ``show`` gives stopped the
    demo; the same call resumes it.
    """
    check(settings)
    stages = Stages(out, show)
    volume, tf = out / "volume.vti", out / "tf.json"
    styles = [out / f"{name}.png" for name in STYLES]
    stages.do(
        "input",
        "Volume and styles",
        {"resolution": resolution, "styles": STYLES},
        [volume, tf, *styles],
        lambda progress: generate(out, resolution, progress),
    )
    return run_job(VolumeSource(volume, tf), styles, out, settings, show, stages)


def generate(out: Path, resolution: int = 128, progress: Progress = silent) -> None:
    """Write the demo's volume (``volume.vti``), its transfer function (``tf.json``) and its style pictures."""
    from svv.dvr.demo_volume import demo_transfer_function, demo_volume
    from svv.styles.gallery import gallery_picture

    progress(0.0, "volume")
    write_volume(out / "volume.vti", demo_volume(resolution))
    write_json(out / "tf.json", [demo_transfer_function().to_dict()])  # a list, as ParaView exports presets
    for index, name in enumerate(STYLES):
        progress((index + 1) / (len(STYLES) + 1), name)
        write_png(out / f"{name}.png", gallery_picture(name))
    progress(1.0, "")


def write_volume(path: Path, image: object) -> None:
    """Write VTK image data as ``.vti``; raises BadInput if it cannot be written."""
    from vtkmodules.vtkIOXML import vtkXMLImageDataWriter

    with atomic_path(path) as temporary:
        writer = vtkXMLImageDataWriter()
        writer.SetDataModeToBinary()  # appended data ParaView 5.11 cannot read beside an updated expat
        writer.SetFileName(str(temporary))
        writer.SetInputData(image)
        if not writer.Write():
            raise BadInput(f"Cannot write {path}: VTK's writer stopped; is the disk full?")
