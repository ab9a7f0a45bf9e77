"""Paint one scene in many styles: write a stylized scene and a picture for each, and a contact sheet of them all.

Run it with `svv pvpython`. After Ctrl-C, the same command resumes; finished paintings are not painted again.
"""

from pathlib import Path

import numpy as np

from svv.errors import BadInput
from svv.options.arguments import add_arguments, options_of
from svv.options.making import PaintOptions
from svv.pv import scripts

EXAMPLES = (
    "svv pvpython batch_styles.py scene.svv paintings/*.jpg --out gallery",
    "svv pvpython batch_styles.py scene.svv paintings --keep 1 --preset balanced --out gallery",
    "svv pvpython batch_styles.py scene.svv a.png b.png --map 0=0 --size 1200 --out gallery",
)
SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")
PAIRS = 2


def main() -> None:
    """Read the arguments and paint."""
    parser = scripts.parser(__doc__, *EXAMPLES)
    parser.add_argument("scene", type=Path, help="a trained scene (.svv)")
    parser.add_argument("styles", type=Path, nargs="+", help="pictures, or folders of pictures")
    parser.add_argument("--out", "-o", type=Path, required=True, help="folder for the results")
    parser.add_argument("--map", help="regions to paint, as pairs such as 0=0,2=0; by default all")
    parser.add_argument("--keep", type=int, nargs="+", default=[], metavar="K", help="regions to leave unpainted")
    add_arguments(parser, PaintOptions(preset="fast"), {"preset": "--preset", "seed": "--seed"})
    parser.add_argument("--size", type=int, default=400, help="width and height of the pictures, in pixels (400)")
    parser.add_argument("--frame", type=int, default=76, help="the orbit's view that the pictures show, 0 to 180 (76)")
    chosen = parser.parse_args()
    scripts.run(lambda: paint(chosen), __file__)


def paint(chosen) -> None:
    """Paint one style after another; each is a stage, which is not repeated once it is finished."""
    from svv.cli.options import parse_mapping
    from svv.fields.scene.scene import Scene
    from svv.io.pictures.output import write_png
    from svv.io.pictures.style_picture import read_style
    from svv.io.scene_file import checkpoint_of
    from svv.job.stages import Stages, fingerprint
    from svv.progress import shown
    from svv.render.frames import orbit
    from svv.render.pictures import fitted, over_white, read_png, sheet
    from svv.train.paint.ink import StyleInput
    from svv.train.pipeline import stylize_scene

    if not 0 <= chosen.frame <= 180:
        raise BadInput(f"The orbit has the frames 0 to 180, not {chosen.frame}.")
    files = pictures(chosen.styles)
    read = [read_style(file) for file in files]  # report unreadable files before minutes of work
    mapping = None if chosen.map is None else parse_mapping(chosen.map)
    options = options_of(PaintOptions, chosen, mapping=mapping, keep=tuple(chosen.keep))
    scene = Scene.load(chosen.scene)
    camera = orbit(scene, 181, chosen.size, chosen.size)[chosen.frame]
    stages = Stages(chosen.out, shown)
    write_png(chosen.out / "unpainted.png", scene.render(camera).rgba)
    cells = []
    for file, style in zip(files, read, strict=True):
        path, picture = (chosen.out / f"{file.stem}{suffix}" for suffix in (".svv", ".png"))
        checkpoint = checkpoint_of(path)

        def work(progress, file=file, style=style, path=path, picture=picture, checkpoint=checkpoint) -> None:
            styled, _ = stylize_scene(scene, [StyleInput(style, file.stem)], options, progress, checkpoint)
            styled.save(path)
            write_png(picture, styled.render(camera).rgba)
            checkpoint.unlink(missing_ok=True)

        settings = {
            "scene": fingerprint(chosen.scene), "style": fingerprint(file), "map": chosen.map, "keep": chosen.keep,
            "preset": chosen.preset, "seed": chosen.seed, "size": chosen.size, "frame": chosen.frame,
        }  # fmt: skip
        stages.do(file.stem, f"Painting {file.stem}", settings, [path, picture], work)
        cells += [fitted(style, chosen.size), over_white(read_png(picture))]
    if len(cells) > 2 * PAIRS:
        cells += [np.full_like(cells[0], 255)] * (-len(cells) % (2 * PAIRS))
    rows = [cells[first : first + 2 * PAIRS] for first in range(0, len(cells), 2 * PAIRS)]
    write_png(chosen.out / "contact.png", sheet(rows, ["style", "painted"] * len(rows[0][::2])))
    print(chosen.out / "contact.png")


def pictures(paths: list[Path]) -> list[Path]:
    """Return the pictures among files and folders; raise BadInput if a folder has none or two have the same name."""
    found: list[Path] = []
    for path in paths:
        if path.is_dir():
            inside = sorted(file for file in path.iterdir() if file.suffix.lower() in SUFFIXES)
            if not inside:
                raise BadInput(f"The folder {path} contains no pictures ({', '.join(SUFFIXES)}): name another.")
            found += inside
        else:
            found.append(path)
    names = [path.stem for path in found]
    for name in names:
        if names.count(name) > 1:
            raise BadInput(f"Two pictures have the name {name}: rename one, because the results are named after them.")
    return found


if __name__ == "__main__":
    main()
