"""What no model knows: short-range dynamics, forecasts weighed by what they were worth, standing still."""
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from style_core.predictor import Estimate, Prediction, Status
from style_core.unknown import OpenPredictor, ShortRange, learn_short_range, read_short_range
from style_core.unknown.forecasts import MEMORY_S, SCORED, USUAL_FRAMES, WORST, Forecasts
from style_core.unknown.short_range import FRAME_S, LAGS, LEADS, NOISE_STD, cubic, displacements

SEEN, AHEAD = len(LAGS) + 1, np.array(LEADS)
HORIZONS = np.arange(1, 26) * FRAME_S


class Told:
    """A predictor that says what a function says: ``course(time)`` is its pose at any time, (D,)."""

    def __init__(self, course, std=0.05):
        self.course, self.std = course, std
        self.joint_names = tuple(f'joint{k}' for k in range(len(course(0.0))))
        self.reset()

    def reset(self):
        self.time = None

    def update(self, time, y, mask=None):
        self.time = time
        y = np.asarray(y, dtype=float)
        seen = np.isfinite(y) if mask is None else np.isfinite(y) & mask
        return Estimate(time, 1.0, 6.0, np.eye(2), np.zeros(1), np.eye(1), self.course(time), np.full(len(y), self.std),
                        seen, 1.0, 0.0, Status.TRACKING)

    def predict(self, horizons):
        horizons = np.asarray(horizons, dtype=float)
        said = [self.course(self.time + ahead) for ahead in horizons]
        mean = np.reshape(said, (-1, len(self.joint_names)))
        slope = np.array([(self.course(self.time + ahead + 1e-6) - self.course(self.time + ahead - 1e-6)) / 2e-6
                          for ahead in horizons]).reshape(mean.shape)
        return Prediction(self.time + horizons, mean, np.full_like(mean, self.std), slope)


def walking(time):
    return np.array([0.5 * np.sin(6 * time), 0.4 * np.cos(6 * time), 0.6 * np.sin(6 * time + 1),
                     0.3 * np.cos(12 * time)])


def nonsense(time):
    return walking(time) + 1.0


def wandering(seed, frames, channels=4):
    """Smooth motion that repeats nothing."""
    steps = np.random.default_rng(seed).normal(size=(frames + 60, channels))
    kernel = np.exp(-0.5 * (np.arange(-20, 21) / 7) ** 2)
    return 0.06 * np.array([np.convolve(column, kernel, 'same') for column in steps.T]).T[30:frames + 30]


def follow(predictor, poses, start=0.0, step=FRAME_S, mask=None):
    """Show poses; returns estimates and predictions of `HORIZONS`."""
    said = []
    for frame, y in enumerate(poses):
        estimate = predictor.update(start + frame * step, y, mask)
        said.append((estimate, predictor.predict(HORIZONS)))
    return said


# ------------------------------------------------------------------------------------------- short-range dynamics

@settings(deadline=None, max_examples=25)
@given(st.integers(1, 2 ** SEEN - 1), st.integers(0, 2 ** 32 - 1))
def test_weights_of_any_subset_are_those_of_the_conditional_gaussian(pattern, seed):
    """The judge: angles as one Gaussian vector whose common level is nearly free, conditioned on the subset."""
    count = SEEN - 1 + len(LEADS)
    root = np.random.default_rng(seed).normal(size=(count, count)) / np.sqrt(count)
    moments = root @ root.T
    weights, variance = ShortRange(moments, np.zeros((2, len(LEADS)))).tables
    covariance = np.zeros((count + 1, count + 1))
    covariance[1:, 1:] = moments
    covariance += 1e6       # the level
    observed = np.array([k for k in range(SEEN) if pattern >> k & 1])
    noisy = covariance[np.ix_(observed, observed)] + NOISE_STD ** 2 * np.eye(len(observed))
    across = covariance[observed][:, SEEN:]
    gain = np.linalg.solve(noisy, across)
    assert_allclose(weights[pattern][:, observed], gain.T, atol=2e-4, rtol=2e-4)
    left = np.diag(covariance)[SEEN:] - np.einsum('ah,ah->h', across, gain)
    assert_allclose(variance[pattern], left, rtol=1e-3, atol=1e-3)


def test_weights_add_up_to_one_and_leave_out_what_was_not_seen():
    weights, variance = read_short_range().tables
    for pattern in range(1, 2 ** SEEN):
        unseen = [k for k in range(SEEN) if not pattern >> k & 1]
        assert_allclose(weights[pattern].sum(axis=1), 1.0)
        assert not weights[pattern][:, unseen].any()
    assert (np.diff(variance[-1]) > 0).all()     # the farther ahead, the less is known
    assert not weights[0].any()


def test_seeing_more_never_makes_the_variance_larger():
    _, variance = read_short_range().tables
    for pattern in range(1, 2 ** SEEN):
        for k in range(SEEN):
            # a newer angle moves the place that displacements count from; of older ones each can only help
            if not pattern >> k & 1 and pattern & ((1 << k) - 1):
                assert (variance[pattern | 1 << k] <= variance[pattern] + 1e-12).all()


