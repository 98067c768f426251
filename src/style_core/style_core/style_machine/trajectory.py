"""Most likely trajectory for given state occupancies: the block-tridiagonal system of Brand and Hertzmann (2000), F.

With position y_t, velocity y_t - y_(t-1) and K_i^-1 = [[A, B], [C, D]], the exponent of eq. 20 has for every frame t
the coefficient A + B + C + D on y_t y_t, D on y_(t-1) y_(t-1) and -(B + D) between y_t and y_(t-1), each weighted by
the occupancies of frame t: eq. 21. The first frame has no velocity; integrating its y_0 out (eq. 22) leaves the
marginal of the position.
"""
from dataclasses import dataclass

import numpy as np

from style_core.errors import ModelError
from style_core.style_machine import _trajectory

__all__ = ['Information', 'information', 'mix', 'trajectory', 'refine_means']


@dataclass(frozen=True, eq=False)
class Information:
    """Coefficients of eq. 21 for each of M states (or frames): leading coordinates as blocks, the others as scalars.

    ``own`` = A + B + C + D, ``cross`` = B + D, ``previous`` = D, all (M, q, q); ``ahead`` = F and ``behind`` = E,
    (M, q); ``first`` (M, q, q) and ``first_ahead`` (M, q) of a frame without a velocity; the same with ``_tail``,
    all (M, D - q).
    """

    own: np.ndarray
    cross: np.ndarray
    previous: np.ndarray
    ahead: np.ndarray
    behind: np.ndarray
    first: np.ndarray
    first_ahead: np.ndarray
    own_tail: np.ndarray
    cross_tail: np.ndarray
    previous_tail: np.ndarray
    ahead_tail: np.ndarray
    behind_tail: np.ndarray
    first_tail: np.ndarray
    first_ahead_tail: np.ndarray


def information(emission):
    """Coefficients of every state of an emission, mean pose included."""
    q = emission.leading
    position = emission.positions + emission.pose
    precision = np.linalg.inv(emission.covs)
    precision = 0.5 * (precision + precision.transpose(0, 2, 1))
    a, b, c, d = precision[:, :q, :q], precision[:, :q, q:], precision[:, q:, :q], precision[:, q:, q:]
    x, dx = position[:, :q, None], emission.velocities[:, :q, None]
    behind = (c @ x + d @ dx)[..., 0]
    ahead = (a @ x + b @ dx)[..., 0] + behind
    first = np.linalg.inv(emission.covs[:, :q, :q])
    p_t, c_t, v_t = emission.tails[..., 0, 0], emission.tails[..., 0, 1], emission.tails[..., 1, 1]
    determinant = p_t * v_t - c_t * c_t
    a_t, b_t, d_t = v_t / determinant, -c_t / determinant, p_t / determinant
    x_t, dx_t = position[:, q:], emission.velocities[:, q:]
    behind_t = b_t * x_t + d_t * dx_t
    first_t = 1.0 / p_t
    arrays = (a + b + c + d, b + d, d, ahead, behind, first, (first @ x)[..., 0],
              a_t + 2 * b_t + d_t, b_t + d_t, d_t, a_t * x_t + b_t * dx_t + behind_t, behind_t, first_t, first_t * x_t)
    return Information(*(np.ascontiguousarray(array) for array in arrays))


def mix(known, weights):
    """Coefficients weighted by occupancies: weights (T, M) -> Information of T frames."""
    return Information(*(np.ascontiguousarray(np.tensordot(weights, array, axes=1)) for array in vars(known).values()))


def trajectory(known, content):
    """Most likely positions (20-23), exactly, in time and memory proportional to the number of frames.

    Parameters
    ----------
    known : Information
        Of every state.
    content : ndarray
        State of each frame (int, shape (T,)) or occupancies (shape (T, M), rows sum to 1).

    Returns
    -------
    ndarray, shape (T, D)
        Coordinates.

    Raises
    ------
    ModelError
        If there is no frame, or the system is not positive definite.
    """
    content = np.asarray(content)
    if not len(content):
        raise ModelError('no frames to synthesise')
    if content.ndim == 2:
        known, index = mix(known, content), np.arange(len(content))
    else:
        index = content
        if index.min() < 0 or index.max() >= len(known.own):
            raise ModelError(f'states must lie in 0 .. {len(known.own) - 1}')
    rhs, rhs_tail = _right_hand_side(known, index)
    _solve(known, index, rhs, rhs_tail)
    return np.concatenate([rhs, rhs_tail], axis=1)


def _right_hand_side(known, index):
    sides = []
    for ahead, behind, first in ((known.ahead, known.behind, known.first_ahead),
                                 (known.ahead_tail, known.behind_tail, known.first_ahead_tail)):
        rhs = ahead[index]
        rhs[0] = first[index[0]]
        rhs[:-1] -= behind[index[1:]]
        sides.append(rhs)
    return sides


