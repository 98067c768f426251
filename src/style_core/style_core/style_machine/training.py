"""Training of a stylistic hidden Markov model: a generic model and one specific model a sequence, by annealed EM.

With occupancies gamma_s of sequence s, common transitions P and Gaussians theta* (generic) and theta_s (specific),
training descends on one function, eq. 1 of Brand and Hertzmann (2000) written out:

    J = sum_s ( E_gamma_s[-log p(X_s, S | theta_s)] + E_gamma_s[-log p(X_s, S | theta*)] - 2 H(gamma_s) )
        + (Z - T) (H(theta*) + 2 H(P)) + T/2 tr(pooled^-1 K*)  + Z' (1 - T') sum_s D(theta* || theta_s)

plus the sensor resolution's trace term. Every step minimises J over one group of its arguments with the others
fixed (docs/style_machine.md derives them), so J never rises while T and T' stay.
"""
import hashlib
import json
import time
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Tuple

import numpy as np

from style_core.errors import ModelError, UsageError
from style_core.formats.files import replacing
from style_core.hmm import Hmm, em_step, log_density, moments, occupancy, viterbi
from style_core.style_machine import entropic

__all__ = ['Settings', 'Family', 'Trained', 'train', 'initial_family']

_CHECKPOINT_EVERY_S = 5.0


@dataclass(frozen=True)
class Settings:
    """How to train. Strengths are in multiples of the mean occupancy of a state, so they suit any amount of data.

    Attributes
    ----------
    states : int
        At the start; extinction removes those that do not pay.
    entropy : float
        Z, exponent of the minimum-entropy prior of the generic model, frames.
    cross_entropy : float
        Z', pull of the generic on the specific models, in mean occupancies of a state in one sequence.
    temperature : float
        T at the start, in mean occupancies of a state in all sequences.
    anneal : int
        Iterations until T is a thousandth of its start; then it is zero.
    heat : float
        Largest T', between 0 (never heated) and 1 (the specific models are let go entirely), reached halfway.
    resolution : float
        Standard deviation that counts as noise, relative to the root mean square of the training coordinates.
    init : {'hint', 'frames', 'random'}
        A low-dimensional HMM on all sequences, every n-th frame, or random frames.
    hint_dimensions : int
        Coordinates that the low-dimensional HMM sees, each with its change.
    trim : bool
        Whether transitions and states are removed where that does not raise J.
    max_iterations : int
        Bound on iterations after annealing.
    tolerance : float
        Relative fall of J below which the iteration counts as converged.
    seed : int
    """

    states: int = 75
    entropy: float = 1.0
    cross_entropy: float = 0.02
    temperature: float = 0.1
    anneal: int = 40
    heat: float = 0.5
    resolution: float = 0.05
    init: str = 'hint'
    hint_dimensions: int = 3
    trim: bool = True
    max_iterations: int = 100
    tolerance: float = 1e-5
    seed: int = 0

    def __post_init__(self):
        if min(self.states, self.max_iterations, self.hint_dimensions) < 1 or self.anneal < 0:
            raise UsageError('states, max_iterations and hint_dimensions must be at least 1, anneal at least 0')
        if not (self.cross_entropy > 0 and self.resolution > 0 and self.temperature >= 0 and self.entropy >= 0):
            raise UsageError('cross_entropy and resolution must be positive, temperature and entropy not negative')
        if not 0 <= self.heat < 1:
            raise UsageError('heat must lie in [0, 1)')
        if self.init not in ('hint', 'frames', 'random'):
            raise UsageError(f"init must be 'hint', 'frames' or 'random', got {self.init!r}")


@dataclass(frozen=True, eq=False)
class Family:
    """The generic model, the specific models, and the transitions they share.

    ``start`` (N,), ``trans`` (N, N), ``means`` (N, d), ``covs`` (N, d, d), ``specific_means`` (S, N, d),
    ``specific_covs`` (S, N, d, d).
    """

    start: np.ndarray
    trans: np.ndarray
    means: np.ndarray
    covs: np.ndarray
    specific_means: np.ndarray
    specific_covs: np.ndarray

    @property
    def n_states(self):
        return len(self.start)

    def without(self, state):
        """Remove a state; the paths that led through it are kept as direct transitions."""
        kept = np.arange(self.n_states) != state
        leave = self.trans[state, kept]
        total = leave.sum()
        trans = self.trans[np.ix_(kept, kept)]
        if total > 0:
            trans = trans + np.outer(self.trans[kept, state], leave / total)
        rows = trans.sum(axis=1, keepdims=True)
        trans = np.where(rows > 0, trans / np.where(rows > 0, rows, 1.0), np.eye(len(trans)))
        start = self.start[kept] + (self.start[state] * leave / total if total > 0 else 0.0)
        start = start / start.sum() if start.sum() > 0 else np.full(len(start), 1.0 / len(start))
        return Family(start, trans, self.means[kept], self.covs[kept], self.specific_means[:, kept],
                      self.specific_covs[:, kept])