def test_moments_are_those_of_displacements():
    y = wandering(1, 200)
    z = displacements(y)
    assert_allclose(z[3, 0], y[LAGS[-1] + 3 - 1] - y[LAGS[-1] + 3])
    assert_allclose(z[3, -1], y[LAGS[-1] + 3 + LEADS[-1]] - y[LAGS[-1] + 3])
    learned = learn_short_range([y, y[:1]], np.zeros((2, len(LEADS)))).moments
    assert_allclose(learned, np.mean([one @ one.T / 4 for one in z], axis=0))


def test_interpolation_is_exact_for_parabolas_and_its_slope_is_its_derivative():
    knots = np.concatenate([[0.0], AHEAD * FRAME_S])
    at = np.linspace(0, knots[-1], 200)
    first, (value, slope) = cubic(knots, at)
    take = first[:, None] + np.arange(4)
    for power in range(3):
        assert_allclose((value * knots[take] ** power).sum(axis=1), at ** power, atol=1e-12)
        assert_allclose((slope * knots[take] ** power).sum(axis=1), power * at ** max(power - 1, 0), atol=1e-9)


# ----------------------------------------------------------------------------------------------------- forecasts

@settings(deadline=None, max_examples=15)
@given(st.integers(0, 2 ** 32 - 1), st.floats(0.0, 0.6))
def test_the_weight_is_bates_and_grangers_over_fading_scores(seed, share_dark):
    """The judge: every forecast kept whole and scored anew at the end, by the formula."""
    random = np.random.default_rng(seed)
    dynamics = read_short_range()
    y = wandering(seed, 90)
    seen = random.random(y.shape) >= share_dark
    seen[:, 0] = True
    forecasts = Forecasts(y.shape[1], dynamics)
    kept = []
    for frame, (pose, flags) in enumerate(zip(y, seen)):
        forecasts.observe(frame * FRAME_S, np.where(flags, pose, np.nan), flags.view(np.uint8))
        model = pose + random.normal(0, 0.3, (len(SCORED), y.shape[1]))
        forecasts.keep(model, np.full_like(model, 0.1), np.arange(len(SCORED), dtype=np.int32), np.zeros(len(SCORED)))
        # of few joints that hardly move it says that the person stands, and foretells the pose itself
        short = np.tile(y[frame], (len(LEADS), 1)) if forecasts.still else short_range_of(dynamics, y, seen, frame)
        kept.append((model, short))
    for place, lead in enumerate(SCORED):
        sums, frames = np.zeros(3), 0.0
        for frame in range(lead, len(y)):
            both = seen[frame] & seen[frame - lead]
            model, short = (part[place][both] - y[frame][both] for part in kept[frame - lead])
            fade = np.exp(-FRAME_S / MEMORY_S)
            model = model * min(1, np.sqrt(WORST[0] * np.mean(short ** 2) / np.mean(model ** 2)))
            sums = fade * sums + [np.mean(model ** 2), np.mean(model * short), np.mean(short ** 2)]
            frames = fade * frames + 1
        one, both, two = sums + USUAL_FRAMES * sums[2] / frames * np.array([*dynamics.usual[:, place], 1.0])
        expected = np.clip((two - both) / (one + two - 2 * both), 0, 1)
        assert_allclose(forecasts.weight[place], expected, rtol=1e-4, atol=1e-5)


def short_range_of(dynamics, y, seen, frame):
    """Short-range predictions at ``frame``, joint by joint, (H, D)."""
    weights, _ = dynamics.tables
    out = np.zeros((len(LEADS), y.shape[1]))
    for joint in range(y.shape[1]):
        at = [frame - lag for lag in (0, *LAGS)]
        known = [k for k in range(SEEN) if at[k] >= 0 and seen[at[k], joint]]
        if known:
            out[:, joint] = weights[sum(1 << k for k in known)][:, known] @ y[[at[k] for k in known], joint]
    return out


@pytest.mark.parametrize('rate', [30, 60, 100, 250, 1000])
def test_rates_make_no_difference(rate):
    """A model that is right is believed, and one that is wrong is not, at whatever rate the joints come."""
    for course, believed in ((walking, True), (nonsense, False)):
        predictor = OpenPredictor(Told(course), 'walk')
        times = np.arange(0, 2, 1 / rate)
        for time in times:
            predictor.update(time, walking(time))
            said = predictor.predict(HORIZONS)
        weight = predictor._forecasts.weight[-1]
        assert weight > 0.9 if believed else weight < 0.2
        assert np.abs(said.mean - [walking(times[-1] + ahead) for ahead in HORIZONS])[:3].max() < 0.15


# ----------------------------------------------------------------------------------------------- the whole of it

def test_a_model_that_knows_the_motion_is_left_as_it_is():
    predictor = OpenPredictor(Told(walking), 'walk')
    estimate, said = follow(predictor, [walking(frame * FRAME_S) for frame in range(120)])[-1]
    assert estimate.status == Status.TRACKING
    assert estimate.behaviours['walk'] > 0.9
    assert_allclose(said.mean, [walking(119 * FRAME_S + ahead) for ahead in HORIZONS], atol=0.02)


