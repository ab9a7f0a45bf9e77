"""Paintings judged by tasks: sheets with questions whose answers are known, and the evaluation of answers.

``write_sheets`` writes a folder for each judge: sheets of one picture each, in shuffled order and without names. A
judge sees each scene in one way only (rendered, painted like this or like that), and of as many judges as there are
ways each sees it in another one (a Latin square). ``score`` counts right answers, corrects them for guessing, and
counts how often the figure of legibility agrees.
"""

from __future__ import annotations

import textwrap
from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from svv.core.colour.colour import WHITE
from svv.core.geometry.cameras import Camera
from svv.errors import BadInput, Progress, silent
from svv.fields.scene.scene import Scene
from svv.io.files.atomic import check_writable, make_folder, write_json
from svv.io.pictures.output import write_png
from svv.render.pictures import Picture, over_white
from svv_bench.legibility.figure import VIEW_SIZE, Yardstick
from svv_bench.legibility.scenes import LOOK_RESOLUTION, Mark, TaskScene, task_scene
from svv_bench.stability.measures import overlaps
from svv_bench.styles.blind import check_places, percent, read_object, share
from svv_bench.styles.table import markdown

ANSWERS, READ_ME = "answers.json", "README.txt"
"""Files beside the sheets: the template that a judge fills in, and what to do."""

DONT_KNOW = "?"
"""The answer of a judge who cannot tell; it is not right."""

INSTRUCTIONS = f"""Look at each picture (001.png, 002.png ...) and answer the questions below it from the picture alone.

Write one of the choices for every question into {ANSWERS}, as text, for example {{"001": {{"1": "4", "2": "B"}}}}.
If a picture does not tell, take the most likely choice; write "{DONT_KNOW}" only if you see nothing at all.
Do not look at any other file, and do not go back to a picture when you have seen the next one.

The pictures are renderings or paintings of bodies in translucent skins. Skins, balls and tubes keep their form,
whatever their colours are. Rings with a letter or a number are marks, which belong to no part; the middle of a ring
is the place that it marks. Where there are two views side by side, the right one shows the same bodies from another
side, with the same marks. A ball with a mark lies inside a skin if it lies inside the skin's outline in both views, and
outside it if it does not in one of them.
"""

OPAQUE, LEAST_OVERLAP = 0.5, 0.5
"""Opacity of parts by which a volume is recognized, and their least overlap with a region (intersection over union)."""

PARTS = ("legibility", "apart", "contrast", "order")
"""Figures whose agreement with the answers is reported."""


def scene_names(ways: Sequence[Path]) -> list[str]:
    """Return the names of the generated scenes in some folders.

    Args:
        ways: Folders of ``KIND-SEED.svv``, one for each way to show the scenes.

    Raises:
        BadInput: There are fewer than two folders, two have the same name, one is missing or empty, or they have
            different scenes.
    """
    if len(ways) < 2 or len({way.resolve().name for way in ways}) < len(ways):
        raise BadInput("Give at least two folders of scenes, with different names.")
    for way in ways:
        if not way.is_dir():
            raise BadInput(f"There is no folder of scenes at {way}.")
    names = [{path.stem for path in way.glob("*.svv")} for way in ways]
    odd = sorted({name for some in names for name in names[0] ^ some})
    if odd:
        raise BadInput(f"The scene {odd[0]}.svv is not in every folder: scenes must have the same names.")
    if not names[0]:
        raise BadInput(f"There are no scenes in {ways[0]}.")
    return sorted(names[0])


def assignment(scenes: int, ways: int, judge: int) -> list[int]:
    """Return in which way a judge, counted from 0, sees each scene: judge + scene modulo the number of ways.

    >>> [assignment(3, 3, judge) for judge in range(3)]
    [[0, 1, 2], [1, 2, 0], [2, 0, 1]]
    """
    return [(judge + scene) % ways for scene in range(scenes)]


