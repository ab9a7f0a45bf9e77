"""The documentation: its examples run as written, its links resolve, and its reference pages match the code."""

from __future__ import annotations

import importlib
import re
import runpy
import shlex
import shutil
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import pytest

import svv
from svv.train.run.config import PRESETS, ReconstructSettings, StylizeSettings
from svv.train.splats import fit, starting
from tests.doc_blocks import blocks, commands, fill, run

DOCS = Path(__file__).resolve().parents[1] / "docs"
PYTHON_TUTORIAL = DOCS / "tutorials" / "python.md"

GUIDES = sorted([*(DOCS / "tutorials").glob("*.md"), *(DOCS / "how-to").glob("*.md"), DOCS.parent / "README.md"])
"""Pages whose blocks are run."""

LONG = {"blender", "cinema", "figures", "images", "masks", "notebook", "python", "pyvista", "share", "splats", "volume"}
"""Those of them that take longest."""

NOT_RUN = {
    "needs ParaView": 11, "needs a GPU": 1, "takes minutes": 9, "installs": 3, "downloads": 1, "removes": 1,
    "needs rattler-build": 1, "removes the kernels of this checkout": 1,
}  # fmt: skip
"""Why blocks of these pages are only compiled or left alone, and how many there are."""

SHORT = replace(
    PRESETS["draft"], reconstruct=ReconstructSettings(iterations=150, rays=1024, cells=32),
    recolour=replace(PRESETS["draft"].recolour, iterations=100, rays=1024),
    stylize=StylizeSettings(style_views=6, style_size=64),
)  # fmt: skip


PAGES = sorted([*DOCS.rglob("*.md"), DOCS.parent / "README.md", DOCS.parent / "CONTRIBUTING.md"])


def test_links_lead_somewhere() -> None:
    assert len(PAGES) > len(GUIDES)
    assert [f"{page.relative_to(DOCS.parent)}: {link}" for page in PAGES for link in _broken(page)] == []


def _broken(page: Path) -> Iterator[str]:
    """The links of a page that lead nowhere."""
    for target, anchor in re.findall(r"\]\(([^)#\s]*)(?:#([^)\s]+))?\)", page.read_text()):
        if "://" in target:
            continue
        there = (page.parent / target).resolve() if target else page
        if not there.exists():
            yield target
        elif anchor and there.suffix == ".md":
            headings = re.findall(r"^#+ (.*)$", there.read_text(), re.MULTILINE)
            if anchor not in {_anchor(heading) for heading in headings}:
                yield f"{target}#{anchor}"


def test_a_link_that_leads_nowhere_is_found(tmp_path: Path) -> None:
    (tmp_path / "a.md").write_text("# One two\n[a](b.md) [b](#one-two) [c](a.md#two) [d](https://c.org) [e](a.md)")
    assert list(_broken(tmp_path / "a.md")) == ["b.md", "a.md#two"]


def _anchor(heading: str) -> str:
    """The name by which a heading is linked to, as MyST and GitHub have it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-")


def test_scripts_of_the_pages_find_what_they_import(monkeypatch: pytest.MonkeyPatch) -> None:
    """They run by hand, minutes each; what they take from tests may move."""
    monkeypatch.setattr(sys, "path", [str(DOCS.parent), *sys.path])  # some add folders
    scripts = {script.stem for script in DOCS.glob("*.py")} - {"conf"}  # which writes pages; make docs runs it
    assert scripts
    for script in sorted(scripts):
        importlib.import_module(f"docs.{script}")


def test_every_page_is_in_a_table_of_contents() -> None:
    named = {
        (index.parent / f"{entry}.md").resolve()
        for index in DOCS.rglob("index.md")
        for block in re.findall(r"```\{toctree\}\n(.*?)```", index.read_text(), re.DOTALL)
        for entry in re.findall(r"^([\w/-]+)$", block, re.MULTILINE)
    }
    assert named | {DOCS / "index.md"} == set(DOCS.rglob("*.md"))


@pytest.mark.parametrize("name", ["commands", "filters", "presets", "layers"])
def test_reference_pages_are_what_the_code_says(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run ``make docs`` after a change of a command, a filter or a setting."""
    pytest.importorskip("vtkmodules", reason="the reader of filters needs VTK: install svv[standalone]")
    monkeypatch.syspath_prepend(str(DOCS))
    made = importlib.import_module("generated")
    folder = "design" if name == "layers" else "reference"
    assert "\n".join(getattr(made, name)()) + "\n" == (DOCS / folder / f"{name}.md").read_text()


def test_no_page_has_a_placeholder() -> None:
    words = re.compile(r"\b(?:TODO|TBD|XXX|FIXME|[A-Z]{5,}\d{3})\b")
    found = {path.name: words.findall(path.read_text(encoding="utf-8")) for path in DOCS.rglob("*.md")}
    assert {name: some for name, some in found.items() if some} == {}


def test_what_maintainers_open_first_is_there() -> None:
    paths = re.findall(r"`(svv/[\w/]+\.py)`", (DOCS / "design" / "layers.md").read_text(encoding="utf-8"))
    assert len(paths) > 9 and [path for path in paths if not (DOCS.parent / path).exists()] == []


