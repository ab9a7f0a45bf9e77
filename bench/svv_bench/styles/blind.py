"""Blind sheets: ways of painting side by side without their names, and the evaluation of a person's choices.

``write_sheets`` writes numbered sheets, with the style on the left and the ways in shuffled columns, and a key that
identifies them. A person writes down the best column of every sheet. ``open_key`` counts the choices and how often each
figure of similarity agrees with them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from svv.errors import BadInput, Progress, silent
from svv.io.files.atomic import check_writable, make_folder, write_json
from svv.io.files.keyed_results import digest
from svv.io.pictures.output import write_png
from svv.options.making import PREFIX
from svv.render.pictures import Picture, cropped, fitted, over_white, read_png, sheet
from svv.styles.gallery import open_style
from svv.styles.gallery.offered import GALLERY
from svv.train.lpips import load_lpips
from svv_bench.styles.likeness import judge_of, painted_figures
from svv_bench.styles.table import markdown

CHOICES = "choices.json"
"""Name of the template next to the sheets that the person fills in."""
ENLARGED = 3
"""Enlargement of crops."""
Z = 1.959964
"""Standard normal quantile of a two-sided 95 % interval."""
BEST_AT_1 = ("contrast", "chroma")
"""Figures that are ratios, best at 1; all others are distances."""


@dataclass(frozen=True)
class Case:
    """Pictures of the same name."""

    name: str
    style: str
    """A file or ``gallery:NAME``."""
    pictures: tuple[Path, ...]
    """One picture of each way."""


def find_cases(ways: Sequence[Path], styles: Path | None) -> list[Case]:
    """Find the pictures of all ways and the style of each.

    Args:
        ways: Folders of PNG files.
        styles: A JSON file {name: picture or ``gallery:NAME``}, or a folder of style pictures. From a folder, the style
            whose name occurs between hyphens in the picture's is used (``woodcut`` for ``ring-woodcut.png``), the
            longest one if there are several. None uses the gallery in the same way.

    Raises:
        BadInput: There are fewer than two folders, two have the same name, one is missing or empty, their pictures
            have different names, or a picture has no style.
    """
    if len(ways) < 2 or len({way.resolve().name for way in ways}) < len(ways):
        raise BadInput("Give at least two folders of pictures, with different names.")
    for way in ways:
        if not way.is_dir():
            raise BadInput(f"There is no folder of pictures at {way}.")
    names = [{path.stem for path in way.glob("*.png")} for way in ways]
    odd = sorted({name for some in names for name in names[0] ^ some})
    if odd:
        raise BadInput(f"The picture {odd[0]}.png is not in every folder: pictures must have the same names.")
    if not names[0]:
        raise BadInput(f"There are no PNG pictures in {ways[0]}.")
    known = _known_styles(styles)
    exact = styles is not None and styles.is_file()
    found = []
    for name in sorted(names[0]):
        fitting = [style for style in known if (style == name if exact else f"-{style}-" in f"-{name}-")]
        if not fitting:
            raise BadInput(f"No style is known for {name}.png: name it in a JSON file and give that to --styles.")
        found.append(Case(name, known[max(fitting, key=len)], tuple(way / f"{name}.png" for way in ways)))
    return found


def _known_styles(styles: Path | None) -> dict[str, str]:
    if styles is None:
        return {name: PREFIX + name for name in GALLERY}
    if styles.is_dir():
        return {path.stem: str(path) for path in sorted(styles.iterdir()) if path.is_file()}
    content = read_object(styles, "styles")
    if not all(isinstance(value, str) for value in content.values()):
        raise BadInput(f"{styles} must give a style picture or gallery:NAME for each picture's name.")
    return content


def write_sheets(
    ways: Sequence[Path], styles: Path | None, out: Path, key: Path, seed: int = 0, crops: int = 2,
    progress: Progress = silent,
) -> int:  # fmt: skip
    """Write ``001.png`` and so on, the template of the choices, and the key.

    The order of sheets and columns depends on the seed and the pictures' content. Sheets contain only pixels, all
    written alike; the names of ways and pictures are only in the key.

    Args:
        ways: Folders of PNG files with the same names and sizes, with alpha.
        styles: See :func:`find_cases`.
        out: Folder for the sheets; created if missing.
        key: JSON file for the key, outside ``out``.
        seed: Seed of the order.
        crops: Number of rows of enlarged crops under the whole pictures.
        progress: Called before each sheet.

    Returns:
        The number of sheets.

    Raises:
        BadInput: See :func:`find_cases`; or the key lies among the sheets, choices or a key exist already, or pictures
            cannot be read, are empty, or differ in size.
    """
    cases = find_cases(ways, styles)
    check_places(out, key, out / CHOICES)
    loaded = {case.name: _pictures(case) for case in cases}
    hashes = {case.name: [digest(p) for p in loaded[case.name]] for case in cases}
    random = np.random.default_rng([seed, int(digest(hashes)[:12], 16)])
    make_folder(out)
    check_writable(key)
    sheets = []
    for place, index in enumerate(random.permutation(len(cases))):
        case = cases[index]
        progress(place / len(cases), f"{place + 1} of {len(cases)}")
        columns = random.permutation(len(ways))
        _, style = open_style(case.style)
        pictures = [loaded[case.name][column] for column in columns]
        write_png(out / f"{place + 1:03d}.png", _sheet(pictures, style, crops, random))
        sheets.append({"name": case.name, "style": case.style, "columns": [int(c) for c in columns],
                       "content": hashes[case.name]})  # fmt: skip
    write_json(key, {"seed": seed, "ways": [str(way.resolve()) for way in ways], "sheets": sheets})
    write_json(out / CHOICES, {f"{number + 1:03d}": None for number in range(len(sheets))})
    progress(1.0, "")
    return len(sheets)


def check_places(out: Path, key: Path, template: Path) -> None:
    """Raise BadInput if the key would be among the sheets, or there is another trial."""
    if out.resolve() in key.resolve().parents:
        raise BadInput(f"The key must not be among the sheets: choose another place than {key} for it.")
    if template.exists() or key.exists():
        raise BadInput(f"{out} or {key} contains another trial: choose other places, or remove both first.")


def _pictures(case: Case) -> list[Picture]:
    """Read the RGBA levels of all ways."""
    found = []
    for path in case.pictures:
        try:
            found.append(read_png(path))
        except OSError as error:
            raise BadInput(f"Cannot read {path} as a picture ({error}): save it as PNG.") from error
    if len({picture.shape for picture in found}) > 1:
        raise BadInput(f"The pictures {case.name}.png differ in size: render all ways alike.")
    if not all(picture[..., 3].any() for picture in found):
        raise BadInput(f"A picture {case.name}.png shows nothing: every pixel is transparent.")
    return found


def _sheet(pictures: Sequence[Picture], style: NDArray[np.float32], crops: int, random: np.random.Generator) -> Picture:
    """Draw the style and the ways, first whole, then as enlarged crops; all crops of a row show the same place."""
    (shown,) = cropped([[over_white(picture) for picture in pictures]])
    height, width = shown[0].shape[:2]
    rows = [[fitted(style, width, height), *shown]]
    high, wide = height // ENLARGED, width // ENLARGED
    down, across = style.shape[:2]
    scale = max(max(pictures[0].shape[:2]) / max(down, across), high / down, wide / across)  # strokes as painted
    like = fitted(style, math.ceil(scale * across), math.ceil(scale * down))
    seen = np.argwhere(shown[0].min(axis=2) < 250)
    for _ in range(crops if min(high, wide) > 0 and len(seen) else 0):
        y, x = seen[random.integers(len(seen))]
        at = (min(max(0, y - high // 2), height - high), min(max(0, x - wide // 2), width - wide))
        there = [int(random.integers(max(1, n - m + 1))) for n, m in zip(like.shape[:2], (high, wide))]
        parts = [_part(like, there, (high, wide)), *(_part(picture, at, (high, wide)) for picture in shown)]
        rows.append([np.asarray(part.resize((width, height), Image.Resampling.BICUBIC)) for part in parts])
    return sheet(rows, ["style", *(str(column + 1) for column in range(len(pictures)))])


def _part(picture: Picture, at: Sequence[int], size: tuple[int, int]) -> Image.Image:
    (y, x), (height, width) = at, size
    return Image.fromarray(picture[y : y + height, x : x + width])


def read_choices(path: Path, sheets: int, columns: int) -> list[int]:
    """Return the chosen column of each sheet, counted from 0.

    Raises:
        BadInput: The file cannot be read, sheets have no choice, or a sheet or column does not exist.
    """
    content = read_object(path, "choices")
    names = [f"{number + 1:03d}" for number in range(sheets)]
    given = {f"{int(name):03d}" if name.isdecimal() else name: value for name, value in content.items()}
    unknown = sorted(set(given) - set(names))
    if unknown:
        raise BadInput(f"{path} names a sheet '{unknown[0]}' that does not exist: there are {sheets} sheets.")
    missing = [name for name in names if given.get(name) is None]
    if missing:
        raise BadInput(
            f"{len(missing)} of {sheets} sheets have no choice yet, the first is {missing[0]}: "
            f"write the number of the best column of each sheet into {path}."
        )
    for name in names:
        if type(given[name]) is not int or not 1 <= given[name] <= columns:
            raise BadInput(f"The choice for sheet {name} must be a column from 1 to {columns}, not {given[name]!r}.")
    return [given[name] - 1 for name in names]


def open_key(choices: Path, key: Path, progress: Progress = silent) -> dict[str, Any]:
    """Count the choices, and how often each figure agrees with them.

    Args:
        choices: JSON file, sheet number -> column, from 1.
        key: File from :func:`write_sheets`; the folders that it names must still contain the same pictures.
        progress: Called before each sheet.

    Returns:
        ``ways``: for each way, by its folder's name, the number of sheets for which it was ``chosen``, ``of`` how many,
        ``share`` and its 95 % interval ``low`` to ``high``. ``figures``: the same for each figure, as the number of
        pairs of the chosen picture and another one of its sheet for which the figure places the chosen one nearer to
        the style (ties are left out). ``sheets``: name, chosen way and all figures of each sheet.

    Raises:
        BadInput: See :func:`read_choices`; or the key is damaged, or the pictures are no longer those of the sheets.
    """
    content = read_object(key, "key")
    try:
        ways, entries = [Path(way) for way in content["ways"]], list(content["sheets"])
        cases = [Case(e["name"], e["style"], tuple(way / f"{e['name']}.png" for way in ways)) for e in entries]
        whose = [list(map(int, e["columns"])) for e in entries]
        hashes = [list(e["content"]) for e in entries]
    except (KeyError, TypeError, ValueError) as error:
        raise BadInput(f"{key} is not a key of blind sheets: give the file that was written with them.") from error
    chosen = [order[column] for order, column in zip(whose, read_choices(choices, len(cases), len(ways)))]
    network, rows = load_lpips(), []
    for number, (case, best) in enumerate(zip(cases, chosen)):
        progress(number / len(cases), f"{number + 1} of {len(cases)}")
        pictures = _pictures(case)
        if [digest(p) for p in pictures] != hashes[number]:
            raise BadInput(f"A picture {case.name}.png is no longer the one on the sheet: restore the original.")
        judge = judge_of(open_style(case.style)[1], max(pictures[0].shape[:2]), network)
        cover = np.min([p[..., 3] for p in pictures], axis=0) / np.float32(255)
        figures = [painted_figures(p[..., :3] / np.float32(255), cover, judge) for p in pictures]
        rows.append({"sheet": number + 1, "name": case.name, "chosen": ways[best].name,
                     "figures": {way.name: f for way, f in zip(ways, figures)}})  # fmt: skip
    progress(1.0, "")
    taken = [sum(row["chosen"] == way.name for row in rows) for way in ways]
    return {
        "ways": {way.name: share(count, len(rows), "chosen") for way, count in zip(ways, taken)},
        "figures": agreement(rows),
        "sheets": rows,
    }


def agreement(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """Return for each figure the share of pairs of a chosen and another picture in which the chosen one is nearer."""
    names = dict.fromkeys(name for row in rows for values in row["figures"].values() for name in values)
    result = {}
    for name in names:
        agreed = pairs = 0
        for row in rows:
            values = {way: _distance(name, f[name]) for way, f in row["figures"].items() if name in f}
            own = values.pop(row["chosen"], None)
            others = [value for value in values.values() if own is not None and value != own]
            agreed += sum(own < value for value in others if own is not None)
            pairs += len(others)
        result[name] = share(agreed, pairs, "agreed")
    return result


def _distance(name: str, value: float) -> float:
    return abs(float(np.log(max(value, 1e-6)))) if name in BEST_AT_1 else value


def share(count: int, of: int, what: str) -> dict[str, float]:
    """Return a count, the total, their quotient and its 95 % interval, which is 0 to 1 if the total is 0."""
    low, high = wilson(count, of)
    return {what: count, "of": of, "share": count / of if of else float("nan"), "low": low, "high": high}


def wilson(count: int, of: int) -> tuple[float, float]:
    """Return the 95 % interval of a proportion (Wilson 1927).

    (p + z^2 / 2n -+ z sqrt(p (1 - p) / n + z^2 / 4n^2)) / (1 + z^2 / n)
    """
    if of == 0:
        return 0.0, 1.0
    p, z2 = count / of, Z * Z / of
    middle, half = p + z2 / 2, Z * float(np.sqrt(p * (1 - p) / of + z2 / (4 * of)))
    return max(0.0, (middle - half) / (1 + z2)), min(1.0, (middle + half) / (1 + z2))


def report(found: Mapping[str, Any]) -> str:
    """Format both tables of :func:`open_key` as Markdown; the parts of ``lines`` are only in the JSON file."""
    tables = []
    for first, rows, column in (("way", found["ways"], "chosen"), ("figure", found["figures"], "agreed")):
        lines = [{first: name, column: f"{r[column]} of {r['of']}", "share": percent(r["share"]),
                  "95 % interval": f"{percent(r['low'])} to {percent(r['high'])}"}
                 for name, r in rows.items() if not name.startswith("lines:")]  # fmt: skip
        tables.append(markdown(lines, first, (column, "share", "95 % interval")))
    return "\n\n".join(tables) + "\n"


def percent(value: float) -> str:
    """Format a share; a dash where nothing was counted."""
    return "-" if np.isnan(value) else f"{100 * value:.0f} %"


def read_object(path: Path, what: str) -> dict[str, Any]:
    """Read a JSON object of ``what``; raises BadInput if there is none."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise BadInput(f"Cannot read the {what} from {path} ({error}): give the JSON file.") from error
    if not isinstance(content, dict):
        raise BadInput(f"{path} must be a JSON object of {what}.")
    return content
