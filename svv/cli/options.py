"""Options that several commands of ``svv`` share, and the parsing of their text."""

from __future__ import annotations

import math
import string
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer

from svv.errors import BadInput

Out = Annotated[Path, typer.Option("--out", "-o", help="Where to write the result.")]
Json = Annotated[Path | None, typer.Option("--json", help="Also write the figures to this JSON file.")]
Seed = Annotated[int, typer.Option(help="The same seed gives the same result.")]
SceneFile = Annotated[Path, typer.Argument(metavar="SCENE.svv", help="A trained scene.")]


def examples(*lines: str) -> str:
    """Return example commands to copy, as shown below a command's help."""
    return "[bold]Examples[/bold]\n\n" + "\n\n".join(f"  {line}" for line in lines)


def parse_colour(text: str) -> tuple[float, float, float]:
    """Return '#rrggbb', 'white' or 'black' as sRGB in [0, 1]; raises BadInput for another form."""
    digits = {"white": "ffffff", "black": "000000"}.get(text.lower(), text.removeprefix("#"))
    if len(digits) != 6 or not set(digits) <= set(string.hexdigits):
        raise BadInput(f"'{text}' is not a colour; write it as '#rrggbb', for example '#ff8800'.")
    value = int(digits, 16)
    return (value >> 16) / 255, (value >> 8 & 255) / 255, (value & 255) / 255


def parse_size(text: str) -> tuple[int, int]:
    """Return '800' or '1280x720' as (width, height), up to 16384; raises BadInput for another form or size."""
    parts = text.lower().split("x")
    if len(parts) in (1, 2) and all(p.isascii() and p.isdigit() and 1 <= int(p) <= 16384 for p in parts):
        return int(parts[0]), int(parts[-1])
    raise BadInput(f"'{text}' is not a size; write 800 or 1280x720, with at most 16384 pixels per side.")


def parse_mapping(text: str) -> dict[int, int | str] | Literal["colour"]:
    """Return '0=0,2=sky' as {region: style or part}, or 'colour'; BadInput for another form, or a region twice."""
    if text.strip().lower() in ("colour", "color"):
        return "colour"
    advice = "region=style pairs, for example --map 0=0,1=1, parts of a picture by their names, 0=sky, or colour"
    return {k: int(v) if _is_number(v) else v.strip() for k, v in _pairs_in(text, advice, lambda _: True).items()}


def _is_number(text: str) -> bool:
    return text.strip().isascii() and text.strip().isdigit()


def parse_pairs(text: str, flag: str) -> dict[int, int]:
    """Return '0=0,2=1' as {region: region of a look}; raises BadInput as :func:`parse_mapping`."""
    pairs = _pairs_in(text, f"region=region pairs, for example {flag} 0=0,1=1", _is_number)
    return {region: int(other) for region, other in pairs.items()}


def _pairs_in(text: str, advice: str, fits: Callable[[str], bool]) -> dict[int, str]:
    """Return '0=a,1=b' as {0: 'a', 1: 'b'}, in which all values fit."""
    pairs = [part.partition("=") for part in text.split(",")]
    if not all(_is_number(k) and v.strip() and "=" not in v and fits(v) for k, _, v in pairs):
        raise BadInput(f"'{text}' is not a mapping; write {advice}.")
    mapping = {int(region): other for region, _, other in pairs}
    if len(mapping) < len(pairs):
        raise BadInput(f"'{text}' names a region twice.")
    return mapping


def parse_style_masks(texts: Sequence[str], styles: int) -> dict[int, Path]:
    """Return ['0=sky.png'] as {style: file}.

    Raises BadInput for another form, a style that does not exist, or one twice.
    """
    found: dict[int, Path] = {}
    for text in texts:
        number, sign, file = text.partition("=")
        if not (sign and file and _is_number(number)):
            raise BadInput(f"'{text}' does not name a style's mask; write style=file, such as --style-mask 0=mask.png.")
        style = int(number)
        if style >= styles:
            raise BadInput(f"There is no style {style} for --style-mask: the styles given are 0 to {styles - 1}.")
        if style in found:
            raise BadInput(f"Style {style} has two masks: give its picture twice, with one mask for each.")
        found[style] = Path(file)
    return found


