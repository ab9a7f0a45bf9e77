"""Train svv and nerfacto on the same views for the same time on a CPU, one after the other, and score unseen views.

python docs/measurements/peers.py TF01 --seconds 100 --peer nerfstudio/bin/python --out peers

nerfacto is nerfstudio's default method (Tancik et al. 2023), the only one found that trains radiance fields on a CPU
with packages of pip alone: ``pip install nerfstudio`` in an environment of its own, whose Python is ``--peer``. Its
tables and networks are plain torch there (``implementation="torch"``), with the settings that its documentation gives
for synthetic scenes. Both are scored over white on test views of ``SIZE`` pixels, averages of the originals'.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

SIZE, VIEWS = 200, 4
"""Width of the scored images, a divisor of the views' width, and their number."""


def truth(folder: Path, frame: dict[str, str]) -> NDArray[np.float32]:
    """Return a test view over white, shrunk by averaging. (SIZE, SIZE, 3)"""
    rgba = np.asarray(Image.open(folder / f"{frame['file_path']}.png").convert("RGBA"), np.float32) / 255
    white = rgba[..., :3] * rgba[..., 3:] + 1 - rgba[..., 3:]
    return white.reshape(SIZE, len(white) // SIZE, SIZE, -1, 3).mean((1, 3))


def scored(folder: Path) -> tuple[list[dict[str, str]], float]:
    """Return the test views that are scored, evenly spread, and their angle of view."""
    told = json.loads((folder / "transforms_test.json").read_text())
    chosen = np.linspace(0, len(told["frames"]) - 1, VIEWS + 2).round().astype(int)[1:-1]
    return [told["frames"][k] for k in chosen], told["camera_angle_x"]


def report(name: str, images: list[NDArray[np.float32]], folder: Path, out: Path, **more: float) -> None:
    """Print the mean PSNR and what else there is to say, and save the images beside the truth."""
    right = [truth(folder, frame) for frame in scored(folder)[0]]
    psnr = [-10 * np.log10(np.square(a.clip(0, 1) - b).mean()) for a, b in zip(images, right, strict=True)]
    both = np.concatenate([np.hstack([b, a.clip(0, 1)]) for a, b in zip(images, right, strict=True)])
    Image.fromarray((255 * both + 0.5).astype(np.uint8)).save(out / f"{name}.png")
    print(name, json.dumps({"psnr": round(float(np.mean(psnr)), 2), **more}), flush=True)


def nerfacto(folder: Path, seconds: float, out: Path) -> None:
    """Train nerfacto; runs in nerfstudio's environment."""
    import torch
    import torchmetrics.image.lpip
    from nerfstudio.cameras.cameras import Cameras, CameraType
    from nerfstudio.configs.method_configs import method_configs
    from nerfstudio.data.datamanagers.base_datamanager import VanillaDataManagerConfig
    from nerfstudio.data.dataparsers.blender_dataparser import BlenderDataParserConfig
    from nerfstudio.engine.callbacks import TrainingCallbackAttributes, TrainingCallbackLocation
    from nerfstudio.engine.optimizers import Optimizers

    # Its LPIPS, which would download weights, is not used here.
    torchmetrics.image.lpip.LearnedPerceptualImagePatchSimilarity = lambda **_: torch.nn.Identity()
    torch.manual_seed(0)
    config = method_configs["nerfacto"]
    model = config.pipeline.model
    config.pipeline.datamanager = VanillaDataManagerConfig(
        data=folder, dataparser=BlenderDataParserConfig(data=folder), train_num_rays_per_batch=4096
    )
    model.implementation, model.background_color, model.camera_optimizer.mode = "torch", "white", "off"
    model.proposal_initial_sampler, model.near_plane, model.far_plane = "uniform", 2.0, 6.0
    model.use_average_appearance_embedding, model.disable_scene_contraction = False, True
    model.distortion_loss_mult = 0.0
    pipeline = config.pipeline.setup(device="cpu", test_mode="test")
    pipeline.train()
    groups = {name: group for name, group in pipeline.get_param_groups().items() if group}
    optimizers = Optimizers({name: config.optimizers[name] for name in groups}, groups)
    told = TrainingCallbackAttributes(optimizers=optimizers, grad_scaler=None, pipeline=pipeline, trainer=None)
    callbacks, steps, begun = pipeline.get_training_callbacks(told), 0, time.perf_counter()
    while time.perf_counter() - begun < seconds:
        for callback in callbacks:
            callback.run_callback_at_location(steps, location=TrainingCallbackLocation.BEFORE_TRAIN_ITERATION)
        optimizers.zero_grad_all()
        sum(pipeline.get_train_loss_dict(steps)[1].values()).backward()
        optimizers.optimizer_step_all()
        optimizers.scheduler_step_all(steps)
        for callback in callbacks:
            callback.run_callback_at_location(steps, location=TrainingCallbackLocation.AFTER_TRAIN_ITERATION)
        steps += 1
    spent = time.perf_counter() - begun
    pipeline.eval()
    frames, angle = scored(folder)
    focal, images, begun = 0.5 * SIZE / math.tan(angle / 2), [], time.perf_counter()
    for frame in frames:
        pose = torch.tensor(frame["transform_matrix"])[:3]
        lens = {"fx": focal, "fy": focal, "cx": SIZE / 2, "cy": SIZE / 2, "width": SIZE, "height": SIZE}
        camera = Cameras(pose[None], **lens, camera_type=CameraType.PERSPECTIVE)
        with torch.no_grad():
            images.append(pipeline.model.get_outputs_for_camera(camera)["rgb"].numpy())
    view = (time.perf_counter() - begun) / len(frames)
    report("nerfacto", images, folder, out, steps=steps, seconds=round(spent, 1), seconds_a_view=round(view, 2))


def ours(folder: Path, seconds: float, out: Path) -> None:
    """Train with ``svv train``, kernels compiled, and render with the palette network."""
    from svv.fields.scene.scene import Scene
    from svv.io.views.viewset import ViewSet

    path, begun = out / "ours.svv", time.perf_counter()
    command = [sys.executable, "-m", "svv", "train", folder, "--out", path, "--preset", "fast"]
    subprocess.run([*map(str, command), "--time-limit", str(seconds)], check=True, capture_output=True)
    spent = time.perf_counter() - begun
    scene, views = Scene.load(path), ViewSet.read(folder, "test")
    chosen = np.linspace(0, len(views) - 1, VIEWS + 2).round().astype(int)[1:-1]
    cameras = [views.cameras[k].resized(SIZE, SIZE) for k in chosen]
    scene.render(cameras[0], "pcn")
    begun = time.perf_counter()
    images = [scene.render(camera, "pcn", (1.0, 1.0, 1.0)).rgba[..., :3] for camera in cameras]
    view = (time.perf_counter() - begun) / len(cameras)
    report("ours", images, folder, out, seconds=round(spent, 1), seconds_a_view=round(view, 3))


def main() -> None:
    """Train and score one after the other."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("views", type=Path, help="folder with transforms_train.json and transforms_test.json")
    parser.add_argument("--seconds", type=float, default=100.0, help="time limit of each training")
    parser.add_argument("--peer", default="", help="Python of an environment with nerfstudio")
    parser.add_argument("--out", type=Path, default=Path("peers"), help="folder for scenes and images")
    parser.add_argument("--only-nerfacto", action="store_true", help=argparse.SUPPRESS)  # in the environment of --peer
    how = parser.parse_args()
    how.out.mkdir(parents=True, exist_ok=True)
    if how.only_nerfacto:
        nerfacto(how.views, how.seconds, how.out)
        return
    ours(how.views, how.seconds, how.out)
    if how.peer:
        same = [str(how.views), "--seconds", str(how.seconds), "--out", str(how.out)]
        subprocess.run([how.peer, __file__, *same, "--only-nerfacto"], check=True)


if __name__ == "__main__":
    main()