@dataclass(frozen=True, eq=False)
class Trained:
    """What training returns.

    Attributes
    ----------
    family : Family
    gammas : list of ndarray, shape (T_s, N)
    counts : list of ndarray, shape (N, N)
        Expected transitions.
    paths : list of ndarray of int, shape (T_s,)
        Most probable states of each sequence.
    history : list of dict
        Of each iteration: ``stage``, ``temperature``, ``heat``, ``objective``, ``rise`` (of the objective over the
        last iteration at that iteration's temperatures; never positive beyond rounding), ``states``, ``transitions``.
    """

    family: Family
    gammas: list
    counts: list
    paths: list
    history: list


class _Problem:
    """Data and fixed quantities of one training run, and the steps of the descent."""

    def __init__(self, sequences, settings, styles):
        self.sequences = sequences
        self.settings = settings
        self.styles = styles
        self.n_styles = max(styles) + 1
        self.present = [~np.isnan(x).any(axis=1) for x in sequences]
        whole = np.concatenate([x[rows] for x, rows in zip(sequences, self.present)])
        if not len(whole):
            raise ModelError('no frame of the sequences is complete')
        d = whole.shape[1]
        variance = max(float((whole ** 2).mean()), 1e-300)
        self.noise = settings.resolution ** 2 * variance
        self.occupied = sum(map(len, sequences)) / settings.states
        self.pooled_inverse = np.linalg.inv(whole.T @ whole / len(whole) + self.noise * np.eye(d))
        self.floor = self.noise * self.occupied * np.eye(d)
        self.specific_floor = self.floor / self.n_styles
        self.strength = settings.cross_entropy * self.occupied / self.n_styles
        # entropies count from the resolution, so that a state always has a positive coding length
        self.entropy_offset = -0.5 * d * np.log(self.noise)

    def expect(self, family):
        """E-step: occupancies minimising J, which weigh the specific and the generic model alike."""
        generic = log_density(np.concatenate(self.sequences), family.means, family.covs)
        found, begin = [], 0
        for x, s in zip(self.sequences, self.styles):
            own = log_density(x, family.specific_means[s], family.specific_covs[s])
            own += generic[begin:begin + len(x)]
            own *= 0.5
            found.append(occupancy(own, family.start, family.trans))
            begin += len(x)
        return found

    def priors(self, family, temperature, heat):
        """The part of J that depends on the parameters alone."""
        z, t = self.settings.entropy, temperature * self.occupied
        inverse = np.linalg.inv(family.covs)
        value = (z - t) * (entropic.gaussian_entropy(family.covs) + self.entropy_offset).sum()
        value += 2 * (z - t) * entropic.multinomial_entropy(family.trans).sum()
        value += 0.5 * t * np.einsum('ij,nji->', self.pooled_inverse, family.covs)
        value += 0.5 * np.einsum('nij,ji->', inverse, self.floor)
        value += self.strength * (1 - heat) * entropic.gaussian_divergence(
            family.means, family.covs, family.specific_means, family.specific_covs).sum()
        return value + 0.5 * np.einsum('snij,ji->', np.linalg.inv(family.specific_covs), self.specific_floor)

    def objective(self, family, found, temperature, heat):
        return self.priors(family, temperature, heat) - 2 * sum(one.log_likelihood for one in found)

    def maximise(self, family, found, temperature, heat):
        """M-steps: generic on all statistics, then every specific model on its own."""
        t, strength = temperature * self.occupied, self.strength * (1 - heat)
        parts = [None] * self.n_styles
        for x, rows, one, s in zip(self.sequences, self.present, found, self.styles):
            part = moments(x[rows], one.gamma[rows])
            parts[s] = part if parts[s] is None else parts[s] + part
        total = parts[0]
        for part in parts[1:]:
            total = total + part
        counts = sum(one.counts for one in found)
        start = sum(one.gamma[0] for one in found)
        trans = entropic.multinomial_map(counts, self.settings.entropy - t, family.trans)
        means, covs = entropic.generic_map(
            total, self.settings.entropy, t, self.pooled_inverse, family.specific_means, family.specific_covs, strength,
            self.floor, family.covs)
        specific = [entropic.specific_map(part, means, covs, strength, self.specific_floor) for part in parts]
        return Family(start / start.sum(), trans, means, covs, np.stack([one[0] for one in specific]),
                      np.stack([one[1] for one in specific]))

    def temperatures(self, iteration):
        """T and T' of an annealing iteration: exponential decay; one smooth rise and fall."""
        settings = self.settings
        decay = 10.0 ** (-3.0 / max(settings.anneal, 1))
        progress = iteration / max(settings.anneal, 1)
        bump = np.sin(np.pi * np.clip((progress - 0.25) / 0.75, 0, 1)) ** 2
        return settings.temperature * decay ** iteration, settings.heat * bump

    def trim_transitions(self, family, found):
        """Drop the transitions that are hardly used, as many as J allows; returns family, expectations, how many."""
        counts = sum(one.counts for one in found)
        before = self.objective(family, found, 0.0, 0.0)
        row, column = np.nonzero((family.trans > 0) & (counts < 1.0))
        order = np.argsort(counts[row, column], kind='stable')
        row, column = row[order], column[order]
        size = len(row)
        while size:
            trans = family.trans.copy()
            trans[row[:size], column[:size]] = 0.0
            sums = trans.sum(axis=1, keepdims=True)
            trans = np.where(sums > 0, trans / np.where(sums > 0, sums, 1.0), family.trans)
            trial = replace(family, trans=trans)
            try:
                expected = self.expect(trial)
            except ModelError:  # some sequence has no path any more
                size //= 2
                continue
            if self.objective(trial, expected, 0.0, 0.0) <= before:
                return trial, expected, int((family.trans > 0).sum() - (trans > 0).sum())
            size //= 2
        return family, found, 0

    def trim_states(self, family, found, tries=8):
        """Remove the least used states one at a time where J, after one iteration without them, is no higher."""
        removed = 0
        refused = 0
        while family.n_states > 1 and refused < tries:
            before = self.objective(family, found, 0.0, 0.0)
            weight = sum(one.gamma.sum(axis=0) for one in found)
            state = int(np.argsort(weight, kind='stable')[refused]) if refused < family.n_states else None
            if state is None:
                break
            try:
                trial = family.without(state)
                trial = self.maximise(trial, self.expect(trial), 0.0, 0.0)
                expected = self.expect(trial)
            except ModelError:
                refused += 1
                continue
            if self.objective(trial, expected, 0.0, 0.0) <= before:
                family, found = trial, expected
                removed += 1
            else:
                refused += 1
        return family, found, removed