def parse_names(texts: Sequence[str], example: str = "--name 0=bone") -> dict[int, str]:
    """Return ['0=bone', '1=soft tissue'] as {region: name}; BadInput for another form, or a region named twice."""
    found: dict[int, str] = {}
    for text in texts:
        number, sign, name = text.partition("=")
        if not (sign and _is_number(number)):
            raise BadInput(f"'{text}' does not name a region; write region=name, for example {example}.")
        if int(number) in found:
            raise BadInput(f"'{text}' names region {int(number)} a second time: give each region one name.")
        found[int(number)] = name
    return found


def parse_points(texts: Sequence[str], option: str) -> list[tuple[float, float]]:
    """Return ['120,40'] as [(120.0, 40.0)]; raises BadInput for another form."""
    points = []
    for text in texts:
        numbers = finite_numbers(text)
        if len(numbers) != 2:
            raise BadInput(f"'{text}' is not a point; write x,y in pixels, for example {option} 120,40.")
        points.append((numbers[0], numbers[1]))
    return points


def parse_choices(text: str, option: str, known: Sequence[str]) -> tuple[str, ...]:
    """Return the words of 'draft,fast', each once; raises BadInput if one is not in ``known``."""
    words = [part.strip() for part in text.split(",")]
    for word in words:
        if word not in known:
            raise BadInput(f"{option} has no '{word}'; choose from {', '.join(known)}, separated by commas.")
    return tuple(dict.fromkeys(words))


def parse_whole(text: str, option: str, least: int = 0) -> tuple[int, ...]:
    """Return '0,1,2' as whole numbers, each once; raises BadInput for another form, or a number below ``least``."""
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isascii() and part.isdigit() and int(part) >= least for part in parts):
        raise BadInput(f"{option} needs whole numbers of at least {least}, separated by commas, not '{text}'.")
    return tuple(dict.fromkeys(int(part) for part in parts))


def parse_light(text: str) -> dict[str, object]:
    """Return 'headlight', '40,20' or '1,0,0' as arguments of :meth:`svv.fields.scene.scene.Scene.with_light`.

    Two numbers are degrees to the right of the camera and above it; three are a direction in the world. Raises BadInput
    for another form.
    """
    if text == "headlight":
        return {}
    numbers = numbers_in(text)
    if len(numbers) == 2:
        return {"azimuth": numbers[0], "elevation": numbers[1]}
    if len(numbers) == 3:
        return {"direction": numbers}
    raise BadInput(
        f"--light needs 'headlight', two angles relative to the camera ('40,20': 40 degrees right, 20 up) or a "
        f"direction in the world ('1,0,0'), not '{text}'."
    )


def parse_stroke_light(text: str, option: str) -> tuple[float, ...]:
    """Return '-40,45', '-1,2,1' or 'own' as a direction in the world, of three numbers or none.

    Two numbers are degrees to the right of and above the front of the volume. Raises BadInput for another form.
    """
    from svv.core.colour.light import direction_of

    if text == "own":
        return ()
    numbers = numbers_in(text)
    if len(numbers) == 2 and abs(numbers[0]) <= 180.0 and abs(numbers[1]) <= 90.0:
        return direction_of(*numbers)
    if len(numbers) == 3:
        return numbers
    raise BadInput(
        f"{option} needs two angles as seen from the front ('-40,45': 40 degrees left, 45 up), a direction in the "
        f"world ('-1,2,1') or 'own', not '{text}': the light on strokes stays where it is when the camera moves."
    )