def _solve(known, index, rhs, rhs_tail):
    n_frames, q = rhs.shape
    index = np.ascontiguousarray(index, dtype=np.intc)
    if q and _trajectory.solve_trajectory(known.own, known.cross, known.previous, index, known.first[index[0]], rhs,
                                          np.empty((n_frames, q, q)), np.empty((q, q)), np.empty((q, q)),
                                          np.empty(q)):
        raise ModelError('the trajectory is not determined: a covariance is singular')
    m = rhs_tail.shape[1]
    if m:
        _trajectory.solve_scalars(known.own_tail, known.cross_tail, known.previous_tail, index,
                                  known.first_tail[index[0]], rhs_tail, np.empty((n_frames, m)), np.empty(m))


def refine_means(emission, contents, targets, ridge=0.05, iterations=40, tolerance=1e-6):
    """Means of positions and velocities that make the most likely trajectories fit recordings (end of F).

    The trajectory is linear in the means, Y = L^-1 G M. This minimises
    ``|Y - L^-1 G M|^2 + ridge * N_i |M - M_0|^2`` by conjugate gradients, preconditioned by the occupancies N_i;
    the ridge towards the entropic means M_0 is the paper's caution against fitting the training data perfectly.

    Parameters
    ----------
    emission : Emission
    contents : list of ndarray
        States or occupancies of each recording.
    targets : list of ndarray, shape (T, D)
        Coordinates with the mean pose of ``emission`` removed; no NaN.
    ridge : float
    iterations : int
    tolerance : float
        Relative gradient at which to stop.

    Returns
    -------
    positions, velocities : ndarray, shape (N, D)
    """
    known = information(emission)
    n, d = emission.positions.shape
    q = emission.leading
    precision, tail = np.linalg.inv(emission.covs), np.linalg.inv(emission.tails)
    first = known.first
    weights = [np.eye(n)[content] if np.ndim(content) == 1 else np.asarray(content) for content in contents]
    systems = [mix(known, weight) for weight in weights]
    occupancy = sum(weight.sum(axis=0) for weight in weights) + 1e-9
    typical = np.sqrt((emission.velocities ** 2).mean() / ((emission.positions ** 2).mean() + 1e-300) + 1e-12)
    scale = np.concatenate([np.ones(d), np.full(d, typical)])[None, :] / np.sqrt(occupancy)[:, None]

    def sources(means):
        """E, F and the first frame's part as linear functions of the means (N, 2 D)."""
        x, dx = means[:, :d], means[:, d:]
        lead = np.einsum('nij,nj->ni', precision, np.concatenate([x[:, :q], dx[:, :q]], axis=1))
        side = np.einsum('nmij,nmj->nmi', tail, np.stack([x[:, q:], dx[:, q:]], axis=-1))
        behind = np.concatenate([lead[:, q:], side[..., 1]], axis=1)
        ahead = np.concatenate([lead[:, :q], side[..., 0]], axis=1) + behind
        start = np.concatenate([np.einsum('nij,nj->ni', first, x[:, :q]), known.first_tail * x[:, q:]], axis=1)
        return ahead, behind, start

    def back(ahead, behind, start):
        """The adjoint of `sources`."""
        along = np.concatenate([ahead[:, :q], ahead[:, :q] + behind[:, :q]], axis=1)
        lead = np.einsum('nji,nj->ni', precision, along)
        side = np.einsum('nmji,nmj->nmi', tail, np.stack([ahead[:, q:], ahead[:, q:] + behind[:, q:]], axis=-1))
        x = np.concatenate([lead[:, :q] + np.einsum('nji,nj->ni', first, start[:, :q]),
                            side[..., 0] + known.first_tail * start[:, q:]], axis=1)
        return np.concatenate([x, np.concatenate([lead[:, q:], side[..., 1]], axis=1)], axis=1)

    def solve(system, rhs):
        lead, side = np.ascontiguousarray(rhs[:, :q]), np.ascontiguousarray(rhs[:, q:])
        _solve(system, np.arange(len(rhs)), lead, side)
        return np.concatenate([lead, side], axis=1)

    def forward(means):
        ahead, behind, start = sources(means)
        outputs = []
        for weight, system in zip(weights, systems):
            rhs = weight @ ahead
            rhs[0] = weight[0] @ start
            rhs[:-1] -= weight[1:] @ behind
            outputs.append(solve(system, rhs))
        return outputs

    def adjoint(residuals):
        total = 0.0
        for residual, weight, system in zip(residuals, weights, systems):
            u = solve(system, residual)  # L is symmetric
            total = total + back(weight[1:].T @ u[1:], -(weight[1:].T @ u[:-1]), np.outer(weight[0], u[0]))
        return total

    base = np.concatenate([emission.positions, emission.velocities], axis=1)
    pull = ridge * occupancy[:, None] * scale ** 2 / np.concatenate([np.ones(d), np.full(d, typical ** 2)])

    def normal(z):
        return scale * adjoint(forward(scale * z)) + pull * z

    residual = scale * adjoint([target - output for target, output in zip(targets, forward(base))])
    z, direction, norm = np.zeros_like(base), residual.copy(), (residual ** 2).sum()
    stop = tolerance ** 2 * norm
    for _ in range(iterations):
        if norm <= stop:
            break
        image = normal(direction)
        step = norm / (direction * image).sum()
        z += step * direction
        residual -= step * image
        new = (residual ** 2).sum()
        direction = residual + new / norm * direction
        norm = new
    result = base + scale * z
    return result[:, :d], result[:, d:]
