"""The full filter's kernel against a dense extended Kalman filter over all states at once."""
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from style_core.phase_style.arrow_filter import ArrowFilter
from style_core.phase_style.basis_table import Table, tabulate
from style_core.phase_style.gaussian_process import PhaseProcess
from style_core.phase_style.parts import CYCLE, LEVEL, SMOOTH, Part


def made_table(rng, styles, channels, rhythmic=True):
    grid = np.linspace(0, 2 * np.pi if rhythmic else 1.0, 24, endpoint=not rhythmic)
    processes = [PhaseProcess(grid, rng.standard_normal((24, channels)) * 0.2, np.array([1.0, 2.0, 1e2]), rhythmic)
                 for _ in range(styles + 1)]
    return Table(tabulate(processes, rhythmic))


def made_filter(table, offset, fast, personal, noise, rates, acceleration, bounds):
    parts = [(Part(LEVEL, rates[0]), offset), (Part(SMOOTH, rates[1]), fast),
             *((Part(CYCLE, rates[2], k + 1), variance) for k, variance in enumerate(personal))]
    return ArrowFilter(table, parts, noise, rates[3], acceleration, bounds)


class Dense:
    """All states in one covariance: phase, velocity, z, then the residual states channel by channel."""

    def __init__(self, table, offset, fast, personal, noise, rates, acceleration):
        self.table, self.noise, self.rates, self.q = table, noise, rates, acceleration
        self.offset, self.fast, self.personal = offset, fast, personal
        self.m, self.n, self.channels = table.count + 1, 3 + 2 * len(personal), table.channels
        self.turn, self.age = 0, np.zeros(max(table.count - 1, 1))

    def start(self, phase, velocity, vp, vv):
        size = self.m + self.n * self.channels
        self.x, self.p = np.zeros(size), np.zeros((size, size))
        self.x[:2] = phase, velocity
        self.p[:self.m, :self.m] = np.diag([vp, vv] + [1.0] * (self.m - 2))
        for d in range(self.channels):
            spread = [self.offset[d], self.fast[d], self.fast[d] * self.rates[1] ** 2]
            spread += [v for k in range(len(self.personal)) for v in [self.personal[k, d]] * 2]
            at = self.block(d)
            self.p[at, at] = np.diag(spread)

    def block(self, d):
        return slice(self.m + self.n * d, self.m + self.n * (d + 1))

    def transition(self, dt, drift_ages):
        """F and Q of a time step; ``drift_ages`` has the time each style component drifts over."""
        size = len(self.x)
        f, q = np.eye(size), np.zeros((size, size))
        f[0, 1] = dt
        q[:2, :2] = self.q * np.array([[dt ** 3 / 3, dt ** 2 / 2], [dt ** 2 / 2, dt]])
        for j, age in enumerate(drift_ages):
            rho = np.exp(-self.rates[3] * age)
            f[2 + j, 2 + j], q[2 + j, 2 + j] = rho, 1 - rho ** 2
        lam = self.rates[1]
        g = np.exp(-lam * dt) * np.array([[1 + lam * dt, dt], [-lam ** 2 * dt, 1 - lam * dt]])
        s = np.diag([1, lam ** 2])
        for d in range(self.channels):
            at = self.block(d).start
            f[at, at] = np.exp(-self.rates[0] * dt)
            q[at, at] = self.offset[d] * (1 - f[at, at] ** 2)
            f[at + 1:at + 3, at + 1:at + 3] = g
            q[at + 1:at + 3, at + 1:at + 3] = self.fast[d] * (s - g @ s @ g.T)
            for k in range(2 * len(self.personal)):
                i = at + 3 + k
                f[i, i] = np.exp(-self.rates[2] * dt)
                q[i, i] = self.personal[k // 2, d] * (1 - f[i, i] ** 2)
        return f, q

    def observation(self):
        """Expected observation and its derivative by all states."""
        phase = self.x[0]
        value, slope = self.table.evaluate(phase)
        weight = np.concatenate([[1], self.x[2:self.m]])
        mean = weight @ value
        h = np.zeros((self.channels, len(self.x)))
        h[:, 0] = weight @ slope
        h[:, 2:self.m] = value[1:].T
        for d in range(self.channels):
            at = self.block(d)
            order = np.arange(1, len(self.personal) + 1)
            s = np.concatenate([[1, 1, 0], np.stack([np.cos(order * phase), np.sin(order * phase)], 1).ravel()])
            ds = np.concatenate([[0, 0, 0], np.stack([-order * np.sin(order * phase),
                                                      order * np.cos(order * phase)], 1).ravel()])
            h[d, at] = s
            mean[d] += s @ self.x[at]
            h[d, 0] += ds @ self.x[at]
        return mean, h

    def update(self, y, observed, dt):
        if dt > 0:
            ages = np.zeros(self.m - 2)
            if self.m > 2:
                self.age += dt
                drift = self.turn % (self.m - 2)
                ages[drift], self.age[drift] = self.age[drift], 0
                self.turn = drift + 1
            f, q = self.transition(dt, ages)
            self.x, self.p = f @ self.x, f @ self.p @ f.T + q
        mean, h = self.observation()
        h, error = h[observed], (y - mean)[observed]
        # noise is a density in time where samples come faster than the 60 Hz it was learned at
        thin = max(1.0, (1 / 60 - 1e-6) / dt) if dt > 0 else 1.0
        s = h @ self.p @ h.T + thin * np.diag(self.noise[observed])
        gain = np.linalg.solve(s, h @ self.p).T
        self.x = self.x + gain @ error
        self.p = self.p - gain @ h @ self.p
        squares = error @ np.linalg.solve(s, error)
        return squares, -0.5 * (squares + np.linalg.slogdet(2 * np.pi * s)[1])

    def marginal(self, d):
        index = np.r_[0:self.m, self.block(d)]
        return self.x[index], self.p[np.ix_(index, index)]


def both(rng, styles, channels, harmonics, acceleration=0.0, style_rate=0.0, rhythmic=True):
    table = made_table(rng, styles, channels, rhythmic)
    offset, fast, noise = rng.uniform(0.001, 0.05, (3, channels))
    personal = rng.uniform(0.001, 0.01, (harmonics, channels))
    rates = (0.3, 8.0, 0.1, style_rate)
    one = made_filter(table, offset, fast, personal, noise, rates, acceleration, (-100, 100))
    two = Dense(table, offset, fast, personal, noise, rates, acceleration)
    for filt in (one, two):
        filt.start(1.0 if rhythmic else 0.4, 2.0 if rhythmic else 0.1, 0.02, 0.3)
    return one, two


def run_both(one, two, rng, steps, share=0.6, first=0.0):
    channels = one.channels
    for step in range(steps):
        dt = first if step == 0 else rng.uniform(0.002, 0.05)
        observed = rng.random(channels) < share
        y = 0.4 * rng.standard_normal(channels)
        one.update(np.where(observed, y, np.nan), observed.astype(np.uint8), dt)
        squares, log_likelihood = two.update(y, observed, dt)
        two.x[0] = np.mod(two.x[0], 2 * np.pi) if one.table.rhythmic else two.x[0]
        if observed.any():
            assert one.innovation == pytest.approx(squares / observed.sum(), rel=1e-7)
            assert one.log_likelihood == pytest.approx(log_likelihood, rel=1e-7, abs=1e-7)


def assert_same_marginals(one, two):
    for d in range(one.channels):
        mean, covariance = one.marginal(d)
        want_mean, want_covariance = two.marginal(d)
        np.testing.assert_allclose(mean, want_mean, atol=1e-8)
        np.testing.assert_allclose(covariance, want_covariance, atol=1e-8)
        assert np.linalg.eigvalsh(covariance).min() > -1e-10


@given(st.integers(0, 10_000), st.integers(0, 3), st.integers(0, 2))
def test_exact_without_process_noise_on_the_common_state(seed, styles, harmonics):
    rng = np.random.default_rng(seed)
    one, two = both(rng, styles, 3, harmonics)
    run_both(one, two, rng, 8)
    assert_same_marginals(one, two)


@given(st.integers(0, 10_000), st.integers(0, 2), st.booleans())
def test_exact_for_one_channel_with_all_noise(seed, styles, rhythmic):
    rng = np.random.default_rng(seed)
    one, two = both(rng, styles, 1, 1 if rhythmic else 0, acceleration=0.5, style_rate=0.4, rhythmic=rhythmic)
    run_both(one, two, rng, 6 if rhythmic else 3, share=0.8)
    if rhythmic or 0.05 < one.state[0] < 0.95:
        assert_same_marginals(one, two)


@given(st.integers(0, 10_000))
def test_a_time_step_keeps_every_marginal(seed):
    """With process noise a step loses dependence between channels, but no marginal of common state and channel."""
    rng = np.random.default_rng(seed)
    one, two = both(rng, 2, 3, 1, acceleration=2.0, style_rate=1.0)
    run_both(one, two, rng, 1)                        # no time step yet: exact
    run_both(one, two, rng, 1, share=0.0, first=0.04)  # one step, nothing observed
    assert_same_marginals(one, two)


def test_stays_close_to_the_dense_filter_with_all_noise():
    rng = np.random.default_rng(5)
    table = made_table(rng, 2, 6)
    offset, fast, noise = np.full(6, 0.01), np.full(6, 0.005), np.full(6, 1e-4)
    personal = np.full((2, 6), 0.002)
    rates, q = (0.1, 6.0, 0.1, 0.1), 0.1
    one = made_filter(table, offset, fast, personal, noise, rates, q, (0, 20))
    two = Dense(table, offset, fast, personal, noise, rates, q)
    weight = np.concatenate([[1], rng.standard_normal(2)])
    shift = 0.1 * rng.standard_normal(6)
    for filt in (one, two):
        filt.start(0.2, 5.0, 0.1, 0.5)
    gap, spread = [], []
    for k in range(200):
        phase = 5.5 * k / 60
        y = weight @ table.evaluate(phase)[0] + shift + 0.01 * rng.standard_normal(6)
        seen = np.ones(6, bool) if k < 100 else np.arange(6) > 1
        one.update(y, seen.astype(np.uint8), 1 / 60 if k else 0.0)
        two.update(y, seen, 1 / 60 if k else 0.0)
        two.x[0] %= 2 * np.pi
        sd = np.sqrt(np.diag(two.p)[:4])
        gap.append(np.abs((one.state - two.x[:4] + np.array([np.pi, 0, 0, 0])) % (2 * np.pi)
                          - np.array([np.pi, 0, 0, 0]))[:1] / sd[:1])
        spread.append(np.sqrt(np.diag(one.covariance)) / sd)
    assert np.mean(gap) < 0.5
    assert 0.5 < np.median(spread) < 2


@given(st.integers(0, 10_000))
def test_masked_channels_have_no_influence(seed):
    rng = np.random.default_rng(seed)
    one, _ = both(rng, 2, 5, 1, 0.5, 0.2)
    two, _ = both(np.random.default_rng(seed), 2, 5, 1, 0.5, 0.2)
    for step in range(6):
        observed = rng.random(5) < 0.5
        y = 0.3 * rng.standard_normal(5)
        dt = 0.02 if step else 0.0
        one.update(np.where(observed, y, np.nan), observed.astype(np.uint8), dt)
        two.update(np.where(observed, y, 1e9), observed.astype(np.uint8), dt)
    for d in range(5):
        for a, b in zip(one.marginal(d), two.marginal(d)):
            np.testing.assert_array_equal(a, b)
        assert np.linalg.eigvalsh(one.marginal(d)[1]).min() > -1e-12


@pytest.mark.parametrize('harmonics', [0, 2])
def test_prediction_is_the_dense_one(harmonics):
    rng = np.random.default_rng(3)
    one, two = both(rng, 2, 3, harmonics, acceleration=0.0, style_rate=0.0)
    run_both(one, two, rng, 5)
    ahead = np.array([0.0, 0.02, 0.1, 0.4])
    mean, std, velocity = (np.empty((4, 3)) for _ in range(3))
    one.forecast_into(ahead, mean, std, velocity)
    later = [np.empty((4, 3)) for _ in range(3)]
    one.forecast_into(ahead + 1e-6, *later)
    np.testing.assert_allclose(velocity, (later[0] - mean) / 1e-6, atol=1e-4)
    x, p = two.x.copy(), two.p.copy()
    for h, tau in enumerate(ahead):
        f, q = two.transition(tau, np.zeros(2))
        two.x, two.p = f @ x, f @ p @ f.T + q
        want, jacobian = two.observation()
        np.testing.assert_allclose(mean[h], want, atol=1e-9)
        spread = np.diag(jacobian @ two.p @ jacobian.T) + two.noise
        np.testing.assert_allclose(std[h] ** 2, spread, rtol=1e-7)


def followed(one, two, seconds=1.0, wrong=None, gate=(12.0, 0.25, 3.0, True), rate=60):
    """Two filters over the same motion, the second undisturbed: how the first was disturbed by ``wrong(k, y)``."""
    rng = np.random.default_rng(1)
    one.gate(*gate)
    for k in range(int(seconds * rate)):
        weight, shift = np.array([1, 0.5, -0.3]), np.linspace(-0.05, 0.05, one.channels)
        y = weight @ one.table.evaluate(1.0 + 2.0 * k / rate)[0] + shift + 0.01 * rng.standard_normal(one.channels)
        seen = np.ones(one.channels, dtype=np.uint8)
        two.update(y, seen, 1 / rate if k else 0.0)
        one.update(y if wrong is None else wrong(k, y.copy()), seen, 1 / rate if k else 0.0)


def pair(channels=8):
    return [both(np.random.default_rng(3), 2, channels, 1, 0.5, 0.2)[0] for _ in range(2)]


def assert_same(one, two):
    np.testing.assert_array_equal(one.state, two.state)
    np.testing.assert_array_equal(one.covariance, two.covariance)
    np.testing.assert_array_equal(one.residuals, two.residuals)


def test_what_passes_the_gate_changes_nothing():
    one, two = pair()
    followed(one, two)
    assert one.rejected == 0 and one.seen == 8
    assert_same(one, two)


@pytest.mark.parametrize('value', [2.0, -1e3, 1e12])
def test_a_channel_that_is_left_out_is_as_if_it_were_not_observed(value):
    one, two = pair()

    def broken(k, y):
        y[5] = value if k == 59 else y[5]
        return y

    followed(one, two, seconds=59 / 60)
    y = one.table.evaluate(1.0)[0][0] * 0
    y[:] = np.array([1, 0.5, -0.3]) @ one.table.evaluate(1.0 + 2.0 * 59 / 60)[0] + np.linspace(-0.05, 0.05, 8)
    seen = np.ones(8, dtype=np.uint8)
    one.update(broken(59, y.copy()), seen, 1 / 60)
    seen[5] = 0
    two.update(y, seen, 1 / 60)
    assert one.rejected == 1 and one.seen == 7
    np.testing.assert_array_equal(one.used, seen)
    assert_same(one, two)
    assert one.innovation == two.innovation and one.log_likelihood == two.log_likelihood


def test_a_sensor_that_says_one_thing_for_ever_is_never_believed():
    one, two = pair()

    def dead(k, y):
        y[2] = 8.0 if k > 30 else y[2]
        return y

    followed(one, two, seconds=3.0, wrong=dead)
    assert not one.used[2] and one.rejected == 1
    assert abs(one.phase - two.phase) < 0.05


def test_a_channel_that_moves_and_agrees_with_itself_is_believed_after_a_while():
    one, two = pair()
    rejected = []

    def elsewhere(k, y):
        rejected.append(one.rejected)
        y[2] += 8.0 if k > 30 else 0.0
        return y

    followed(one, two, seconds=1.5, wrong=elsewhere)
    assert 3 <= sum(rejected) <= 4                         # 0.05 s at 60 Hz
    assert one.used[2] and one.residuals[0, 2] > 5
    assert abs(one.phase - two.phase) < 0.1                # the others hardly notice


def test_a_channel_that_contradicts_itself_is_never_believed():
    one, two = pair()
    rng = np.random.default_rng(4)

    def wild(k, y):
        y[2] += rng.choice([-1, 1]) * rng.uniform(5, 50) if k > 30 else 0.0
        return y

    followed(one, two, seconds=2.0, wrong=wild)
    assert not one.used[2] and abs(one.phase - two.phase) < 0.05


@pytest.mark.parametrize('whole', [True, False])
def test_where_many_channels_are_out_it_is_the_motion(whole):
    one, two = pair()

    def zero(k, y):
        return y + 5.0 if k == 59 else y

    followed(one, two, seconds=1.0, wrong=zero, gate=(12.0, 0.25, 3.0, whole))
    assert (one.rejected, one.seen) == ((8, 0) if whole else (0, 8))
    assert np.isnan(one.innovation) == whole
    if whole:  # time has passed, and that is all
        assert one.phase == pytest.approx(two.phase, abs=0.05)
    else:
        assert one.innovation > 100


def test_of_three_channels_none_is_told_to_be_wrong_alone():
    one, two = pair(channels=3)
    followed(one, two, wrong=lambda k, y: y + np.array([5.0, 0, 0]) * (k == 59), gate=(12.0, 0.25, 3.0, False))
    assert one.rejected == 0 and one.seen == 3


def test_where_the_others_are_surprised_too_it_is_the_motion():
    one, two = pair()

    def leap(k, y):
        y += 0.25 * (k == 59)                  # all by a few standard deviations, one of them by many
        y[5] += 4.0 * (k == 59)
        return y

    followed(one, two, wrong=leap)
    assert one.rejected == 0 and one.seen == 8


def test_what_fails_beside_a_channel_that_is_far_off_goes_with_it():
    one, two = pair(12)

    def limb(k, y):
        y[5] += 8.0 * (k == 59)
        y[6] += 1.0 * (k == 59)                # less than the limit alone
        return y

    followed(one, two, wrong=limb)
    np.testing.assert_array_equal(np.flatnonzero(one.used == 0), [5, 6])
    one, two = pair(12)
    followed(one, two, wrong=lambda k, y: y + 1.0 * (k == 59) * (np.arange(12) == 6))
    assert one.rejected == 0


def test_a_copy_goes_on_as_the_original():
    one, two = pair()
    followed(one, pair()[0], seconds=0.5)
    two.copy(one)
    assert_same(one, two)
    followed(one, two, seconds=0.5)
    assert_same(one, two)


def test_states_are_at_their_priors_from_the_start_on():
    rng = np.random.default_rng(4)
    one, dense = both(rng, 2, 11, 2)
    for _ in range(2):  # also where others were
        one.start(1.0, 6.0, 0.3, 0.2)
        dense.start(1.0, 6.0, 0.3, 0.2)
        assert_same_marginals(one, dense)
        assert not one.residuals.any()
        run_both(one, dense, rng, 5)
    ahead, said = np.array([0.1, 0.2]), []
    for asked in (False, True):  # to be asked before the first update changes nothing
        one.start(1.0, 6.0, 0.3, 0.2)
        if asked:
            said.append(one.forecast(ahead)[1])
        one.update(np.linspace(0, 1, 11), np.ones(11, np.uint8), 0.0)
        said.append(one.forecast(ahead)[1])
    np.testing.assert_array_equal(said[0], said[2])
    assert said[1].mean() > said[2].mean()


def test_a_copy_of_one_that_has_only_started_is_one():
    rng = np.random.default_rng(5)
    one, dense = both(rng, 2, 11, 1)
    other, _ = both(rng, 2, 11, 1)
    one.start(1.0, 6.0, 0.3, 0.2)
    dense.start(1.0, 6.0, 0.3, 0.2)
    other.update(np.ones(11), np.ones(11, np.uint8), 0.0)
    other.copy(one)
    np.testing.assert_array_equal(other.residuals, one.residuals)
    np.testing.assert_array_equal(other.state, one.state)
    assert not other.residuals.any()


def test_surprise_is_the_error_in_predicted_standard_deviations():
    one, two = pair()
    followed(one, two, seconds=0.5)
    before = one.marginal(0)
    mean, std, _ = one.forecast(np.array([0.04]))
    y = mean[0] + np.array([1, -2, 3, 0, 1, 1, np.nan, 1]) * std[0]
    observed = np.array([1, 1, 1, 1, 0, 0, 0, 0], np.uint8)
    assert one.surprise(y, observed, 0.04) == pytest.approx((1 + 4 + 9) / 4)
    assert np.isnan(one.surprise(y, observed * 0, 0.04))
    for a, b in zip(before, one.marginal(0)):
        np.testing.assert_array_equal(a, b)
