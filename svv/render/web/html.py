"""HTML from templates, in which every value is escaped."""

from __future__ import annotations

from importlib.resources import files

from jinja2 import Environment, StrictUndefined


def filled(template: str, **values: object) -> str:
    """Return a template of Jinja with its values, escaped unless the template says ``|safe``.

    >>> filled("<p>{{ text }}</p>", text="a < b")
    '<p>a &lt; b</p>'
    """
    return Environment(autoescape=True, undefined=StrictUndefined).from_string(template).render(values)


def viewer_file(name: str) -> str:
    """Return the text of a file of the page of a scene (``svv/render/web/viewer/``)."""
    return files("svv.render.web").joinpath("viewer", name).read_text(encoding="utf-8")
