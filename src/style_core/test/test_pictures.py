"""Pictures: what is drawn, and that they can be written."""
import numpy as np
import pytest
from matplotlib.image import imread

from style_core import datasets, pictures
from style_core.errors import MotionError


def test_curves_draw_every_joint_in_degrees_with_band_and_span(gait, tmp_path):
    values = gait.positions.copy()
    values[100:120, 2] = np.nan
    lines = [pictures.Line('actual', gait.times, values),
             pictures.Line('predicted', gait.times[50:], values[50:], np.full((351, 8), 0.1))]
    figure = pictures.joint_curves(gait.joint_names, lines, 'a gait', columns=3, spans=[(1.0, 2.0, 'dark')])
    panels = [axis for axis in figure.axes if axis.axison]
    assert [axis.get_title(loc='left') for axis in panels] == list(gait.joint_names)
    drawn = panels[2].lines[0].get_ydata()
    np.testing.assert_allclose(drawn, np.degrees(values[:, 2]))
    assert len(panels[0].collections) == 1 and len(panels[0].lines) == 2
    pictures.save(figure, tmp_path / 'folder' / 'curves.png')
    assert imread(tmp_path / 'folder' / 'curves.png').std() > 0.05


def test_a_line_of_the_wrong_shape_or_a_strange_suffix_is_refused(gait, tmp_path):
    with pytest.raises(MotionError, match='shape'):
        pictures.joint_curves(gait.joint_names, [pictures.Line('x', gait.times, gait.positions[:, :3])])
    with pytest.raises(MotionError, match='png'):
        pictures.save(None, tmp_path / 'x.gif')


def test_stick_figures_colour_the_sides_and_leave_out_open_bones(trial, tmp_path):
    import matplotlib.pyplot as plt
    skeleton = datasets.skeleton('35')
    motion = trial('35_01')
    places = skeleton.forward(motion)[0]
    figure, axis = plt.subplots()
    pictures.draw_pose(axis, skeleton, places)
    colours = [line.get_color() for line in axis.lines]
    assert len(axis.lines) == len(skeleton.bodies)  # a bone for each body but the root, and the head
    assert colours.count('#0072b2') == colours.count('#d55e00') == 12
    plt.close(figure)
    for made in (pictures.stick_strip(skeleton, [('walk', motion), ('no root', motion.select('!root.*'))], 6),
                 pictures.stick_pair(skeleton, [('a', motion), ('b', motion)], [0.5, 1.0])):
        pictures.save(made, tmp_path / 'sticks.png')
        assert imread(tmp_path / 'sticks.png').std() > 0.05
