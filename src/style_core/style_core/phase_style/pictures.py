"""Pictures of what a phase-style model finds in a recording."""
import numpy as np

from style_core.pictures import COLOURS
from style_core.predictor import Status

__all__ = ['course_picture']


def course_picture(course, title='', batch=None):
    """Draw phase, style, and behaviour and status (or the convergence of batch EM) over time.

    Parameters
    ----------
    course : Course
    title : str
    batch : BatchResult, optional
        Where the course is of batch EM.

    Returns
    -------
    matplotlib.figure.Figure
    """
    import matplotlib.pyplot as plt
    figure, axes = plt.subplots(4, 1, figsize=(9, 9), constrained_layout=True)
    names = list(dict.fromkeys(course.behaviour))
    for index, name in enumerate(names):
        own = np.array([one == name for one in course.behaviour])
        axes[0].plot(course.times[own], course.phase[own], '.', ms=3, label=name, color=COLOURS[index % len(COLOURS)])
    axes[0].set_ylabel('phase')
    axes[0].legend(fontsize=8, ncol=4, frameon=False)
    axes[1].plot(course.times, course.phase_velocity, color=COLOURS[0])
    axes[1].set_ylabel('phase velocity, 1/s')
    axes[2].plot(course.times, course.style)
    axes[2].set_ylabel('style')
    if batch is None:
        axes[3].plot(course.times, [int(one) for one in course.status], drawstyle='steps-post', color=COLOURS[0])
        axes[3].set_yticks([int(one) for one in Status], [one.name for one in Status])
        axes[3].set_ylim(-0.5, len(Status) - 0.5)
    else:
        axes[3].plot(np.arange(1, len(batch.log_likelihood) + 1), batch.log_likelihood, '.-', color=COLOURS[0])
        axes[3].set_ylabel('log likelihood, nats')
    for axis in axes:
        axis.grid(alpha=0.3)
        axis.set_xlabel('time, s')
    if batch is not None:
        axes[3].set_xlabel('iteration')
    figure.suptitle(title, fontsize=11)
    return figure