def test_a_panel_begins_with_at_most_twelve_properties(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without buttons, what only tells, and what appears only beside another one; labels fit the panel."""
    pytest.importorskip("vtkmodules", reason="the reader of filters needs VTK: install svv[standalone]")
    monkeypatch.syspath_prepend(str(DOCS))
    counts = {}
    for cls in importlib.import_module("generated")._decorated():
        shown = [
            one
            for one in ElementTree.fromstring(f"<all>{''.join(cls.xml)}</all>").iter()
            if one.tag.endswith("Property") and one.tag != "Property"
            and one.get("panel_visibility", "default") == "default"
            and one.get("panel_widget") != "command_button"
            and one.find('Hints/PropertyWidgetDecorator[@mode="visibility"]') is None
        ]  # fmt: skip
        counts[cls.__name__] = sum(one.get("information_only") != "1" for one in shown)
        assert all(len(one.get("label", "")) <= 24 for one in shown), cls.__name__
        told = [one.get("name") for one in shown if one.get("information_only") == "1"]
        assert "Status" in told or "Writer" in cls.__name__, (cls.__name__, told)
    assert counts["StyleRFFigure"] == counts["StyleRFEdit"] == counts["StyleRFStylize"] == 12
    assert {name: count for name, count in counts.items() if count > 12} == {}


def test_tooltips_of_what_can_be_chosen_show_its_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("vtkmodules", reason="the reader of filters needs VTK: install svv[standalone]")
    monkeypatch.syspath_prepend(str(DOCS))
    shown: dict[str, str] = {}
    for cls in importlib.import_module("generated")._decorated():
        for one in ElementTree.fromstring(f"<all>{''.join(cls.xml)}</all>").iter():
            found = re.findall(r'<img src="([^"]+)"', one.findtext("Documentation") or "")
            shown |= {f"{cls.__name__}.{one.get('name')}": Path(path).name for path in found if Path(path).is_file()}
    assert shown["StyleRFLook.Look"] == "looks.jpg" and shown["StyleRFEdit.Region0MatCap"] == "matcaps.jpg"
    assert shown["StyleRFStylize.Gallery"] == shown["StyleRFStylize.Region0Style"] == "styles.jpg"


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the examples start from."""
    folder = tmp_path_factory.mktemp("documentation")
    fill(folder)
    return folder


@pytest.fixture
def folder(tmp_path: Path, filled: Path, broad_strokes: None, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where a page is worked through, with a preset that takes a second."""
    shutil.copytree(filled, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SVV_CACHE", str(tmp_path / "cache"))
    monkeypatch.setitem(PRESETS, "draft", SHORT)
    monkeypatch.setattr("svv.render.web.page.MOVIE_FRAMES", 2)
    monkeypatch.setattr("pyvista.global_theme.window_size", [256, 192])
    for module in (fit, starting):  # of splats
        monkeypatch.setattr(module, "VIEWS", 4)
        monkeypatch.setattr(module, "PIXELS", 40)
    monkeypatch.setattr(svv, "fit_splats", partial(svv.fit_splats, options=svv.SplatOptions(count=300, steps=3)))
    monkeypatch.setattr(svv, "paint", partial(svv.paint, preset="draft", n=16, size=56, tell=lambda _: None))
    return tmp_path


@pytest.mark.parametrize(
    "page", [pytest.param(page, marks=[pytest.mark.slow] * (page.stem in LONG)) for page in GUIDES],
    ids=[str(page.relative_to(DOCS.parent).with_suffix("")) for page in GUIDES],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore:(Regions look alike|Panel a )")  # the pages' scenes are small and untrained
def test_a_page_works_as_written(page: Path, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, object] = {}
    for block in blocks(page, "python", "sh"):
        code = compile(block.text, str(block), "exec") if block.language == "python" else None
        if block.not_run is not None:
            continue
        if code is not None:
            exec(code, names)
        else:
            for words in commands(block):
                try:
                    run(words)
                except Exception as error:
                    raise AssertionError(f"{block}: {shlex.join(words)}") from error
    if page == PYTHON_TUTORIAL:
        said = capsys.readouterr().out
        assert "region 0: colour #cc1a1a, opacity 0.5" in said
        assert "('brush', 'ink') ink" in said
        assert "Region 0 is styled" in said
        assert {p.name for p in folder.iterdir()} >= {"scene.svv", "red.png", "ink.svv"}


def test_what_is_not_run_says_why() -> None:
    found = Counter(block.not_run for page in GUIDES for block in blocks(page, "python", "sh") if block.not_run)
    assert found == NOT_RUN


def test_the_steps_of_the_presets_are_those_of_the_code() -> None:
    text = (DOCS / "reference" / "command-line.md").read_text()
    said = dict(re.findall(r"^\| `(\w+)` \|.*\| ([\d,]+ \+ [\d,]+) \|$", text, re.MULTILINE))
    made = {name: f"{p.reconstruct.iterations:,} + {p.recolour.iterations:,}" for name, p in PRESETS.items()}
    assert said == made


def test_every_block_has_a_language() -> None:
    for page in GUIDES:
        fences = re.findall(r"^```(.*)$", page.read_text(), re.MULTILINE)
        assert all(fences[::2]), page


@pytest.mark.slow
def test_examples_run_in_order(folder: Path) -> None:
    """As the documentation runs them, with a preset that takes a second."""
    pytest.importorskip("anywidget", reason="an example makes a widget: install svv[notebook]")
    (folder / "scene.svv").unlink()
    for example in sorted((DOCS / "examples").glob("*.py")):
        assert runpy.run_path(str(example)).keys() & {"picture", "size"}, example
    assert {"scene.svv", "scene.html"} <= {path.name for path in folder.iterdir()}
