"""Is a legend below a figure whole, however long its labels are?"""

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from mm_gym.drawing import legend_below, panels, style


@pytest.mark.parametrize("letters", [5, 30, 60])
@pytest.mark.parametrize("columns", [1, 2, 3, 5])
def test_no_legend_is_clipped(letters, columns):
    with style():
        figure, (axes,) = panels(4.4, 1, 1)
        for number in range(8):
            axes.plot([0.0, 1.0], [0.0, number], label=("frequency loop " * 5)[:letters])
        legend_below(figure, axes, columns)
        FigureCanvasAgg(figure).draw()
        (legend,) = figure.legends
        box, whole = legend.get_window_extent(), figure.bbox
    assert whole.x0 <= box.x0 < box.x1 <= whole.x1
    assert whole.y0 <= box.y0 < box.y1 <= whole.y1
    assert axes.get_position().height > 0.3
