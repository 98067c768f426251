"""What a style says about poses: each state's positions and velocities; and the vector that is a style."""
from dataclasses import dataclass

import numpy as np

from style_core.hmm import Moments, moments

__all__ = ['Emission', 'Layout', 'Statistics', 'add_statistics', 'drawn_gaussians', 'interpolate', 'layout_for',
           'remap_generic', 'remap_specific', 'velocity_moments']

_REFERENCE_FRAMES = 15.0   # weight of what a covariance is drawn towards, frames: few frames make no covariance
_REFERENCE_VISITS = 1.0


@dataclass(frozen=True, eq=False)
class Emission:
    """One style of a machine with N states, D coordinates (`Coordinates`), the first q of them leading.

    Each state has a Gaussian over positions and velocities (change a frame) of all coordinates: full covariance
    among the leading ones, a 2 x 2 covariance for each of the others, none in between.

    Attributes
    ----------
    pose : ndarray, shape (D,)
        Mean pose of the style, coordinates.
    positions, velocities : ndarray, shape (N, D)
        Means; positions relative to the mean pose.
    covs : ndarray, shape (N, 2 q, 2 q)
        Of leading positions, then leading velocities.
    tails : ndarray, shape (N, D - q, 2, 2)
    dwell : ndarray, shape (N,)
        Mean stay in each state, frames.
    """

    pose: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    covs: np.ndarray
    tails: np.ndarray
    dwell: np.ndarray

    @property
    def leading(self):
        return self.covs.shape[1] // 2

    def position_covariances(self):
        """Covariance of all coordinates' positions, shape (N, D, D)."""
        n, d = self.positions.shape
        q = self.leading
        full = np.zeros((n, d, d))
        full[:, :q, :q] = self.covs[:, :q, :q]
        rest = np.arange(q, d)
        full[:, rest, rest] = self.tails[:, :, 0, 0]
        return full


def interpolate(one, other, share):
    """Means, covariances and dwell times between two styles: share 0 is ``one``, 1 the other."""
    return Emission(*((1 - share) * getattr(one, name) + share * getattr(other, name)
                      for name in Emission.__dataclass_fields__))


@dataclass(frozen=True, eq=False)
class Statistics:
    """Sums over the frames of one style, from which its emission follows."""

    lead: Moments
    tail: Moments
    occupancy: np.ndarray
    visits: np.ndarray


def velocity_moments(coordinates, gamma, counts, leading):
    """Statistics of one sequence.

    Parameters
    ----------
    coordinates : ndarray, shape (T, D)
        Mean pose removed. The first frame, one with NaN and the one after it have no velocity and are left out.
    gamma : ndarray, shape (T, N)
    counts : ndarray, shape (N, N)
        Expected transitions.
    leading : int
    """
    n, d = gamma.shape[1], coordinates.shape[1]
    change = np.diff(coordinates, axis=0, prepend=np.full((1, d), np.nan))
    whole = ~np.isnan(coordinates + change).any(axis=1)
    x, dx, g = coordinates[whole], change[whole], gamma[whole]
    lead = moments(np.concatenate([x[:, :leading], dx[:, :leading]], axis=1), g)
    y, dy = x[:, leading:], dx[:, leading:]
    weight = g.sum(axis=0)
    total = np.stack([g.T @ y, g.T @ dy], axis=-1)
    square = np.empty((n, d - leading, 2, 2))
    square[..., 0, 0], square[..., 1, 1] = g.T @ (y * y), g.T @ (dy * dy)
    square[..., 0, 1] = square[..., 1, 0] = g.T @ (y * dy)
    tail = Moments(np.repeat(weight, d - leading), total.reshape(-1, 2), square.reshape(-1, 2, 2))
    occupancy = gamma.sum(axis=0)
    return Statistics(lead, tail, occupancy, np.maximum(occupancy - np.diag(counts), 0.0))


def add_statistics(parts):
    """Sum of several sequences' statistics."""
    total = parts[0]
    for part in parts[1:]:
        total = Statistics(total.lead + part.lead, total.tail + part.tail, total.occupancy + part.occupancy,
                           total.visits + part.visits)
    return total