def initial_family(sequences, settings, styles):
    """Initial models (4.2): transitions declining off the diagonal; Gaussians on frames, or from a hint."""
    n_styles = max(styles) + 1
    rng = np.random.default_rng(settings.seed)
    whole = np.concatenate([x[~np.isnan(x).any(axis=1)] for x in sequences])
    if not len(whole):
        raise ModelError('no frame of the sequences is complete')
    n, d = settings.states, whole.shape[1]
    noise = settings.resolution ** 2 * max(float((whole ** 2).mean()), 1e-300)
    gap = np.arange(n)[None, :] - np.arange(n)[:, None]
    trans = np.exp(-np.abs(gap) / 2.0) + 1e-3
    trans /= trans.sum(axis=1, keepdims=True)
    start = np.full(n, 1.0 / n)
    # as wide as the data between neighbouring centres: the pooled covariance shrunk to one of n cells
    cov = np.tile(whole.T @ whole / len(whole) * n ** (-2.0 / min(d, 3)) + noise * np.eye(d), (n, 1, 1))
    if settings.init == 'random':
        means = whole[rng.integers(len(whole), size=n)]
    else:
        means = whole[np.linspace(0, len(whole) - 1, n).astype(int)]
    family = Family(start, trans, means, cov, np.tile(means, (n_styles, 1, 1)), np.tile(cov, (n_styles, 1, 1, 1)))
    return _hinted(family, sequences, settings, styles, rng) if settings.init == 'hint' else family


