"""Pictures of motion: stick figures, strips of poses, joint curves with bands. They return matplotlib figures."""
from typing import NamedTuple, Optional

import matplotlib
import numpy as np

from style_core.errors import MotionError
from style_core.formats.files import replacing
from style_core.mirroring import partner_name

__all__ = ['COLOURS', 'Line', 'joint_curves', 'draw_pose', 'stick_strip', 'stick_pair', 'save']

#: recorded, predicted, synthesised, reference; distinct to colour-blind eyes
COLOURS = ('#222222', '#d55e00', '#0072b2', '#009e73', '#cc79a7')

#: legends outside the axes came with matplotlib 3.7
_OLD = tuple(map(int, matplotlib.__version__.split('.')[:2])) < (3, 7)

_LEFT, _RIGHT, _MIDDLE = '#0072b2', '#d55e00', '#444444'


class Line(NamedTuple):
    """One course of several joints for `joint_curves`.

    Attributes
    ----------
    label : str
    times : ndarray, shape (T,)
        s.
    values : ndarray, shape (T, D)
        Rad; gaps (NaN) stay gaps.
    std : ndarray, shape (T, D), optional
        Rad; a band of two standard deviations is drawn.
    """

    label: str
    times: np.ndarray
    values: np.ndarray
    std: Optional[np.ndarray] = None


