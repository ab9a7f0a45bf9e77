"""Save the key frames of the active view's camera as a shot, which svv render --shot films."""

from svv.errors import BadInput
from svv.pv.client.shot import left_out, save_shot

try:
    path, others = save_shot(), left_out()
    print(f"The shot was saved as {path}. This makes the film: svv render SCENE.svv --shot '{path}' --out film.mp4")
    if others:
        print(f"It has the camera alone, and not what else the animation changes: {', '.join(others)}.")
except BadInput as error:
    print(error)
