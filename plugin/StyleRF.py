"""StyleRF: expressive volume visualization in ParaView's Filters menu.

The filters are thin: a list of properties, and calls into the package ``svv``. Heavy modules are imported only when a
filter first runs, so ParaView starts as quickly as without the plugin.
"""

import importlib.util
import sys
from pathlib import Path

paraview_plugin_name = "StyleRF"
paraview_plugin_version = "0.2.0"

if importlib.util.find_spec("svv") is None:  # loaded by hand: the package is in the plugin's folder or its parent
    _here = Path(__file__).resolve().parent
    sys.path += [str(folder) for folder in (_here, _here.parent) if (folder / "svv").is_dir()]

try:
    from svv.pv.client.capture import watch_new_filters
    from svv.pv.filters.edit_filters import *  # noqa: F403  (ParaView looks for the filters in this module)
    from svv.pv.filters.figure_filter import *  # noqa: F403
    from svv.pv.filters.internal_filters import *  # noqa: F403
    from svv.pv.filters.look_filter import *  # noqa: F403
    from svv.pv.filters.readers import *  # noqa: F403
    from svv.pv.filters.scene_filters import *  # noqa: F403
    from svv.pv.filters.volume_filters import *  # noqa: F403

    watch_new_filters()
except ImportError as _error:
    from vtkmodules.vtkCommonCore import vtkOutputWindow

    vtkOutputWindow.GetInstance().DisplayErrorText(
        f"The plugin StyleRF cannot be used here, because {_error.name or _error} is missing in ParaView's Python: "
        "start ParaView with `svv paraview`, which provides the packages that it needs.\n"
    )