def joint_curves(joint_names, lines, title='', columns=2, spans=(), unit='deg'):
    """Draw one panel a joint with a curve for each line.

    Parameters
    ----------
    joint_names : sequence of str, length D
    lines : sequence of Line
        With D columns each.
    title : str
    columns : int
        Panels in a row.
    spans : sequence of (start_s, stop_s, label), optional
        Shaded times, e.g. while sensors were missing.
    unit : {'deg', 'rad', 'm'}
        Unit of the axis; ``'deg'`` converts from rad.

    Returns
    -------
    matplotlib.figure.Figure
    """
    plt = _pyplot()
    for line in lines:
        if np.shape(line.values) != (len(line.times), len(joint_names)):
            raise MotionError(f'line {line.label!r} has values of shape {np.shape(line.values)}, expected '
                              f'{(len(line.times), len(joint_names))}')
    columns = min(columns, len(joint_names))
    rows = -(-len(joint_names) // columns)
    scale = 180 / np.pi if unit == 'deg' else 1.0
    figure, axes = plt.subplots(rows, columns, figsize=(5.2 * columns, 0.7 + 1.7 * rows), sharex=True, squeeze=False,
                                constrained_layout=True)
    for index, (name, axis) in enumerate(zip(joint_names, axes.flat)):
        for start, stop, label in spans:
            axis.axvspan(start, stop, color='#f0e442', alpha=0.35, lw=0, label=label)
        for line, colour in zip(lines, COLOURS):
            values = scale * np.asarray(line.values)[:, index]
            axis.plot(line.times, values, color=colour, lw=1.3, label=line.label)
            if line.std is not None:
                band = 2 * scale * np.asarray(line.std)[:, index]
                axis.fill_between(line.times, values - band, values + band, color=colour, alpha=0.2, lw=0,
                                  label=f'{line.label}, ± 2 std')
        axis.set_title(name, fontsize=9, loc='left', pad=2)
        axis.grid(alpha=0.3)
        axis.tick_params(labelsize=8)
    for axis in axes.flat[len(joint_names):]:
        axis.set_axis_off()
    for index in range(max(0, len(joint_names) - columns), len(joint_names)):  # the lowest panel of each column
        axes.flat[index].set_xlabel('time (s)', fontsize=9)
        axes.flat[index].tick_params(labelbottom=True)
    figure.supylabel({'deg': 'angle (degrees)', 'rad': 'angle (rad)', 'm': 'position (m)'}[unit], fontsize=9)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    unique = dict(zip(labels, handles))
    figure.legend(unique.values(), unique.keys(), loc='upper right' if _OLD else 'outside upper right',
                  ncol=len(unique), fontsize=8, frameon=False)
    if title:
        figure.suptitle(title, x=0.01, ha='left', fontsize=11)
    return figure


def draw_pose(axis, skeleton, positions, shift=0.0, azimuth_deg=65.0, alpha=1.0, colour=None):
    """Draw one pose into an axis.

    Parameters
    ----------
    axis : matplotlib.axes.Axes
    skeleton : Skeleton
    positions : ndarray, shape (B, 3)
        As `Skeleton.forward` gives them, m. Bones with an open end (NaN) are left out.
    shift : float
        Moves the figure to the right, m.
    azimuth_deg : float
        Direction it is seen from: 0 from the front, 90 from the left side.
    alpha : float
    colour : str, optional
        One colour for all bones; else left blue, right orange, middle grey.
    """
    flat = _project(skeleton, positions, azimuth_deg)
    names = skeleton.body_names
    for index, body in enumerate(skeleton.bodies):
        if body.parent < 0:
            continue
        bone = flat[[body.parent, index]]
        paint = colour or _side_colour(names[index], names)
        axis.plot(bone[:, 0] + shift, bone[:, 1], color=paint, lw=1.8, alpha=alpha, solid_capstyle='round')
    head = [index for index, name in enumerate(names) if name.lower() == 'head']
    if head:
        axis.plot(flat[head, 0] + shift, flat[head, 1], 'o', ms=5, color=colour or _MIDDLE, alpha=alpha)


def stick_strip(skeleton, rows, count=10, title='', azimuth_deg=65.0, follow=True):
    """Draw strips of stick figures, one row a motion, evenly spaced in time.

    Parameters
    ----------
    skeleton : Skeleton
    rows : sequence of (str, Motion)
        Label and motion.
    count : int
        Figures in a row.
    title : str
    azimuth_deg : float
        See `draw_pose`.
    follow : bool
        Spaced evenly on the page (True) or where they are in the world (False).

    Returns
    -------
    matplotlib.figure.Figure
    """
    plt = _pyplot()
    figure, axes = plt.subplots(len(rows), 1, figsize=(1.05 * count + 0.8, 2.3 * len(rows) + 0.4), squeeze=False,
                                constrained_layout=True)
    for (label, motion), axis in zip(rows, axes[:, 0]):
        frames = np.unique(np.round(np.linspace(0, motion.n_frames - 1, count)).astype(int))
        part = motion.replace(positions=motion.positions[frames], times=motion.times[frames])
        places = skeleton.forward(part)
        roots = np.flatnonzero(skeleton.parents < 0)[:1]
        ticks = []
        for index, pose in enumerate(places):
            shift = 0.0
            if follow:
                pose = pose - pose[roots] * _level(skeleton)
                shift = 0.75 * _size(skeleton) * index
            draw_pose(axis, skeleton, pose, shift, azimuth_deg)
            ticks.append(shift + _project(skeleton, pose[roots], azimuth_deg)[0, 0])
        _bare(axis)
        axis.set_xticks(ticks, [f'{time:.2f} s' for time in part.times], fontsize=7)
        axis.set_title(label, fontsize=9, loc='left')
    if title:
        figure.suptitle(title, x=0.01, ha='left', fontsize=11)
    return figure


def stick_pair(skeleton, motions, times, title='', azimuth_deg=65.0):
    """Draw the poses of several motions over each other, e.g. actual and predicted.

    Parameters
    ----------
    skeleton : Skeleton
    motions : sequence of (str, Motion)
        Label and motion; interpolated at ``times``.
    times : sequence of float
        One group of figures each, s.
    title : str
    azimuth_deg : float

    Returns
    -------
    matplotlib.figure.Figure
    """
    plt = _pyplot()
    from matplotlib.lines import Line2D
    figure, axis = plt.subplots(figsize=(1.3 * len(times) + 0.8, 3.1), constrained_layout=True)
    roots = np.flatnonzero(skeleton.parents < 0)[:1]
    for (_, motion), colour in zip(motions, COLOURS):
        for index, pose in enumerate(skeleton.forward(motion.at(times))):
            pose = pose - pose[roots] * _level(skeleton)
            draw_pose(axis, skeleton, pose, 0.8 * _size(skeleton) * index, azimuth_deg, 0.8, colour)
    _bare(axis)
    axis.set_xticks(0.8 * _size(skeleton) * np.arange(len(times)), [f'{time:.2f} s' for time in times], fontsize=8)
    axis.legend([Line2D([], [], color=colour, lw=2) for _, colour in zip(motions, COLOURS)],
                [label for label, _ in motions], fontsize=8, frameon=False, loc='upper left', ncol=len(motions),
                bbox_to_anchor=(0, 1.12))
    if title:
        figure.suptitle(title, x=0.01, ha='left', fontsize=11)
    return figure


def save(figure, path):
    """Write a figure as a picture (suffix ``.png``, ``.pdf`` or ``.svg``) and close it."""
    from pathlib import Path
    plt = _pyplot()
    path = Path(path)
    if path.suffix.lower() not in ('.png', '.pdf', '.svg'):
        raise MotionError(f'{path}: pictures are written as .png, .pdf or .svg')
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with replacing(path, 'wb') as stream:
            figure.savefig(stream, dpi=110, format=path.suffix[1:].lower())
    finally:
        plt.close(figure)


def _pyplot():
    """Imported late: the command line and the nodes should start without it."""
    import matplotlib.pyplot as plt
    return plt


def _project(skeleton, positions, azimuth_deg):
    """Orthographic view: shape (..., 3) to (..., 2); forward is z for skeletons with y up, x for those with z up."""
    positions = np.asarray(positions)
    if skeleton.up == 'y':
        left, forward, up = positions[..., 0], positions[..., 2], positions[..., 1]
    else:
        left, forward, up = positions[..., 1], positions[..., 0], positions[..., 2]
    azimuth = np.radians(azimuth_deg)
    return np.stack([np.sin(azimuth) * forward + np.cos(azimuth) * left, up], axis=-1)


def _level(skeleton):
    """Factor that keeps the horizontal components."""
    return np.array([1, 0, 1]) if skeleton.up == 'y' else np.array([1, 1, 0])


def _size(skeleton):
    """Height of the skeleton at rest, m."""
    extent = np.ptp(skeleton.rest()[0], axis=0)
    return float(max(extent[1 if skeleton.up == 'y' else 2], 0.5 * extent.max(), 1e-3))


def _side_colour(name, names):
    partner = partner_name(name, names)
    if partner == name:
        return _MIDDLE
    # the first letter in which both differ tells the side
    return _LEFT if next(a for a, b in zip(name, partner) if a != b) in 'lL' else _RIGHT


def _bare(axis):
    axis.set_aspect('equal')
    axis.set_yticks([])
    for side in ('top', 'left', 'right'):
        axis.spines[side].set_visible(False)
    axis.tick_params(length=0)
    axis.margins(x=0.02)