def write_sheets(
    ways: Sequence[Path], out: Path, key: Path, judges: int | None = None, size: int = 400, seed: int = 0,
    progress: Progress = silent,
) -> tuple[int, int]:  # fmt: skip
    """Write a folder of sheets for each judge, and the key.

    Args:
        ways: Folders of scenes with the same names, trained on the volumes of :mod:`svv_bench.legibility.scenes`;
            each is shown by the last network that it has.
        out: Folder of ``judge-1``, ``judge-2`` and so on.
        key: File for the answers and which picture is whose; it must lie outside ``out``.
        judges: Their number; by default as many as there are ways.
        size: Width and height of each view in pixels.
        seed: Of the order of the sheets.
        progress: Called before each picture.

    Returns:
        The number of judges, and of the sheets of each.

    Raises:
        BadInput: See :func:`scene_names` and :func:`check_volume`; a name is none of a generated scene; or a file
            cannot be read or written.
    """
    names = scene_names(ways)
    judges = len(ways) if judges is None else judges
    check_places(out, key, out / "judge-1" / ANSWERS)
    check_writable(key)
    cases, sheets = [], []  # type: list[dict[str, Any]], list[list[Picture]]
    for place, name in enumerate(names):
        case, camera = task_scene(name)
        pictures, figures, yardstick = [], {}, None
        for number, way in enumerate(ways):
            progress((place + number / len(ways)) / len(names), f"{name}, {way.name}")
            scene = Scene.load(way / f"{name}.svv")
            if yardstick is None:
                yardstick = Yardstick(scene, [camera.resized(VIEW_SIZE, VIEW_SIZE)])
                check_volume(name, yardstick)
            figures[way.resolve().name] = yardstick.measure_scene(scene).to_json()
            views = [view.resized(size, size) for view in case.views(camera)]
            shots = [over_white(scene.render(view, background=WHITE).rgba) for view in views]
            pictures.append(_sheet(shots, case, views))
        questions = [{"what": q.what, "choices": list(q.choices), "answer": q.answer} for q in case.questions]
        cases.append({"name": name, "questions": questions, "figures": figures})
        sheets.append(pictures)
    random, shown = np.random.default_rng(seed), []
    for judge in range(judges):
        order, whose = random.permutation(len(names)), assignment(len(names), len(ways), judge)
        folder = out / f"judge-{judge + 1}"
        make_folder(folder)
        for number, index in enumerate(order):
            write_png(folder / f"{number + 1:03d}.png", sheets[index][whose[index]])
        (folder / READ_ME).write_text(INSTRUCTIONS, encoding="utf-8")
        asked = [len(cases[index]["questions"]) for index in order]
        blank = {f"{n + 1:03d}": {str(q + 1): None for q in range(count)} for n, count in enumerate(asked)}
        write_json(folder / ANSWERS, blank)
        shown.append([{"scene": int(index), "way": whose[index]} for index in order])
    write_json(key, {"seed": seed, "ways": [way.resolve().name for way in ways], "scenes": cases, "judges": shown})
    progress(1.0, "")
    return judges, len(names)


def check_volume(name: str, yardstick: Yardstick) -> None:
    """Raise BadInput if a scene does not show the volume of its name: the answers would be another picture's.

    Each opaque part has to cover about the same pixels as a region, in the views of the yardstick.
    """
    known = task_scene(name)[0].known
    truth = known.class_maps(known.volume(LOOK_RESOLUTION), yardstick.cameras)
    shown = np.stack([picture.region for picture in yardstick.pictures])
    overlap = overlaps(truth, shown, len(known.ranges), int(shown.max()) + 1).max(axis=1)
    if np.mean([found for found, part in zip(overlap, known.ranges) if part.opacity >= OPAQUE]) < LEAST_OVERLAP:
        raise BadInput(
            f"The scene {name}.svv shows another volume than {name}: train it on the one that svv bench volumes writes."
        )


def _sheet(shots: Sequence[Picture], case: TaskScene, views: Sequence[Camera]) -> Picture:
    """Draw the marks on pictures (h, w, 3) of some views, put them side by side, and the questions below them."""
    size = views[0].width
    letter, text = size // 24, max(12, size // 38)
    picture = np.concatenate([_marked(shot, case, view, letter) for shot, view in zip(shots, views)], axis=1)
    height, width = picture.shape[:2]
    lines = []
    for number, question in enumerate(case.questions):
        lines += textwrap.wrap(f"{number + 1}. {question.text}", int(width / (0.52 * text)), subsequent_indent="    ")
        lines.append(f"    Choices: {', '.join(question.choices)}")
    canvas = Image.new("RGB", (width, height + int(1.35 * text * (len(lines) + 1))), "white")
    canvas.paste(Image.fromarray(picture))
    draw = ImageDraw.Draw(canvas)
    for line, said in enumerate(lines):
        at = (0.5 * text, height + 0.5 * text + 1.35 * text * line)
        draw.text(at, said, fill="black", font=ImageFont.load_default(text))
    return np.asarray(canvas)


def _marked(shot: Picture, case: TaskScene, view: Camera, letter: int) -> Picture:
    """Draw the marks, with letters of a size in pixels, on the picture (h, w, 3) of a view."""
    canvas = Image.fromarray(shot)
    for name, mark in case.marks.items():
        _draw_mark(ImageDraw.Draw(canvas), name, mark, view, letter)
    return np.asarray(canvas)


