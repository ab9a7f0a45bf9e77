"""Pairs of region and style, and the image of one region on which stylization trains."""

from __future__ import annotations

import pytest
import torch

from svv.errors import BadInput
from svv.train.paint.style_choice import style_pairs
from svv.train.paint.styled_views import StyledView


def test_region_image_is_weighted_colour_over_background() -> None:
    view = StyledView(
        torch.zeros(3, 3), torch.tensor([0.5, 0.25, 0.25]), torch.tensor([0, 0, 1]), torch.tensor([0, 1, 0]), 1, 2
    )
    image, mask = view.image(torch.tensor([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), 0, 0.2)
    torch.testing.assert_close(mask, torch.tensor([[0.5, 0.25]]))
    torch.testing.assert_close(image[:, 0, 0], torch.tensor([0.6, 0.1, 0.1]))
    torch.testing.assert_close(image[:, 0, 1], torch.tensor([0.15, 0.15, 0.4]))


@pytest.mark.parametrize(
    ("regions", "styles", "mapping", "keep", "words"),
    [
        (2, 0, None, (), "at least one style"),
        (2, 1, {5: 0}, (), "no region 5"),
        (2, 1, {0: 3}, (), "no style 3"),
        (2, 1, None, (4,), "no region 4"),
        (2, 1, {0: 0}, (0,), "both kept and styled"),
        (2, 1, None, (0, 1), "keep fewer regions"),
        (0, 1, None, (), "no regions"),
    ],
)
def test_pairs_that_cannot_be(
    regions: int, styles: int, mapping: dict[int, int] | None, keep: tuple[int, ...], words: str
) -> None:
    with pytest.raises(BadInput, match=words):
        style_pairs(regions, styles, mapping, keep)


def test_pairs_in_turn() -> None:
    assert style_pairs(3, 2, None, ()) == {0: 0, 1: 1, 2: 0}
    assert style_pairs(3, 2, None, (0,)) == {1: 0, 2: 1}
    assert style_pairs(3, 2, {2: 1}, ()) == {2: 1}
