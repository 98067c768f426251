"""Pictures of what a locomotion model finds."""
import numpy as np

__all__ = ['alignment_picture', 'most_moving']


def most_moving(model, count=4):
    """Names of the plain channels whose cycles move most for their noise."""
    power = (model.mean.var(axis=1) / model.noise).mean(axis=0) * model.features.plain
    return [model.joint_names[i] for i in np.argsort(-power, kind='stable')[:count]]


def alignment_picture(model, motions, analyses, joint_names=None):
    """Draw recordings over time (left) and over common phases (right), coloured by style.

    Parameters
    ----------
    model : LocomotionModel
    motions : sequence of Motion
    analyses : sequence of Analysis
        One a motion.
    joint_names : sequence of str, optional
        Rows of the picture.

    Returns
    -------
    matplotlib.figure.Figure
    """
    import matplotlib.pyplot as plt
    joint_names = list(joint_names or most_moving(model))
    figure, axes = plt.subplots(len(joint_names), 2, figsize=(11, 2.3 * len(joint_names)), sharey='row', squeeze=False)
    colours = [plt.get_cmap('tab10')(c % 10) for c in range(model.n_styles)]
    named = set()
    for motion, found in zip(motions, analyses):
        curves = motion.joints(joint_names).at(found.times)
        for row, (values, unit) in enumerate(zip(curves.positions.T, curves.units)):
            values = np.degrees(values) if unit == 'rad' else values
            label = model.style_names[found.style] if row == 0 and found.style not in named else None
            named.add(found.style)
            axes[row, 0].plot(found.times - found.times[0], values, color=colours[found.style], lw=0.7, label=label)
            turns = np.floor(found.phase / (2 * np.pi))
            wrapped = found.phase - 2 * np.pi * turns
            broken = np.where(np.diff(turns, prepend=turns[0]) != 0, np.nan, wrapped)
            axes[row, 1].plot(100 * broken / (2 * np.pi), values, color=colours[found.style], lw=0.7)
            axes[row, 0].set_ylabel(f"{joint_names[row]}, {'deg' if unit == 'rad' else unit}")
    axes[0, 0].legend(fontsize=8, ncol=2)
    axes[0, 0].set_title('over time')
    axes[0, 1].set_title('over phase')
    axes[-1, 0].set_xlabel('time, s')
    axes[-1, 1].set_xlabel('phase, % of cycle')
    figure.tight_layout()
    return figure