def _draw_mark(draw: ImageDraw.ImageDraw, name: str, mark: Mark, camera: Camera, letter: int) -> None:
    """Draw a ring, black on white so that it is seen on everything, and its name beside it, away from the middle."""
    column, row, _ = (float(value) for value in camera.project(mark.at))
    radius, font = letter * 0.45, ImageFont.load_default(letter)
    for wider, width, ink in ((1.0, 5, "white"), (-0.5, 2, "black")):
        edge = radius + wider
        draw.ellipse((column - edge, row - edge, column + edge, row + edge), outline=ink, width=width)
    aside = np.array([column, row]) - 0.5 * camera.width
    aside *= 1.25 * letter / max(float(np.hypot(*aside)), 1.0)
    at = (column + aside[0], row + aside[1])
    draw.text(at, name, "black", font, anchor="mm", stroke_width=3, stroke_fill="white")


def read_answers(path: Path, questions: Sequence[Sequence[Mapping[str, Any]]]) -> list[list[str]]:
    """Return a judge's answers to the questions of each sheet.

    Args:
        path: JSON file, sheet number -> question number -> choice.
        questions: Those of each sheet, with their ``choices``.

    Raises:
        BadInput: The file cannot be read, a question has no answer, or a sheet, question or choice does not exist.
    """
    content = read_object(path, "answers")
    names = [f"{number + 1:03d}" for number in range(len(questions))]
    for name in content:
        if name not in names:
            raise BadInput(f"{path} names a sheet '{name}' that does not exist: sheets are 001 to {names[-1]}.")
    answers = []
    for name, asked in zip(names, questions, strict=True):
        given = content.get(name)
        numbers = [str(number + 1) for number in range(len(asked))]
        if not isinstance(given, dict) or not set(given) <= set(numbers):
            raise BadInput(f"{path} must give sheet {name} an object with the answers {', '.join(numbers)}.")
        found = []
        for number, question in zip(numbers, asked, strict=True):
            answer = str(given.get(number, "")).strip().upper()
            if given.get(number) is None or answer not in (*question["choices"], DONT_KNOW):
                raise BadInput(
                    f"Question {number} of sheet {name} needs one of {', '.join(question['choices'])} or {DONT_KNOW} "
                    f"in {path}, not {given.get(number)!r}."
                )
            found.append(answer)
        answers.append(found)
    return answers


def score(answers: Sequence[Path], key: Path) -> dict[str, Any]:
    """Count right answers in each way, and how often each part of the figure of legibility agrees with them.

    Args:
        answers: Files of judges, each in its folder ``judge-K``.
        key: File from :func:`write_sheets`.

    Returns:
        ``ways``: for each way, how many answers were ``right``, ``of`` how many, ``share`` and its 95 % interval
        ``low`` to ``high``, and mean ``legibility``; ``guessed`` is the share that guesses would have, and
        ``corrected`` the score corrected for guessing (:func:`corrected`).
        ``questions``: all but the legibility of each way for each kind of question. ``figures``: for each part of the
        figure, how often it is higher for the picture with the larger share of right answers, of all pairs of pictures
        of a scene that differ in both. ``sheets``: what each judge answered.

    Raises:
        BadInput: See :func:`read_answers`; a judge does not exist or is given twice; or the key is damaged.
    """
    content = read_object(key, "key")
    try:
        ways, cases, judges = list(content["ways"]), list(content["scenes"]), list(content["judges"])
        asked = [[[*cases[s["scene"]]["questions"]] for s in sheets] for sheets in judges]
        figures = {(n, way): dict(case["figures"][way]) for n, case in enumerate(cases) for way in ways}
        shown = [[(int(s["scene"]), str(ways[s["way"]])) for s in sheets] for sheets in judges]
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise BadInput(f"{key} is not a key of tasks: give the file that was written with the sheets.") from error
    rows: list[dict[str, Any]] = []
    for path, judge in zip(answers, _judges(answers, len(judges)), strict=True):
        given = read_answers(path, asked[judge])
        for number, ((case, way), questions, found) in enumerate(zip(shown[judge], asked[judge], given, strict=True)):
            rows += [
                {"judge": judge + 1, "sheet": number + 1, "scene": cases[case]["name"], "case": case, "way": way,
                 "what": q["what"], "answer": answer, "right": answer == q["answer"], "guess": 1 / len(q["choices"])}
                for q, answer in zip(questions, found, strict=True)
            ]  # fmt: skip
    table = {}
    for way in ways:
        own = [row for row in rows if row["way"] == way]
        seen = {row["case"] for row in own}
        table[way] = {
            **_counted(own),
            "legibility": float(np.mean([figures[n, way]["legibility"] for n in seen])) if seen else float("nan"),
        }  # fmt: skip
    kinds = dict.fromkeys(row["what"] for row in rows)
    of_kind = {k: {w: _counted([r for r in rows if r["what"] == k and r["way"] == w]) for w in ways} for k in kinds}
    return {"ways": table, "questions": of_kind, "figures": agreement(rows, figures), "sheets": rows}


