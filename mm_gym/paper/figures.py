"""The paper's figures 2, 3, 5 to 10 and 12, drawn from the library.

Their panels are those that the captions and the text of the paper name. Figures 1, 4 and 11 show
schemes and hardware and are not drawn; docs/paper.md says what is not known of the others.
"bistable" is none of the paper's: figure 6 with a spring of two wells, which the paper leaves out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mm_gym.drawing import save, style
from mm_gym.paper.bistable_figure import figure_bistable
from mm_gym.paper.friction_figures import figure_7, figure_8, figure_9, figure_10
from mm_gym.paper.linear_figures import (
    figure_2,
    figure_2_caption,
    figure_3,
    figure_3_caption,
    figure_5,
)
from mm_gym.paper.spring_figures import figure_6, figure_12

if TYPE_CHECKING:
    from collections.abc import Callable
    from os import PathLike

    from matplotlib.figure import Figure

FIGURES: dict[str, Callable[[], Figure]] = {
    "fig2": figure_2,
    "fig2_caption": figure_2_caption,
    "fig3": figure_3,
    "fig3_caption": figure_3_caption,
    "fig5": figure_5,
    "fig6": figure_6,
    "fig7": figure_7,
    "fig8": figure_8,
    "fig9": figure_9,
    "fig10": figure_10,
    "fig12": figure_12,
    "bistable": figure_bistable,
}
"""The function that draws each figure. Of figures 2 and 3 there are two, with the masses of the
text and with those of figure 2's caption. The last is no figure of the paper."""


def draw(name: str, path: str | PathLike[str]) -> None:
    """Draw one figure, such as "fig2", and write it as PNG."""
    with style():
        save(FIGURES[name](), path)