def test_motion_that_the_model_does_not_know_is_unknown_and_predicted_by_dynamics_alone():
    y = wandering(3, 240)
    said = follow(OpenPredictor(Told(nonsense), 'walk'), y)
    assert all(estimate.status == Status.UNKNOWN for estimate, _ in said[60:])
    assert said[-1][0].behaviours['unknown'] > 0.9
    lead = LEADS.index(4)
    alone = np.array([short_range_of(read_short_range(), y, np.ones_like(y, dtype=bool), frame)[lead] - y[frame + 4]
                      for frame in range(60, 200)])
    error = np.array([said[frame][1].mean[3] - y[frame + 4] for frame in range(60, 200)])
    assert np.mean(error ** 2) < 1.1 * np.mean(alone ** 2)


def test_motion_that_is_known_again_is_trusted_again():
    y = np.concatenate([wandering(3, 180), [walking(frame * FRAME_S) for frame in range(180, 360)]])
    said = follow(OpenPredictor(Told(walking), 'walk'), y)
    status = [estimate.status for estimate, _ in said]
    assert status[179] == Status.UNKNOWN and status[-1] == Status.TRACKING
    assert np.count_nonzero(np.diff(status)) <= 3      # acquiring, unknown, tracking: it does not flutter


@pytest.mark.parametrize('instant', [60, 67, 75, 83, 91])
def test_who_stops_in_mid_stride_stands_still_within_a_second(instant):
    pose = walking(instant * FRAME_S)
    y = [walking(frame * FRAME_S) for frame in range(instant)] + [pose] * 60
    said = follow(OpenPredictor(Told(walking), 'walk'), y)
    estimate, prediction = said[-1]
    assert estimate.behaviours['still'] == 1.0 and estimate.phase_velocity == 0.0
    assert estimate.status == Status.TRACKING
    assert_allclose(prediction.mean, np.broadcast_to(pose, prediction.mean.shape), atol=1e-12)
    assert_allclose(prediction.velocity, 0.0, atol=1e-12)


def test_standing_still_is_over_two_frames_after_the_person_moves():
    y = [walking(0.3)] * 90 + [walking(0.3 + frame * FRAME_S) for frame in range(1, 3)]
    said = follow(OpenPredictor(Told(walking), 'walk'), y)
    assert said[89][0].behaviours['still'] == 1.0
    assert said[91][0].behaviours['still' if 'still' in said[91][0].behaviours else 'walk'] != 1.0


def test_a_dark_joint_is_left_to_the_model_and_its_band_says_how_far_off_that_is():
    y = wandering(5, 180)
    mask = np.array([True, True, True, False])
    predictor = OpenPredictor(Told(walking), 'walk')
    _, said = follow(predictor, y, mask=mask)[-1]
    model = Told(walking)
    model.update(179 * FRAME_S, y[-1])
    assert_allclose(said.mean[:, 3], model.predict(HORIZONS).mean[:, 3])
    assert (said.std[:, 3] > 2 * model.std).all()


def test_a_joint_that_goes_dark_passes_to_the_model_without_a_step():
    y = wandering(5, 120)
    predictor = OpenPredictor(Told(walking), 'walk')
    follow(predictor, y[:80])
    before = predictor.predict([0.0, 0.1]).mean[0, 3]
    steps = []
    for frame in range(80, 120):
        predictor.update(frame * FRAME_S, y[frame], np.array([True, True, True, False]))
        now = predictor.predict([0.0, 0.1]).mean[0, 3]
        steps.append(abs(now - before))
        before = now
    assert max(steps) < 0.08


def test_bands_hold_what_happens():
    y = wandering(7, 600)
    said = follow(OpenPredictor(Told(walking, std=0.01), 'walk'), y)
    inside = [np.abs(said[frame][1].mean[at] - y[frame + at + 1]) < 1.645 * said[frame][1].std[at]
              for frame in range(120, 570) for at in (0, 4, 14, 24)]
    assert 0.85 < np.mean(inside) < 0.97


def test_reset_and_a_long_silence_forget_the_same():
    one, two, fresh = (OpenPredictor(Told(walking), 'walk') for _ in range(3))
    for predictor in (one, two):
        follow(predictor, wandering(3, 120))
    one.reset()
    y = [walking(10 + frame * FRAME_S) for frame in range(30)]
    for a, b, c in zip(*(follow(predictor, y, start=10.0) for predictor in (one, two, fresh))):
        assert a[0].status == b[0].status == c[0].status
        assert_allclose(a[1].mean, c[1].mean)
        assert_allclose(b[1].std, c[1].std)


def test_horizons_may_be_few_far_and_none():
    predictor = OpenPredictor(Told(walking), 'walk')
    for frame in range(60):
        predictor.update(frame * FRAME_S, walking(frame * FRAME_S))
        far = predictor.predict([0.0, 0.7, 5.0])
    assert np.isfinite(far.mean).all() and (far.std > 0).all()
    assert predictor.predict(np.zeros(0)).mean.shape == (0, 4)
    assert predictor._forecasts.weight[-1] > 0.9     # scored without anybody asking for near horizons