def parse_shadow_light(text: str, option: str) -> tuple[float, ...]:
    """Return '-35,40', '-1,2,1' or 'own' as two angles relative to the camera, a direction in the world, or nothing.

    Raises BadInput for another form.
    """
    if text == "own":
        return ()
    numbers = numbers_in(text)
    if len(numbers) in (2, 3):
        return numbers
    raise BadInput(
        f"{option} needs two angles relative to the camera ('-35,40': 35 degrees left, 40 up), a direction in the "
        f"world ('-1,2,1') or 'own', not '{text}'."
    )


def parse_stroke_palette(text: str) -> tuple[tuple[float, float, float], ...]:
    """Return the palette of a picture or of colours; raises BadInput as :func:`.stroke_palette.palette_named` does."""
    from svv.progress import shown
    from svv.styles.stroke_palette import palette_named

    with shown("Palette") as progress:
        return palette_named(text, progress)


def parse_limits(text: str, option: str) -> tuple[float | None, ...]:
    """Return '15,60,full' as seconds >= 1, each once, None for full, no limit; raises BadInput for another form."""
    limits: list[float | None] = []
    for part in (part.strip() for part in text.split(",")):
        try:
            limit = None if part == "full" else float(part)
        except ValueError:
            limit = math.nan
        if limit is not None and not 1.0 <= limit < math.inf:
            raise BadInput(f"{option} needs seconds (at least 1) or 'full', separated by commas, not '{text}'.")
        limits.append(limit)
    return tuple(dict.fromkeys(limits))


def parse_angles(text: str, option: str) -> tuple[float, float]:
    """Return '30,20', degrees right of the front and above it, in [-180, 180] and [-90, 90]; else raises BadInput."""
    (right, above), *_ = parse_points([text], option)
    if not (abs(right) <= 180.0 and abs(above) <= 90.0):
        raise BadInput(
            f"{option} needs degrees to the right, from -180 to 180, and above, from -90 to 90, not '{text}'."
        )
    return right, above


def parse_dims(text: str) -> tuple[int, int, int]:
    """Return '128,128,64' as three whole numbers above 0; raises BadInput for another form."""
    x, y, z = parse_numbers(text, "--dims")
    if not (x.is_integer() and y.is_integer() and z.is_integer()):
        raise BadInput(f"--dims needs three whole numbers, for example --dims 128,128,64, not '{text}'.")
    return int(x), int(y), int(z)


def parse_point(text: str, option: str) -> tuple[float, float, float]:
    """Return '1,-2,2.5' as three finite numbers; raises BadInput for another form."""
    numbers = finite_numbers(text)
    if len(numbers) != 3:
        raise BadInput(f"{option} needs three numbers, for example {option} 1,-2,2.5, not '{text}'.")
    return numbers[0], numbers[1], numbers[2]


def parse_place(text: str, option: str) -> tuple[float, ...]:
    """Return '120,40', a pixel, or '1,-2,2.5', a point, as finite numbers; raises BadInput for another form."""
    if len(numbers := finite_numbers(text)) in (2, 3):
        return numbers
    raise BadInput(
        f"{option} needs a pixel, for example {option} 120,40, or a point in the world, for example {option} 1,-2,2.5, "
        f"not '{text}'."
    )


def parse_numbers(text: str, option: str) -> tuple[float, float, float]:
    """Return '1,1,2.5' as three positive numbers; raises BadInput for another form."""
    numbers = finite_numbers(text)
    if len(numbers) != 3 or min(numbers) <= 0:
        raise BadInput(f"{option} needs three positive numbers, for example {option} 1,1,2.5, not '{text}'.")
    return numbers[0], numbers[1], numbers[2]


def finite_numbers(text: str) -> tuple[float, ...]:
    """Return numbers between commas; none if the text has another form or one is not finite."""
    numbers = numbers_in(text)
    return numbers if all(map(math.isfinite, numbers)) else ()


def numbers_in(text: str) -> tuple[float, ...]:
    """Return numbers between commas; none if the text has another form."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        return ()
