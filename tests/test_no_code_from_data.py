"""Nothing from data is code: no pickle, no evaluation and no shell in the sources, and names are escaped."""

from __future__ import annotations

import ast
import re
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest
from PIL import Image

from svv.errors import BadInput
from svv.io.files import fetch
from svv.job.page import Page, Picture, Table, write_page

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted(
    path for folder in ("svv", "bench", "plugin", "paraview_scripts") for path in (ROOT / folder).rglob("*.py")
)

PICKLES = {
    "svv/dvr/parallel/ranks.py": "between processes of one run, which trust each other",
    "svv/train/run/ranks.py": "between processes of one run, which trust each other",
    "svv/styles/weight_files.py": "an unpickler that knows nothing but arrays, of files with a pinned hash",
}
"""Modules that may import pickle, and for what; none is given a user's file."""

MODULES = {
    "pickle",
    "cPickle",
    "_pickle",
    "dill",
    "cloudpickle",
    "joblib",
    "marshal",
    "shelve",
    "yaml",
    "code",
    "codeop",
}
NAMES = {"eval", "exec", "compile", "__import__", "execfile"}
CALLS = {
    "os.system", "os.popen", "subprocess.getoutput", "subprocess.getstatusoutput", "torch.hub.load", "runpy.run_path",
    "runpy.run_module", "pandas.read_pickle", "torch.package", "numpy.loads",
}  # fmt: skip


def dotted(node: ast.expr) -> str:
    """The name of what is called: ``os.system``."""
    if isinstance(node, ast.Attribute):
        return f"{dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else "?"


def offences(source: str) -> Iterator[str]:
    """What in a source could run code that data contains."""
    for node in ast.walk(ast.parse(source)):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        yield from (f"imports {name}" for name in names if name.split(".")[0] in MODULES)
        if not isinstance(node, ast.Call):
            continue
        called, given = dotted(node.func), {k.arg: k.value for k in node.keywords}
        if called in NAMES or called in CALLS:
            yield f"calls {called}"
        shell = given.get("shell")
        if shell is not None and not (isinstance(shell, ast.Constant) and shell.value is False):
            yield f"{called} with a shell"
        allowed = given.get("allow_pickle")
        if allowed is not None and not (isinstance(allowed, ast.Constant) and allowed.value is False):
            yield f"{called} with pickles"
        weights = given.get("weights_only")
        if called == "torch.load" and not (isinstance(weights, ast.Constant) and weights.value is True):
            yield "torch.load of more than weights"


def test_no_source_runs_what_data_contains() -> None:
    found = {path.relative_to(ROOT).as_posix(): set(offences(path.read_text("utf-8"))) for path in SOURCES}
    assert {name: what for name, what in found.items() if what} == {name: {"imports pickle"} for name in PICKLES}


@pytest.mark.parametrize(
    "source",
    [
        "import pickle", "from marshal import loads", "import yaml", "eval(a)", "exec(a)", "__import__(a)",
        "import os\nos.system(a)", "subprocess.run(a, shell=True)", "subprocess.run(a, shell=b)", "torch.load(a)",
        "torch.load(a, weights_only=False)", "np.load(a, allow_pickle=True)", "np.load(a, allow_pickle=b)",
        "torch.hub.load(a)", "compile(a, b, c)",
    ],
)  # fmt: skip
def test_an_offence_is_found(source: str) -> None:
    assert list(offences(source))


def test_what_is_harmless_is_no_offence() -> None:
    source = "network.eval()\nre.compile(a)\ntorch.load(a, weights_only=True)\nnp.load(a, allow_pickle=False)"
    assert not list(offences(source))


BAD = "<script>alert(1)</script>\"'&<svg onload=alert(1)>"


def test_the_page_of_a_job_escapes_every_name(tmp_path: Path) -> None:
    file, movie = tmp_path / "a<b>\"'.png", tmp_path / "m.mp4"
    Image.new("RGB", (4, 4)).save(file)
    movie.write_bytes(b"movie")
    table = Table(BAD, BAD, (BAD, BAD), [[BAD, BAD]], swatch=(1,))
    page = Page(BAD, BAD, [(BAD, BAD)], movie, [Picture(BAD, BAD, file), table], [(BAD, BAD)], (file, BAD))
    write_page(tmp_path / "page.html", page)
    text = (tmp_path / "page.html").read_text()
    assert "<script" not in text and "<svg" not in text and "onload" in text
    assert not re.search(r'"[^"<>]*<b>', text)


