"""XML from files."""

from __future__ import annotations

from xml.etree import ElementTree


def parsed_xml(text: str | bytes) -> ElementTree.Element:
    """Return the root of an XML text.

    Raises ValueError if it is not XML, or it defines entities, which could grow to any size.
    """
    mark = "<!ENTITY" if isinstance(text, str) else b"<!ENTITY"
    if mark in text:  # type: ignore[operator]
        raise ValueError("it defines entities")
    try:
        return ElementTree.fromstring(text.lstrip("\ufeff") if isinstance(text, str) else text)
    except ElementTree.ParseError as error:
        raise ValueError(str(error)) from error
