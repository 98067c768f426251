"""The style machine: a stylistic hidden Markov model and its style space, learned from recordings; files."""
import json
from dataclasses import asdict, dataclass, replace
from typing import Optional, Tuple

import numpy as np

from style_core.errors import ModelError, UsageError
from style_core.joint_space import JointSpace, fit_space, read_space
from style_core.model_file import load_model, save_model
from style_core.style_expression import evaluate_style
from style_core.style_machine import emission as em
from style_core.style_machine.preprocessing import Coordinates, fit_coordinates, mean_pose, pose_weights
from style_core.style_machine.training import Settings, train

__all__ = ['KIND', 'StyleMachine', 'learn', 'load', 'save']

KIND = 'style-machine'
_LEAST_STRENGTH = 2.0  # of a style's means, frames: one odd frame must not make a style's state


@dataclass(frozen=True, eq=False)
class StyleMachine:
    """A family of hidden Markov models, one for every value of the style coordinates v.

    Attributes
    ----------
    coordinates : Coordinates
        Coordinates of `space` (joint angles where there is none) to those of the model and back.
    start, trans : ndarray, shapes (N,), (N, N)
        Common to all styles.
    generic : Emission
        The model at v = 0.
    layout : Layout
    axes : ndarray, shape (K, M)
        What one unit of each style coordinate adds to the vector of the generic model. A unit is the root mean
        square of the training styles along that axis.
    spectrum : ndarray, shape (S,)
        Share of the variation between the training styles along each principal axis.
    styles : dict of str to ndarray, shape (K,)
        Coordinates of the training styles.
    recordings : dict of str to ndarray of int, shape (T,)
        Most probable states of each training recording.
    recording_styles : dict of str to str
    likelihoods : dict of str to float
        Log likelihood a frame of each training recording, as `analysis.analyze` reports it.
    strength : float
        Z' of analysis, frames.
    persistence : ndarray, shape (D,)
        Correlation of the residual of each joint from one frame to the next.
    settings : Settings
    training_files : tuple of dict
    history : tuple of dict
    space : JointSpace or None
        What joints are learned in; None in files from before: the angles themselves.
    """

    coordinates: Coordinates
    start: np.ndarray
    trans: np.ndarray
    generic: em.Emission
    layout: em.Layout
    axes: np.ndarray
    spectrum: np.ndarray
    styles: dict
    recordings: dict
    recording_styles: dict
    likelihoods: dict
    strength: float
    persistence: np.ndarray
    settings: Settings
    training_files: Tuple[dict, ...] = ()
    history: Tuple[dict, ...] = ()
    space: Optional[JointSpace] = None

    @property
    def joint_names(self):
        return self.coordinates.joint_names

    @property
    def rate_hz(self):
        return self.coordinates.rate_hz

    @property
    def n_states(self):
        return len(self.start)

    @property
    def dof(self):
        """Number of style coordinates K."""
        return len(self.axes)

    @property
    def parameters(self):
        """Number of free parameters of the generic training model: transitions, starts, means and covariances."""
        n, q = self.n_states, self.coordinates.leading
        return int((self.trans > 0).sum()) - n + int((self.start > 0).sum()) - 1 + n * (q + q * (q + 1) // 2)

    @property
    def orders(self):
        """Order in which each joint with three angles turns; None where the file does not say."""
        return None if self.space is None else self.space.orders

    def encoded(self, motion):
        """A motion of joint angles in the machine's joint space."""
        return motion if self.space is None else self.space.encode_motion(motion)

    def decoded(self, motion):
        """A motion of the machine's joint space in joint angles."""
        return motion if self.space is None else self.space.decode_motion(motion)

    def style(self, expression):
        """Coordinates of a style: a name, an expression such as ``1.5*ballet - 0.5*languid``, or coordinates."""
        if not isinstance(expression, str):
            v = np.atleast_1d(np.asarray(expression, dtype=float))
            if v.ndim != 1 or len(v) > self.dof or not np.isfinite(v).all():
                raise UsageError(f'a style has at most {self.dof} finite coordinates, got {expression!r}')
            return np.concatenate([v, np.zeros(self.dof - len(v))])
        return evaluate_style(expression, self.styles, self.dof)

    def at(self, v):
        """The emission of style v (shape (K,)); v = 0 is the generic model."""
        v = self.style(v)
        if not v.any():
            return self.generic
        n, d = self.generic.positions.shape
        return self.layout.unpack(self.layout.pack(self.generic) + v @ self.axes, n, d, self.generic.leading)


def learn(motions, settings=None, style_names=None, skeleton=None, rate_hz=60.0, leading=10, dof=None, explained=0.95,
          mirror=False, checkpoint=None, progress=None, training_files=()):
    """Learn a style machine from unlabelled recordings.

    Parameters
    ----------
    motions : list of Motion
        The same joints; each of its own style unless ``style_names`` says otherwise.
    settings : Settings, optional
    style_names : list of str, optional
        Style of each motion; motions of one name share a specific model. Their own names by default.
    skeleton : Skeleton, optional
        Weighs the joints by how far they move the body; all alike without it.
    rate_hz : float
        All motions are resampled to this.
    leading : int
        Dimensions used for training (4.1: ten or fewer).
    dof : int, optional
        Number of style coordinates; by default as many as explain ``explained`` of the spectrum.
    explained : float
    mirror : bool
        Train on each recording's mirror image too, as the same style.
    checkpoint : path-like, optional
        See `training.train`.
    progress : callable, optional
    training_files : sequence of dict, optional
        For the record, from `model_file.training_files`.

    Returns
    -------
    StyleMachine
    """
    settings = Settings() if settings is None else settings
    motions, style_names = _checked(motions, style_names, rate_hz)
    both = list(zip(motions, style_names))
    if mirror:
        both += [(motion.mirror(skeleton).replace(name=motion.name + '.mirror'), name)
                 for motion, name in zip(motions, style_names)]
    motions, style_names = [motion for motion, _ in both], [name for _, name in both]
    names = list(dict.fromkeys(style_names))
    index = [names.index(name) for name in style_names]
    space = fit_space(motions)
    posed = [space.encode_motion(motion) for motion in motions]
    weights = pose_weights(posed, skeleton, settings.seed, space) if skeleton is not None else None
    coordinates = fit_coordinates(posed, rate_hz, weights, leading)
    poses = [coordinates.encode(mean_pose(motion)) for motion in posed]
    data = [coordinates.encode(motion.positions) - pose for motion, pose in zip(posed, poses)]
    trained = train([x[:, :coordinates.leading] for x in data], settings, index, checkpoint, progress)
    generic, specifics, strength = remap(trained, data, poses, index, coordinates, settings)
    layout = em.layout_for([generic, *specifics])
    axes, styles, spectrum = style_space(layout, generic, specifics, dof, explained)
    machine = StyleMachine(
        coordinates, trained.family.start, trained.family.trans, generic, layout, axes, spectrum,
        dict(zip(names, styles)), {motion.name: path.astype(np.int32) for motion, path in zip(motions, trained.paths)},
        {motion.name: name for motion, name in zip(motions, style_names)}, {}, strength,
        _persistence(coordinates, generic, data, trained.paths), settings, tuple(training_files),
        tuple(trained.history), space)
    from style_core.style_machine.analysis import analyze  # which needs this module
    return replace(machine, likelihoods={motion.name: analyze(machine, motion).log_likelihood for motion in motions})


def _checked(motions, style_names, rate_hz):
    if not motions:
        raise UsageError('no recordings to learn from')
    first = motions[0]
    fitted = []
    for k, motion in enumerate(motions):
        if set(motion.joint_names) != set(first.joint_names):
            odd = sorted(set(motion.joint_names) ^ set(first.joint_names))
            raise ModelError(f'{motion.name or k} and {first.name or 0} differ in joints {", ".join(odd[:5])}')
        motion = motion.joints(first.joint_names)
        if motion.n_frames > 1 and abs(motion.rate_hz - rate_hz) > 1e-3 * rate_hz:
            motion = motion.resample(rate_hz)
        fitted.append(motion if motion.name else motion.replace(name=f'recording{k + 1}'))
    names = [motion.name for motion in fitted]
    if len(set(names)) < len(names):
        raise UsageError(f'recordings share a name: {", ".join(sorted({n for n in names if names.count(n) > 1}))}')
    style_names = names if style_names is None else list(style_names)
    if len(style_names) != len(fitted):
        raise UsageError(f'{len(style_names)} style names for {len(fitted)} recordings')
    if 'generic' in style_names:
        raise UsageError("a style cannot be called 'generic': that is the model at v = 0")
    return fitted, style_names


def remap(trained, data, poses, index, coordinates, settings):
    """Emissions over positions and velocities of all coordinates, from the occupancies of training (4.2, eqs. 9, 10).

    Returns
    -------
    generic : Emission
    specifics : list of Emission
    strength : float
        Z' in frames.
    """
    q = coordinates.leading
    n_styles = max(index) + 1
    noise = settings.resolution ** 2 * float(coordinates.variances[:q].mean())
    moved = np.concatenate([np.diff(x[:, :q], axis=0) for x in data])
    moved = moved[~np.isnan(moved).any(axis=1)]
    speed = float((moved ** 2).mean()) if len(moved) else 0.0
    noise_pair = (noise, max(settings.resolution ** 2 * speed, 1e-4 * noise))
    parts = [em.velocity_moments(x, gamma, counts, q)
             for x, gamma, counts in zip(data, trained.gammas, trained.counts)]
    strength = max(settings.cross_entropy * sum(map(len, data)) / settings.states / n_styles, _LEAST_STRENGTH)
    by_style = [[k for k, i in enumerate(index) if i == s] for s in range(n_styles)]
    style_poses = [np.mean([poses[k] for k in own], axis=0) for own in by_style]
    sums = [em.add_statistics([parts[k] for k in own]) for own in by_style]
    generic = em.remap_generic(sums, np.mean(style_poses, axis=0), strength, noise_pair)
    specifics = [em.remap_specific(one, pose, generic, strength) for one, pose in zip(sums, style_poses)]
    return generic, specifics, strength


def style_space(layout, generic, specifics, dof, explained):
    """Principal axes of the styles around the generic model (4.3).

    Returns
    -------
    axes : ndarray, shape (K, M)
    styles : ndarray, shape (S, K)
    spectrum : ndarray, shape (S,)
        Share of the variation along every axis.
    """
    origin = layout.pack(generic)
    gaps = np.array([layout.pack(one) for one in specifics]) - origin
    u, s, vt = np.linalg.svd(gaps, full_matrices=False)
    energy = s ** 2
    spectrum = energy / energy.sum() if energy.sum() > 0 else np.zeros(len(s))
    rank = max(1, int((s > 1e-9 * s[0]).sum())) if s[0] > 0 else 1
    if dof is None:
        dof = int(np.searchsorted(np.cumsum(spectrum), explained - 1e-12) + 1) if spectrum.any() else 1
    dof = max(1, min(dof, rank))
    unit = np.where(s > 0, s, 1.0)[:dof] / np.sqrt(len(specifics))
    signs = np.sign(u[np.argmax(np.abs(u[:, :dof]), axis=0), np.arange(dof)])
    signs[signs == 0] = 1.0
    return vt[:dof] * (unit * signs)[:, None], u[:, :dof] * s[:dof] / unit * signs, spectrum


def _persistence(coordinates, generic, data, paths):
    """Correlation at one frame of what a joint's angle deviates from the mean of its state."""
    before, after, square = 0.0, 0.0, 0.0
    to_joints = coordinates.basis.T / coordinates.weights
    for x, path in zip(data, paths):
        residual = (x - generic.positions[path]) @ to_joints
        whole = ~np.isnan(residual).any(axis=1)
        pairs = whole[1:] & whole[:-1]
        before = before + (residual[:-1][pairs] * residual[1:][pairs]).sum(axis=0)
        square = square + (residual[:-1][pairs] ** 2).sum(axis=0)
        after = after + (residual[1:][pairs] ** 2).sum(axis=0)
    scale = np.sqrt(np.asarray(square) * after)
    return np.clip(np.where(scale > 0, before / np.where(scale > 0, scale, 1.0), 0.0), 0.0, 0.999)


def save(machine, path):
    """Write a model file (axes in single precision: they are by far the largest part)."""
    c, g = machine.coordinates, machine.generic
    header = {
        'joint_names': list(c.joint_names), 'units': list(c.units), 'rate_hz': c.rate_hz, 'leading': c.leading,
        'style_names': list(machine.styles), 'recordings': list(machine.recordings),
        'recording_styles': machine.recording_styles, 'likelihoods': machine.likelihoods,
        'strength': machine.strength, 'layout': asdict(machine.layout), 'settings': asdict(machine.settings),
        'training_files': list(machine.training_files), 'history': list(machine.history)}
    arrays = {'weights': c.weights, 'reference': c.reference, 'basis': c.basis, 'variances': c.variances,
              'start': machine.start, 'trans': machine.trans, 'axes': machine.axes.astype(np.float32),
              'spectrum': machine.spectrum, 'styles': np.array(list(machine.styles.values())),
              'persistence': machine.persistence}
    arrays.update({f'generic_{name}': getattr(g, name) for name in em.Emission.__dataclass_fields__})
    arrays.update({f'path_{k}': path for k, path in enumerate(machine.recordings.values())})
    if machine.space is not None:
        for part, entries in zip((header, arrays), machine.space.entries()):
            part.update(entries)
    save_model(path, KIND, json.loads(json.dumps(header)), arrays)


def load(path):
    """Read a model file written by `save`.

    Raises
    ------
    ModelError
        If it is not a style machine or damaged.
    """
    header, arrays = load_model(path, KIND)
    return from_arrays(header, arrays)


def from_arrays(header, arrays):
    """Build the machine from what `load_model` returns."""
    try:
        coordinates = Coordinates(tuple(header['joint_names']), tuple(header['units']), header['rate_hz'],
                                  arrays['weights'], arrays['reference'], arrays['basis'], header['leading'],
                                  arrays['variances'])
        generic = em.Emission(**{name: arrays[f'generic_{name}'] for name in em.Emission.__dataclass_fields__})
        machine = StyleMachine(
            coordinates, arrays['start'], arrays['trans'], generic, em.Layout(**header['layout']),
            arrays['axes'].astype(float), arrays['spectrum'], dict(zip(header['style_names'], arrays['styles'])),
            {name: arrays[f'path_{k}'] for k, name in enumerate(header['recordings'])}, header['recording_styles'],
            header['likelihoods'], header['strength'], arrays['persistence'], Settings(**header['settings']),
            tuple(header['training_files']), tuple(header['history']), read_space(header, arrays))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ModelError(f'the style machine lacks or does not know {error}: train it again') from None
    if machine.axes.shape[1] != len(machine.layout.pack(generic)):
        raise ModelError('the axes of the style machine do not fit its states: train it again')
    return machine