def remap_generic(parts, pose, strength, noise):
    """Generic emission (eqs. 9, 10) from the statistics of all styles.

    Means are those of all frames. Covariances are taken around each style's own means: what styles differ in is said
    by v, and counting it once more as spread would leave the generic model slack. They are drawn towards their average
    over the states, because a few frames make no covariance.

    Parameters
    ----------
    parts : list of Statistics
        Of each style.
    pose : ndarray, shape (D,)
    strength : float
        Z' of the styles' means, frames.
    noise : (float, float)
        Variances of the resolution of leading positions and velocities.
    """
    total = add_statistics(parts)
    n = len(total.occupancy)
    lead_means, lead_covs = _within(total.lead, [part.lead for part in parts], strength,
                                    np.repeat(noise, total.lead.total.shape[1] // 2))
    m = len(total.tail.weight) // n
    tail_means, tails = np.zeros((n, m, 2)), np.zeros((n, m, 2, 2))
    for k in range(m):  # every trailing coordinate has an average of its own
        own = np.arange(k, n * m, m)
        tail_means[:, k], tails[:, k] = _within(total.tail.keep(own), [part.tail.keep(own) for part in parts], strength,
                                                np.asarray(noise) * 1e-2)
    q = lead_means.shape[1] // 2
    dwell = (total.occupancy + 1e-9) / np.maximum(total.visits, 1e-9)
    return Emission(pose, np.concatenate([lead_means[:, :q], tail_means[..., 0]], axis=1),
                    np.concatenate([lead_means[:, q:], tail_means[..., 1]], axis=1), lead_covs, tails,
                    np.maximum(dwell, 1.0))


def _within(total, parts, strength, noise):
    means = total.total / np.maximum(total.weight, 1e-12)[:, None]
    scatter = sum(part.scatter((part.total + strength * means) / (part.weight + strength)[:, None]) for part in parts)
    average = scatter.sum(axis=0) / max(total.weight.sum(), 1e-12) + np.diag(noise)
    covs = (scatter + _REFERENCE_FRAMES * average) / (total.weight + _REFERENCE_FRAMES)[:, None, None]
    return means, 0.5 * (covs + covs.transpose(0, 2, 1))


def drawn_gaussians(stats, means, covs, strength):
    """Gaussians of one style: means drawn towards the generic ones with Z' (eq. 16), covariances (eq. 17) at least
    as firmly as `_REFERENCE_FRAMES`.

    Parameters
    ----------
    stats : Moments
    means, covs : ndarray, shapes (N, d), (N, d, d)
        Generic.
    strength : float
        Z', frames.
    """
    own = (stats.total + strength * means) / (stats.weight + strength)[:, None]
    pull = max(strength, _REFERENCE_FRAMES)
    result = (stats.scatter(own) + pull * covs) / (stats.weight + pull)[:, None, None]
    return own, 0.5 * (result + result.transpose(0, 2, 1))


def remap_specific(statistics, pose, generic, strength):
    """Emission of one style, drawn towards the generic one."""
    n, d = generic.positions.shape
    q = generic.leading
    lead_means, lead_covs = drawn_gaussians(
        statistics.lead, np.concatenate([generic.positions[:, :q], generic.velocities[:, :q]], axis=1), generic.covs,
        strength)
    tail_reference = np.stack([generic.positions[:, q:], generic.velocities[:, q:]], axis=-1)
    tail_means, tails = drawn_gaussians(statistics.tail, tail_reference.reshape(-1, 2), generic.tails.reshape(-1, 2, 2),
                                        strength)
    tail_means = tail_means.reshape(n, d - q, 2)
    dwell = ((statistics.occupancy + _REFERENCE_VISITS * generic.dwell)
             / (statistics.visits + _REFERENCE_VISITS))
    return Emission(pose, np.concatenate([lead_means[:, :q], tail_means[..., 0]], axis=1),
                    np.concatenate([lead_means[:, q:], tail_means[..., 1]], axis=1), lead_covs,
                    tails.reshape(n, d - q, 2, 2), np.maximum(dwell, 1.0))


@dataclass(frozen=True)
class Layout:
    """How an emission becomes a vector (4.3): means, square-root covariances, dwell times, mean pose.

    Everything is brought to the units of a position: velocities are multiplied by a typical time in frames, log
    dwell times (so that no extrapolated stay is negative) by a typical distance; the mean pose, which shifts every
    state, counts as half a shift of all states.

    Attributes
    ----------
    time : float
        Frames.
    distance : float
    least_lead, least_tail : float
        Smallest eigenvalue a reconstructed covariance may have.
    """

    time: float
    distance: float
    least_lead: float
    least_tail: float

    def pack(self, emission):
        """Emission to vector, shape (M,)."""
        n, _d = emission.positions.shape
        q = emission.leading
        scale = self._scale(q)
        upper = np.triu_indices(2 * q)
        tail_scale = np.sqrt(np.array([1.0, self.time, self.time ** 2]))
        tails = emission.tails[..., [0, 0, 1], [0, 1, 1]]
        return np.concatenate([
            emission.positions.ravel(), (emission.velocities * self.time).ravel(),
            (_root(emission.covs) * scale)[:, upper[0], upper[1]].ravel(), (_root(tails) * tail_scale).ravel(),
            np.log(emission.dwell) * self.distance, emission.pose * 0.5 * np.sqrt(n)])

    def unpack(self, vector, n, d, q):
        """Vector to emission; covariances that came out indefinite get the absolute values of their eigenvalues."""
        size = [n * d, n * d, n * q * (2 * q + 1), n * (d - q) * 3, n, d]
        parts = np.split(vector, np.cumsum(size)[:-1])
        upper = np.triu_indices(2 * q)
        roots = np.zeros((n, 2 * q, 2 * q))
        roots[:, upper[0], upper[1]] = parts[2].reshape(n, -1)
        covs = _square(roots / self._scale(q))
        covs = covs + np.triu(covs, 1).transpose(0, 2, 1)
        tail_scale = np.sqrt(np.array([1.0, self.time, self.time ** 2]))
        tails = _square(parts[3].reshape(n, d - q, 3) / tail_scale)[..., [[0, 1], [1, 2]]]
        return Emission(parts[5] / (0.5 * np.sqrt(n)), parts[0].reshape(n, d), parts[1].reshape(n, d) / self.time,
                        _definite(covs, self.least_lead), _definite(tails, self.least_tail),
                        np.maximum(np.exp(parts[4] / self.distance), 1.0))

    def weights(self, state_weights, d, q):
        """Spread a weight a state over the entries of a vector; the mean pose gets 1."""
        n = len(state_weights)
        return np.concatenate([np.repeat(state_weights, d), np.repeat(state_weights, d),
                               np.repeat(state_weights, q * (2 * q + 1)), np.repeat(state_weights, (d - q) * 3),
                               state_weights, np.ones(d)]) if n else np.empty(0)

    def _scale(self, q):
        unit = np.repeat([1.0, self.time], q)
        return np.sqrt(np.outer(unit, unit))


def layout_for(emissions):
    """The layout that suits the emissions of a family (the generic one first)."""
    generic = emissions[0]
    q = generic.leading
    diagonal = np.einsum('nii->i', generic.covs)
    spread = np.sqrt((generic.positions ** 2).mean() + 1e-300)
    time = np.sqrt(diagonal[:q].sum() + (generic.positions ** 2).sum()) / np.sqrt(
        diagonal[q:].sum() + (generic.velocities ** 2).sum() + 1e-300)
    least_lead = min(float(np.linalg.eigvalsh(one.covs).min()) for one in emissions)
    least_tail = min((float(np.linalg.eigvalsh(one.tails).min()) for one in emissions if one.tails.size), default=1.0)
    return Layout(float(time), float(spread), 0.1 * least_lead, 0.1 * least_tail)


def _root(values):
    return np.sign(values) * np.sqrt(np.abs(values))


def _square(roots):
    return roots * np.abs(roots)


def _definite(covs, least):
    if not covs.size:
        return covs
    values, vectors = np.linalg.eigh(covs)
    wrong = (values < least).any(axis=-1)
    values = np.maximum(np.abs(values), least)
    mended = (vectors * values[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return np.where(wrong[..., None, None], mended, covs)  # sound ones stay as they are, to the last bit