def _hinted(family, sequences, settings, styles, rng):
    """Read Gaussians and transitions off a low-dimensional HMM of all sequences.

    It sees the first coordinates and their changes, each style scaled to the same spread: where in its own range a
    motion is and which way it goes, which is what the styles have in common.
    """
    low = min(settings.hint_dimensions, sequences[0].shape[1])
    extended = []
    for x in sequences:
        change = np.gradient(x[:, :low], axis=0) if len(x) > 1 else np.zeros((len(x), low))
        extended.append(np.concatenate([x[:, :low], change], axis=1))
    for s in range(max(styles) + 1):
        own = np.concatenate([x for x, style in zip(extended, styles) if style == s])
        spread = np.sqrt([np.nanmean(np.append(own[:, part] ** 2, 1e-12)) for part in (slice(low), slice(low, None))])
        for x, style in zip(extended, styles):
            if style == s:
                x /= np.repeat(spread, low)
    hint = _shared_hmm(extended, family.n_states, rng)
    parts = [None] * (max(styles) + 1)
    for x, seen, s in zip(sequences, extended, styles):
        found = occupancy(log_density(seen, hint.means, hint.covs), hint.start, hint.trans)
        rows = ~np.isnan(x).any(axis=1)
        part = moments(x[rows], found.gamma[rows])
        parts[s] = part if parts[s] is None else parts[s] + part
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    means, covs = entropic.specific_map(total, np.zeros_like(family.means), family.covs, 1.0, 0.0)
    specific = [entropic.specific_map(part, means, covs, 1.0, 0.0) for part in parts]
    n = family.n_states
    return Family(0.5 * hint.start + 0.5 / n, 0.95 * hint.trans + 0.05 / n, means, covs,
                  np.stack([one[0] for one in specific]), np.stack([one[1] for one in specific]))


def _shared_hmm(sequences, n, rng):
    """An HMM whose centres start from k-means over all sequences: they share a state where they pass the same place."""
    points = np.concatenate(sequences)
    points = points[~np.isnan(points).any(axis=1)]
    chosen = [points[int(rng.integers(len(points)))]]
    nearest = ((points - chosen[0]) ** 2).sum(axis=1)
    while len(chosen) < n:
        total = nearest.sum()
        pick = int(np.searchsorted(np.cumsum(nearest), rng.random() * total)) if total > 0 else len(chosen)
        chosen.append(points[pick % len(points)])
        nearest = np.minimum(nearest, ((points - chosen[-1]) ** 2).sum(axis=1))
    centres = np.array(chosen)
    for _ in range(10):
        label = np.argmin((centres ** 2).sum(axis=1) - 2 * points @ centres.T, axis=1)
        for k in range(n):
            if (label == k).any():
                centres[k] = points[label == k].mean(axis=0)
    d = points.shape[1]
    model = Hmm(np.full(n, 1.0 / n), np.full((n, n), 0.5 / n) + 0.5 * np.eye(n), centres,
                np.tile(np.eye(d) * n ** (-2.0 / min(d, 3)), (n, 1, 1)))
    for _ in range(8):
        model, _ = em_step(model, sequences, floor=0.05 * n ** (-2.0 / min(d, 3)))
    return model


def train(sequences, settings, styles=None, checkpoint=None, progress=None, family=None):
    """Train a family of models.

    Parameters
    ----------
    sequences : list of ndarray, shape (T_s, d)
        Training coordinates of each recording, its mean removed; a frame with NaN counts as not seen.
    settings : Settings
    styles : sequence of int, optional
        Which specific model each sequence belongs to, 0 .. S-1; one each by default. A recording and its mirror
        image, or several takes of one performer, share a style.
    checkpoint : path-like, optional
        State of the run, written every few seconds and deleted by nobody: a run that finds it goes on from there
        and ends with the same bits. One of other data or settings is refused.
    progress : callable, optional
        Called with each row of the history.
    family : Family, optional
        Start from here instead of `initial_family`.

    Returns
    -------
    Trained

    Raises
    ------
    ModelError
        If there is no complete frame, or the checkpoint belongs to another run.
    """
    styles = tuple(range(len(sequences))) if styles is None else tuple(int(s) for s in styles)
    if not sequences or sorted(set(styles)) != list(range(len(set(styles)))) or len(styles) != len(sequences):
        raise ModelError('styles must number the sequences 0, 1, ... without gaps, one number a sequence')
    problem = _Problem(sequences, settings, styles)
    fingerprint = _fingerprint(sequences, styles, settings)
    state = _load_checkpoint(checkpoint, fingerprint)
    if state is None:
        family = initial_family(sequences, settings, styles) if family is None else family
        state = _Run(family, 'anneal' if settings.anneal else 'settle', 0, 0, ())
    found = problem.expect(state.family)
    saved = time.monotonic()
    while state.stage != 'done':
        state, found = _advance(problem, state, found)
        if progress is not None:
            progress(state.history[-1])
        if checkpoint is not None and time.monotonic() - saved > _CHECKPOINT_EVERY_S:
            _save_checkpoint(checkpoint, state, fingerprint)
            saved = time.monotonic()
    if checkpoint is not None:
        _save_checkpoint(checkpoint, state, fingerprint)
    paths = []
    generic = [log_density(x, state.family.means, state.family.covs) for x in sequences]
    for x, s, common in zip(sequences, styles, generic):
        own = log_density(x, state.family.specific_means[s], state.family.specific_covs[s])
        paths.append(viterbi(0.5 * (own + common), state.family.start, state.family.trans)[0])
    return Trained(state.family, [one.gamma for one in found], [one.counts for one in found], paths,
                   list(state.history))