def test_a_scenes_page_keeps_names_out_of_markup() -> None:
    from svv.render.web.page import _page

    def page(name: str) -> str:
        paintings = [{"name": name, "styles": [name]}]
        header = {"regions": [{"values": name}], "paintings": paintings, "layers": [{}], "file": name}
        return _page(header, "", {"front": "data:,", "movie": "data:,"}, name, name).decode()

    assert page(BAD).count("<script") == page("a").count("<script")
    assert page(BAD).count("<svg") == page("a").count("<svg") and page(BAD).count("alert(1)") > 3


def test_the_viewers_program_writes_text_and_no_markup() -> None:
    forbidden = r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function|srcdoc"
    programs = sorted((ROOT / "svv/render/web/viewer").glob("*.js"))
    found = {path.name: set(re.findall(forbidden, path.read_text("utf-8"))) for path in programs}
    assert programs
    assert {name: what for name, what in found.items() if what - ({"srcdoc"} if name == "notebook.js" else set())} == {}


@pytest.mark.parametrize(
    "url", ["http://example.org/a", "ftp://example.org/a", "file://example.org/a", "http://localhost.a/b"]
)
def test_downloads_are_encrypted(tmp_path: Path, url: str) -> None:
    with pytest.raises(BadInput, match="not encrypted"):
        fetch.download(url, tmp_path, "0" * 64, 10)
    assert list(tmp_path.iterdir()) == []


class Elsewhere(BaseHTTPRequestHandler):
    """Sends everyone to an address that is not encrypted."""

    def do_GET(self) -> None:
        self.send_response(302)
        self.send_header("Location", "http://example.org/a")
        self.end_headers()

    def log_message(self, format: str, *arguments: object) -> None:
        """Keep quiet."""


def test_downloads_are_not_sent_elsewhere(tmp_path: Path) -> None:
    with HTTPServer(("127.0.0.1", 0), Elsewhere) as server:
        threading.Thread(target=server.handle_request, daemon=True).start()
        with pytest.raises(BadInput, match="not encrypted"):
            fetch.download(f"http://127.0.0.1:{server.server_address[1]}/a", tmp_path, "0" * 64, 10)
    assert list(tmp_path.iterdir()) == []


def test_every_address_of_a_download_has_a_pinned_hash() -> None:
    from svv.styles import weight_files as files

    for name in ("SDIST_SHA256", "VGG16_SHA256"):
        assert re.fullmatch(r"[0-9a-f]{64}", getattr(files, name))
    assert files.VGG16_URL.startswith("https://")
    addresses = {
        path.name for path in SOURCES if re.search(r"urlopen|build_opener|requests\.", path.read_text("utf-8"))
    }
    assert addresses == {"fetch.py", "torch_build.py"}  # the second only asks whether an index answers


def test_every_pinned_version_is_exact() -> None:
    """Audit them with: pip-audit -r constraints.txt"""
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pins = [line for line in lines if line and not line.startswith("#")]
    form = r'[A-Za-z0-9_.-]+==[0-9]+(\.[0-9]+)*(\.post[0-9]+)?((a|b|rc)[0-9]+)?(; python_version (<|>=) "3\.[0-9]+")?'
    assert pins and [line for line in pins if not re.fullmatch(form, line)] == []
    for number in ("3.10", "3.11"):  # one version of each package for each Python
        fits = [line for line in pins if _holds(line, number)]
        names = [re.sub(r"[-_.]+", "-", line.split("==")[0]).lower() for line in fits]
        assert len(names) == len(set(names))


def _holds(line: str, python: str) -> bool:
    marker = re.search(r'(<|>=) "3\.([0-9]+)"', line)
    minor = int(python.split(".")[1])
    return marker is None or (minor < int(marker[2])) == (marker[1] == "<")
