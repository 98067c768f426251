"""The full filter of a behaviour: table, filter, standing still, and the list of what can be left out."""
import numpy as np

from style_core.errors import ModelError
from style_core.phase_style.arrow_filter import ArrowFilter
from style_core.phase_style.basis_table import tabulate
from style_core.phase_style.channel import CHANNEL, POSTURE, parts_of
from style_core.phase_style.model import Behaviour, Residual
from style_core.phase_style.style_prior import style_prior, whitened

__all__ = ['PARTS', 'filter_table', 'make_filter', 'still_behaviour']

#: Parts of the full filter that can be switched off, to see what each is worth.
PARTS = ('prior', *(one.name for one in CHANNEL), 'drift', 'calibration', 'search', 'restart', 'still', 'rejection')


def make_filter(behaviour, table, without=()):
    """A filter with a behaviour's residual model.

    Parameters
    ----------
    behaviour : Behaviour
    table : Table
        Of whitened bases.
    without : collection of str
        Some of `PARTS` to leave out.

    Returns
    -------
    ArrowFilter
    """
    residual = behaviour.residual
    if residual is None:
        raise ModelError(f'behaviour {behaviour.name!r} has no residual model: train it again, or use method paper')
    noise = residual.noise
    lasting = [one.name for one in CHANNEL if not one.turns]
    if set(lasting) <= set(without):  # white noise has to carry what they would
        for name in lasting:
            noise = noise + residual.variance[name]
    return ArrowFilter(table, parts_of(residual, behaviour.rhythmic, without), noise,
                       0.0 if 'drift' in without else residual.style_decay, behaviour.acceleration,
                       (behaviour.velocity[2], behaviour.velocity[3]))


def filter_table(behaviour, without=()):
    """Whitened `BasisTable` of a behaviour."""
    factor = behaviour.residual.style_scale if behaviour.residual is not None else 1.0
    if 'prior' in without:
        factor = 1e4
    return whitened(tabulate(behaviour.processes(), behaviour.rhythmic),
                    *style_prior(behaviour.styles, behaviour.groups, factor))


def still_behaviour(behaviours):
    """Standing still: any posture that the behaviours show, kept.

    Posture varies as over all phases and styles of the behaviours. Within a short time it wanders as far as the slow
    offset of the behaviour that wanders least: what moves more than posture does under a walk is not standing.

    Parameters
    ----------
    behaviours : list of Behaviour
        With residual models.

    Returns
    -------
    Behaviour
        Named ``'still'``, with a phase that does not move.
    """
    poses = np.concatenate([np.einsum('sj,jcd->scd', one.styles, one.bases).reshape(-1, len(one.joint_names))
                            for one in behaviours])
    first = behaviours[0]
    channels = len(first.joint_names)
    noise = np.mean([one.residual.noise for one in behaviours], axis=0)
    variance = {one.name: one.still * np.mean([each.residual.variance[one.name] for each in behaviours], axis=0)
                for one in CHANNEL if all(one.name in each.residual.variance for each in behaviours)}
    decay = {name: first.residual.decay[name] for name in variance}
    spread = poses.var(axis=0) + np.mean([one.residual.variance[POSTURE.name] for one in behaviours], axis=0)
    # the mean square moved within a short time t is 2 t decay variance
    wander = min(one.residual.decay[POSTURE.name] * one.residual.variance[POSTURE.name].mean() for one in behaviours)
    variance[POSTURE.name], decay[POSTURE.name] = spread, wander / spread.mean()
    bases = np.broadcast_to(poses.mean(axis=0), (1, 8, channels)).copy()
    residual = Residual(
        variance=variance, decay=decay, share={one.name: np.zeros(0) for one in CHANNEL if one.turns}, noise=noise,
        style_decay=0.0, style_scale=0.0, calibration_horizon=np.zeros(1), calibration_scale=np.ones(1),
        check_median=float(np.mean([one.residual.check_median for one in behaviours])),
        check_weight=float(np.mean([one.residual.check_weight for one in behaviours])))
    return Behaviour(
        name='still', rhythmic=False, joint_names=first.joint_names, rate_hz=first.rate_hz, sequences=('still',),
        groups=('still',), styles=np.ones((1, 1)), singular_values=np.ones(1), phase_grid=np.linspace(0, 1, 8),
        bases=bases, beta=np.array([[float(np.mean(poses ** 2)) + 1e-6, 0.01, 1e6]]), noise=noise,
        acceleration=1e-9, velocity=np.array([0.0, 1e-3, 0.0, 0.0]), speeds=np.zeros((1, 2)),
        gaits=np.zeros(1, dtype=int), residual=residual)