@dataclass(frozen=True, eq=False)
class _Run:
    """Where a run stands: ``iteration`` counts within annealing, ``settled`` those after it."""

    family: Family
    stage: str
    iteration: int
    settled: int
    history: Tuple[dict, ...]


def _advance(problem, run, found):
    """One iteration (or one round of trimming)."""
    settings = problem.settings
    if run.stage == 'trim':
        before = problem.objective(run.family, found, 0.0, 0.0)
        family, found, arcs = problem.trim_transitions(run.family, found)
        family, found, states = problem.trim_states(family, found)
        after = problem.objective(family, found, 0.0, 0.0)
        row = _row('trim', 0.0, 0.0, after, after - before, family)
        again = (states or arcs) and run.settled < settings.max_iterations
        return _Run(family, 'settle' if again else 'done', 0, run.settled, (*run.history, row)), found
    temperature, heat = problem.temperatures(run.iteration) if run.stage == 'anneal' else (0.0, 0.0)
    before = problem.objective(run.family, found, temperature, heat)
    family = problem.maximise(run.family, found, temperature, heat)
    found = problem.expect(family)
    after = problem.objective(family, found, temperature, heat)
    row = _row(run.stage, temperature, heat, after, after - before, family)
    history = (*run.history, row)
    if run.stage == 'anneal':
        stage = 'settle' if run.iteration + 1 >= settings.anneal else 'anneal'
        return _Run(family, stage, run.iteration + 1 if stage == 'anneal' else 0, 0, history), found
    settled = run.settled + 1
    converged = before - after <= settings.tolerance * abs(after)
    stage = 'settle'
    if converged or settled >= settings.max_iterations:
        stage = 'trim' if settings.trim else 'done'
    return _Run(family, stage, run.iteration + 1, settled, history), found


def _row(stage, temperature, heat, objective, rise, family):
    return {'stage': stage, 'temperature': float(temperature), 'heat': float(heat), 'objective': float(objective),
            'rise': float(rise), 'states': int(family.n_states), 'transitions': int((family.trans > 0).sum())}


def _fingerprint(sequences, styles, settings):
    digest = hashlib.sha256(json.dumps([asdict(settings), styles], sort_keys=True).encode())
    for x in sequences:
        digest.update(np.ascontiguousarray(x).tobytes())
    return digest.hexdigest()


def _save_checkpoint(path, run, fingerprint):
    record = {'fingerprint': fingerprint, 'stage': run.stage, 'iteration': run.iteration,
              'settled': run.settled, 'history': run.history}
    with replacing(path, 'wb') as stream:
        np.savez(stream, record=np.array(json.dumps(record)), **vars(run.family))


def _load_checkpoint(path, fingerprint):
    if path is None or not Path(path).exists():
        return None
    try:
        with np.load(path, allow_pickle=False) as archive:
            record = json.loads(str(archive['record'][()]))
            family = Family(**{name: archive[name] for name in Family.__dataclass_fields__})
    except Exception as error:
        raise ModelError(f'checkpoint {path} is damaged ({error}); delete it to start again') from None
    if record['fingerprint'] != fingerprint:
        raise ModelError(f'checkpoint {path} belongs to other recordings or settings; delete it to start again')
    return _Run(family, record['stage'], record['iteration'], record['settled'], tuple(record['history']))
