"""Stability: every case with every preset and seed, measured against a known truth.

Each run has a file ``runs/CASE-PRESET-SEED.json``, which is written when the run is finished. It is not repeated unless
something that it depends on changes. A run that crashes is also a result: its error is in the file.
"""

from __future__ import annotations

import fnmatch
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from svv.errors import BadInput, Cancelled, Progress, part, silent
from svv.io.files.atomic import make_folder, to_json, write_json
from svv.io.files.keyed_results import read_record
from svv.measure import measured
from svv.train.run.config import Preset, preset
from svv_bench.keys import key_of_measure
from svv_bench.stability.cases import CASES, USUAL, Bench, BenchSettings

Record = dict[str, Any]
"""Record of a run: ``case``, ``preset``, ``seed``, ``settings``, ``changed`` (the preset's settings), ``seconds``,
``peak_rss_bytes`` and ``measures`` (see :data:`svv_bench.stability.cases.Measures`, or ``crash``: the error)."""


@dataclass(frozen=True)
class Matrix:
    """The runs to be made: every combination of cases, presets and seeds."""

    cases: Sequence[str] = USUAL
    """Names, or patterns of names such as ``regions-*``."""
    presets: Sequence[str] = ("draft", "paper")
    seeds: int = 5
    """Number of seeds, which are 0 to ``seeds`` - 1."""

    def __post_init__(self) -> None:
        for name in self.cases:
            if not fnmatch.filter(CASES, name):
                raise BadInput(f"There is no case '{name}'; choose from {', '.join(CASES)}.")
        for name in self.presets:
            preset(name)
        if self.seeds < 1:
            raise BadInput(f"At least one seed is needed, not {self.seeds}.")
        if not self.runs:
            raise BadInput("None of these cases applies to any of these presets: add a case or a preset.")

    @property
    def runs(self) -> list[tuple[str, str, int]]:
        """Case, preset and seed of each run, seed by seed: interrupted work then covers every case."""
        named = {name for pattern in self.cases for name in fnmatch.filter(CASES, pattern)}
        cases = [name for name in CASES if name in named]  # in the order in which they share a training
        return [
            (case, name, seed)
            for seed in range(self.seeds)
            for name in self.presets
            for case in cases
            if CASES[case].concerns(preset(name))
        ]


def run_stability(out: Path, matrix: Matrix, settings: BenchSettings, progress: Progress = silent) -> list[Record]:
    """Do all runs that are not finished yet.

    Args:
        out: Folder of the results.
        matrix: The runs to be made.
        settings: Settings that all runs share.
        progress: Called several times per second; the work stops if it raises, and the same call resumes it after the
            last finished run.

    Returns:
        The records of all runs in ``matrix``.

    Raises:
        BadInput: The folder cannot be written to.
    """
    runs = make_folder(out / "runs")
    bench = Bench(settings)
    found = {run: read_record(_path(runs, *run), _key(*run, settings)) for run in matrix.runs}
    left = [run for run, record in found.items() if record is None]
    for number, run in enumerate(left):
        case, name, seed = run
        label = f"{CASES[case].title}, {name}, seed {seed}"
        each = part(progress, number / len(left), (number + 1) / len(left))
        each(0.0, label)
        record = {**_run(bench, case, preset(name), seed, _labelled(each, label)), "key": _key(*run, settings)}
        write_json(_path(runs, *run), record)
        found[run] = json.loads(to_json(record))  # as read from the file: plain values, None for infinities and NaN
    progress(1.0, f"{len(left)} runs")
    return [record for record in found.values() if record is not None]


def _run(bench: Bench, case: str, chosen: Preset, seed: int, progress: Progress) -> Record:
    with measured() as cost:
        try:
            measures = CASES[case].measure(bench, CASES[case], chosen, seed, progress)
        except (Cancelled, OSError):
            raise
        except Exception as error:  # crashes are results; the record contains the error
            measures = {"crash": f"{type(error).__name__}: {error}"}
    return {
        "case": case,
        "preset": chosen.name,
        "seed": seed,
        "settings": asdict(bench.settings),
        "changed": _changes(case, chosen),
        "seconds": round(cost.seconds, 2),
        "peak_rss_bytes": cost.peak_rss_bytes,
        "measures": measures,
    }


def _changes(case: str, chosen: Preset) -> dict[str, Any]:
    """Return the settings in which a case differs from the preset: stage -> setting -> value."""
    before, after = asdict(chosen), asdict(CASES[case].change(chosen))
    stages = [k for k in before if isinstance(before[k], dict)]
    changes = {s: {k: v for k, v in after[s].items() if v != before[s][k]} for s in stages}
    return {stage: values for stage, values in changes.items() if values}


def _key(case: str, name: str, seed: int, settings: BenchSettings) -> str:
    """Return the key of everything that a run depends on."""
    known = CASES[case]
    return key_of_measure(
        [case, known.scene, known.views, known.views_only], asdict(known.change(preset(name))), seed, asdict(settings)
    )


def _path(runs: Path, case: str, name: str, seed: int) -> Path:
    return runs / f"{case}-{name}-{seed}.json"


def _labelled(progress: Progress, label: str) -> Progress:
    return lambda fraction, text: progress(fraction, f"{label}: {text}")