def _judges(answers: Sequence[Path], count: int) -> list[int]:
    """Return which judge, from 0, each file is from, by its folder."""
    known = {f"judge-{number + 1}": number for number in range(count)}
    folders = [path.resolve().parent.name for path in answers]
    for path, folder in zip(answers, folders, strict=True):
        if folder not in known:
            raise BadInput(f"{path} is from no judge of this trial: leave it in its folder, judge-1 to judge-{count}.")
    if len(set(folders)) < len(folders):
        raise BadInput("The answers of a judge are given twice: give each file once.")
    return [known[folder] for folder in folders]


def _counted(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return how many answers were right, the share that guesses would have, and the score corrected for guessing."""
    guessed = float(np.mean([row["guess"] for row in rows])) if rows else float("nan")
    counted = share(sum(bool(row["right"]) for row in rows), len(rows), "right")
    return {**counted, "guessed": guessed, "corrected": corrected(rows)}


def corrected(rows: Sequence[Mapping[str, Any]]) -> float:
    """Return the score corrected for guessing: 1 if all is right, and 0 on average if all is guessed.

    A right answer counts 1, a wrong one of k choices -1 / (k - 1), and "?" nothing (formula scoring).

    Args:
        rows: For each question the ``answer``, whether it is ``right``, and ``guess``, which is 1 / k.

    >>> corrected([{"answer": "A", "right": True, "guess": 0.25}, {"answer": "B", "right": False, "guess": 0.25}])
    0.3333333333333333
    """
    points = [
        1.0 if row["right"] else 0.0 if row["answer"] == DONT_KNOW else -row["guess"] / (1.0 - row["guess"])
        for row in rows
    ]
    return float(np.mean(points)) if points else float("nan")


def agreement(
    rows: Sequence[Mapping[str, Any]], figures: Mapping[tuple[int, str], Mapping[str, float]]
) -> dict[str, dict[str, float]]:
    """Return for each part of the figure the share of pairs of pictures that it orders as the answers do.

    Args:
        rows: Answers, with ``case``, ``way`` and whether they are ``right``.
        figures: Those of each case's picture in each way.
    """
    rights: dict[tuple[int, str], list[bool]] = defaultdict(list)
    for row in rows:
        rights[row["case"], row["way"]].append(row["right"])
    result = {}
    for part in PARTS:
        agreed = pairs = 0
        for one, other in combinations(sorted(rights), 2):
            better = np.mean(rights[one]) - np.mean(rights[other])
            higher = figures[one][part] - figures[other][part]
            if one[0] == other[0] and better and higher:
                pairs += 1
                agreed += int(better * higher > 0)
        result[part] = share(agreed, pairs, "agreed")
    return result


def report(found: Mapping[str, Any]) -> str:
    """Format the tables of :func:`score` as Markdown."""
    ways, interval = found["ways"], "95 % interval"
    lines = [
        {"way": way, **_shown(r, "right"), "guessed": percent(r["guessed"]), "corrected": f"{r['corrected']:.2f}",
         "legibility": f"{r['legibility']:.2f}"}
        for way, r in ways.items()
    ]  # fmt: skip
    kinds = [
        {"question": what, **{way: _shown(r, "right")["right"] for way, r in each.items()},
         "guessed": percent(np.nanmean([r["guessed"] for r in each.values()]))}
        for what, each in found["questions"].items()
    ]  # fmt: skip
    parts = [{"figure": name, **_shown(r, "agreed")} for name, r in found["figures"].items()]
    tables = (
        markdown(lines, "way", ("right", "share", interval, "guessed", "corrected", "legibility")),
        markdown(kinds, "question", (*ways, "guessed")),
        markdown(parts, "figure", ("agreed", "share", interval)),
    )
    return "\n\n".join(tables) + "\n"


def _shown(counted: Mapping[str, Any], what: str) -> dict[str, str]:
    """Format the result of :func:`svv_bench.styles.blind.share`."""
    return {
        what: f"{counted[what]} of {counted['of']}", "share": percent(counted["share"]),
        "95 % interval": f"{percent(counted['low'])} to {percent(counted['high'])}",
    }  # fmt: skip
