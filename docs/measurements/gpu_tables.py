"""Print the tables of docs/measurements/gpu.md from the results of ``svv bench gpu``.

python docs/measurements/gpu_tables.py [results.jsonl]
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from svv_bench.gpu.page import as_markdown, tables

RESULTS = Path(__file__).with_name("gpu-h200.jsonl")
LATER = Path(__file__).with_name("gpu-h100.jsonl")


def printed(results: Path = RESULTS) -> str:
    """Return all tables of some results, as Markdown."""
    return as_markdown(tables([json.loads(line) for line in results.read_text(encoding="utf-8").splitlines()]))


if __name__ == "__main__":
    print(printed(Path(sys.argv[1]) if len(sys.argv) > 1 else RESULTS), end="")
