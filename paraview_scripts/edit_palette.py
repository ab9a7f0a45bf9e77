"""Edit colours, opacities and lighting of a scene's regions with a pipeline of StyleRF filters, without any training.

Run it with `svv pvpython`. Without an edit it lists the regions.
"""

from pathlib import Path

from svv.cli.options import parse_colour
from svv.errors import BadInput
from svv.pv import scripts

EXAMPLES = (
    "svv pvpython edit_palette.py scene.svv",
    "svv pvpython edit_palette.py scene.svv --colour 0=#d02020 --opacity 1=0.3 --out red.svv --picture red.png",
    "svv pvpython edit_palette.py scene.svv --lighting 0=1.5 1=0 --state session.pvsm",
    "svv pvpython edit_palette.py scene.svv --isolate 0,2 --picture part.png",
)

SHOWN = ("image", "numbered regions", "regions in their colours")


def main() -> None:
    """Read the arguments and edit."""
    parser = scripts.parser(__doc__, *EXAMPLES)
    parser.add_argument("scene", type=Path, help="a trained scene (.svv)")
    parser.add_argument("--colour", nargs="+", default=[], metavar="K=#rrggbb", help="a region's new colour")
    parser.add_argument("--opacity", nargs="+", default=[], metavar="K=F", help="factor on a region's opacity; 0 hides")
    parser.add_argument("--lighting", nargs="+", default=[], metavar="K=F", help="factor on a region's lighting")
    parser.add_argument("--hide", type=int, nargs="+", default=[], metavar="K", help="regions to hide")
    parser.add_argument("--isolate", default="", metavar="K,...", help="the only regions to show")
    parser.add_argument("--show", default="image", choices=SHOWN, help="what the picture shows")
    parser.add_argument("--out", "-o", type=Path, help="file for the edited scene")
    parser.add_argument("--picture", type=Path, help="file for a picture of it (.png or .vti)")
    parser.add_argument("--size", type=int, default=800, help="width and height of the picture, in pixels (800)")
    parser.add_argument("--state", type=Path, help="file for the pipeline, for ParaView's File > Load State")
    chosen = parser.parse_args()
    scripts.run(lambda: edit(chosen), __file__)


def edit(chosen) -> None:
    """Build the pipeline scene - edit - image, and write the requested files."""
    from paraview import simple

    from svv.io.files.atomic import check_writable

    for path in (chosen.out, chosen.picture, chosen.state):
        if path is not None:
            check_writable(path)
    if not chosen.scene.is_file():
        raise BadInput(f"There is no scene {chosen.scene}; check the path.")
    reader = simple.OpenDataFile(str(chosen.scene.resolve()))
    edited = simple.StyleRFEdit(Input=reader, Isolate=chosen.isolate)
    regions = scripts.table_of(reader)
    for region, text in pairs(chosen.colour, len(regions)):
        setattr(edited, f"Region{region}Recolour", 1)
        setattr(edited, f"Region{region}Colour", parse_colour(text))
    for name, texts in (("Opacity", chosen.opacity), ("Lighting", chosen.lighting)):
        for region, text in pairs(texts, len(regions)):
            setattr(edited, f"Region{region}{name}", factor(text))
    for region in chosen.hide:
        if not 0 <= region < len(regions):
            raise BadInput(f"There is no region {region}; the scene has {len(regions)}, counted from 0.")
        setattr(edited, f"Region{region}Hide", 1)
    for row in scripts.table_of(edited):
        print(", ".join(f"{name} {value}" for name, value in row.items()))
    # This frame of the orbit looks from the front, slightly from above.
    image = simple.StyleRFRender(Input=edited, ImageSize=[chosen.size] * 2, Show=chosen.show, Frame=76)
    if chosen.picture is not None:
        scripts.update(image)
        simple.SaveData(str(chosen.picture), proxy=image)
    if chosen.out is not None:
        simple.SaveData(str(chosen.out), proxy=edited)
    if chosen.state is not None:
        simple.SaveState(str(chosen.state))


def pairs(texts: list[str], count: int) -> list[tuple[int, str]]:
    """Parse ['0=a', '2=b'] as [(0, 'a'), (2, 'b')]; raise BadInput for other text and for missing regions."""
    found = []
    for text in texts:
        number, _, value = text.partition("=")
        if not (number.isdecimal() and value):
            raise BadInput(f"'{text}' is not an edit: write region=value, for example 0=0.5.")
        if int(number) >= count:
            raise BadInput(f"There is no region {number}; the scene has {count}, counted from 0.")
        found.append((int(number), value))
    return found


def factor(text: str) -> float:
    """Parse a number that is at least 0; raise BadInput for anything else."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value < float("inf"):
        raise BadInput(f"A factor must be a number of at least 0, not '{text}'.")
    return value


if __name__ == "__main__":
    main()
