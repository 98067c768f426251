"""Forecasts of a model and of short-range dynamics, weighed by what they turned out to be worth.

Both are kept when they are made and scored when their time has come. With ``e1`` and ``e2`` their errors at one lead, means
taken over joints and, fading, over the last half second, the weight of the model that minimises the squared error is

    w = (<e2^2> - <e1 e2>) / (<e1^2> + <e2^2> - 2 <e1 e2>)

(Bates and Granger 1969), in [0, 1]. Before anything was scored, and a little for ever, the usual errors of a model on motion
that it knows stand in for the means, relative to ``<e2^2>``: so the weight does not depend on how much the person moves.
"""
import numpy as np

from libc.math cimport INFINITY, exp, fabs, fmax, fmin, sqrt
from libc.string cimport memset

from style_core.unknown.short_range import FRAME_S, LAGS, LEADS

cdef extern from 'rows.h':
    void add_row(int n, double weight, const double *row, double *sum) nogil
    void combine_row(int n, const double *short_value, const double *short_slope, double share, double slope, double grown,
                     double usual, double early, double lower, double upper, const double *squares_low,
                     const double *squares_high, const double *frames_low, const double *frames_high, double stretch,
                     double *mean, double *std, double *velocity) nogil

__all__ = ['SCORED', 'Forecasts']

#: Leads whose forecasts are scored: those that a prediction of 0.4 s holds.
SCORED = tuple(lead for lead in LEADS if lead <= 20)
#: Forecasts count for so long, s; and so long do errors that bands are made of.
MEMORY_S, BAND_MEMORY_S = 0.5, 1.0
#: What is usual is worth this many frames of scores.
USUAL_FRAMES = 5.0
#: Errors of the model count for at most twenty times those of the dynamics, root mean square, and errors in a band for at
#: most ten standard deviations: a model that a wild sample has thrown off is forgiven.
WORST = 400.0, 100.0
#: Two kept samples are at least this far apart, s: all of a 60 Hz stream, every third of a 200 Hz one.
SPACING_S = 0.85 * FRAME_S
#: Angles farther apart than this have no straight line between them, s.
LONGEST_GAP_S = 2.5 * FRAME_S
#: A joint unseen for this long is left to the model, s.
STALE_S = LAGS[len(LAGS) - 1] * FRAME_S
#: A joint that moves farther than the first, rad, and faster than the second, rad/s, has not moved: its angle has jumped to
#: an equivalent one, or a sensor lies.
JUMP = (0.5, 40.0)
#: Standing still: no joint moved by more than this over the last 18 and 8 frames, root mean square over joints, rad; and it
#: has ended once it moved by more than the third over two frames. People who walk move by over 5 degrees in 18 frames and
#: by over 0.6 in two, whatever the phase.
STILL_RAD = (np.radians(1.5), np.radians(1.0), np.radians(0.6))

cdef enum:
    KEPT = 32       # samples: LAGS[-1] frames at the least spacing, and some more
    PATTERNS = 256      # 2^(K+1)
    PENDING = 40    # forecasts of one lead that wait for their time: 25 frames at the least spacing, and some more

cdef double FRAME = FRAME_S, SPACING = SPACING_S, GAP = LONGEST_GAP_S, STALE = STALE_S, JUMP_RAD = JUMP[0], JUMP_SPEED = JUMP[1]
cdef double WORST_RATIO = WORST[0], WORST_SQUARE = WORST[1]
cdef double MEMORY = MEMORY_S, BAND_MEMORY = BAND_MEMORY_S, USUAL = USUAL_FRAMES
cdef double STILL_LONG = STILL_RAD[0], STILL_SHORT = STILL_RAD[1], MOVING = STILL_RAD[2]
cdef int TWO_FRAMES = 1 + LAGS.index(2), EIGHT_FRAMES = 1 + LAGS.index(8), EIGHTEEN_FRAMES = 1 + LAGS.index(18)


cdef class Forecasts:
    """Keeps what was seen and foretold lately, and combines.

    Parameters
    ----------
    channels : int
    dynamics : ShortRange

    Attributes
    ----------
    weight : ndarray, shape (len(SCORED),)
        Of the model, by lead, in [0, 1].
    still : bool
        Whether the person stands still.
    wanted : bool
        Whether forecasts of the model, made at the last observation, are to be kept.
    """

    cdef int _channels, _seen_count, _leads, _scored
    cdef readonly object weight
    cdef readonly bint still, wanted
    cdef double[::1] _weight
    cdef double[:, :, ::1] _tables          # (2^(K+1), H, K+1)
    cdef double[:, ::1] _variances          # (2^(K+1), H)
    cdef double[:, ::1] _usual              # (2, H)
    cdef double[::1] _lags, _ahead          # s
    # what was seen: the newest sample, and earlier ones in a ring
    cdef double _time
    cdef double[::1] _y, _last_seen         # angle and time of the last sight of each joint
    cdef unsigned char[::1] _seen
    cdef double[::1] _times
    cdef double[:, ::1] _past
    cdef unsigned char[:, ::1] _past_seen
    cdef int _newest, _count
    cdef double[:, ::1] _angles             # (K+1, D): now and `LAGS` ago
    cdef int[::1] _pattern                  # which of them were seen, when the joint was seen last; zero: it never was
    cdef int _common                        # the pattern of most joints that are seen now
    cdef int[::1] _odd                      # joints that have another, or are not seen now
    cdef int _odds
    # forecasts that wait, by lead
    cdef double[:, ::1] _due
    cdef float[:, :, ::1] _model, _short, _inverse, _mixed      # means; and 1 / std of the model
    cdef int[::1] _head, _waiting
    # scores by lead: <e1^2>, <e1 e2>, <e2^2>, <e1^2 / s1^2> and how many frames they are worth
    cdef double[:, ::1] _score
    cdef double[::1] _frames, _last_due
    cdef double[:, ::1] _squares, _square_frames    # errors of the combination by lead and joint
    # predictions
    cdef double[:, ::1] _short_leads        # (H + 1, D): the angle now, then short-range predictions
    cdef double[:, ::1] _kept               # (H + 1, D)
    cdef double[:, ::1] _scratch            # (5, D)

    def __init__(self, int channels, dynamics):
        weights, variances = dynamics.tables
        self._channels, self._seen_count, self._leads, self._scored = channels, len(LAGS) + 1, len(LEADS), len(SCORED)
        self._tables, self._variances, self._usual = weights, variances, np.ascontiguousarray(dynamics.usual)
        self._lags = np.array(LAGS) * FRAME_S
        self._ahead = np.array(LEADS) * FRAME_S
        self.weight = np.empty(self._scored)
        self._weight = self.weight
        self._y, self._last_seen = np.zeros(channels), np.empty(channels)
        self._seen = np.zeros(channels, dtype=np.uint8)
        self._times, self._past = np.zeros(KEPT), np.zeros((KEPT, channels))
        self._past_seen = np.zeros((KEPT, channels), dtype=np.uint8)
        self._angles, self._pattern = np.zeros((self._seen_count, channels)), np.zeros(channels, dtype=np.int32)
        self._due = np.zeros((self._scored, PENDING))
        self._model, self._short, self._inverse, self._mixed = np.zeros((4, self._scored, PENDING, channels), dtype=np.float32)
        self._head, self._waiting = np.zeros(self._scored, dtype=np.int32), np.zeros(self._scored, dtype=np.int32)
        self._score, self._frames = np.zeros((4, self._scored)), np.zeros(self._scored)
        self._last_due = np.zeros(self._scored)
        self._squares, self._square_frames = np.zeros((2, self._scored, channels))
        self._short_leads, self._kept = np.zeros((2, self._leads + 1, channels))
        self._scratch = np.zeros((5, channels))
        self._odd = np.zeros(channels, dtype=np.int32)
        self.reset()

    def reset(self):
        """Forget everything."""
        self._time = -INFINITY
        self._last_seen[:] = -INFINITY
        self._pattern[:] = 0
        self._common = self._odds = 0
        self._count = self._newest = 0
        self._head[:] = 0
        self._squares[:] = 0.0
        self._square_frames[:] = 0.0
        self.still = self.wanted = False
        self.forgive()

    def forgive(self):
        """Forget what the model's forecasts were worth: it has found its way, and they were made before."""
        self._waiting[:] = 0
        self._score[:] = 0.0
        self._frames[:] = 0.0
        self._weigh()

    # ---------------------------------------------------------------------------------------- what is seen

    def observe(self, double time, const double[:] y, const unsigned char[:] seen):
        """Take an observation and score the forecasts whose time has come.

        Parameters
        ----------
        time : float
            S; after that of the last observation.
        y : ndarray, shape (D,)
            Rad.
        seen : ndarray of uint8, shape (D,)
            Where it was measured and is believed.

        Afterwards forecasts are to be kept (`keep`) where ``wanted`` says so.
        """
        cdef int lead, d
        cdef bint sampled
        for d in range(self._channels):
            if seen[d] and fabs(y[d] - self._y[d]) > fmax(JUMP_RAD, JUMP_SPEED * (time - self._last_seen[d])):
                self._forget_joint(d)
        for lead in range(self._scored):
            self._score_due(lead, time, y, seen)
        self._weigh()
        sampled = self._count == 0 or time - self._times[self._newest] >= SPACING
        if sampled:
            self._newest = (self._newest + 1) % KEPT if self._count else 0
            self._count = min(self._count + 1, KEPT)
            self._times[self._newest] = time
        self._time = time
        for d in range(self._channels):
            self._seen[d] = seen[d]
            if seen[d]:
                self._y[d] = y[d]
                self._last_seen[d] = time
            if sampled:
                self._past[self._newest, d] = y[d] if seen[d] else 0.0
                self._past_seen[self._newest, d] = seen[d]
        self._look_back()
        self._find_odd()
        self._judge_still()
        self._foretell()
        self.wanted = sampled

    cdef void _forget_joint(self, int d) noexcept nogil:
        """Neither look back beyond a jump nor score what was foretold before it."""
        cdef int lead, k
        for k in range(KEPT):
            self._past_seen[k, d] = 0
        for lead in range(self._scored):
            for k in range(PENDING):
                self._inverse[lead, k, d] = 0.0

    cdef void _look_back(self) noexcept nogil:
        """Angles of the joints that are seen, now and `LAGS` ago, and which of them were seen."""
        cdef int d, k, step, older, newer
        cdef double wanted, share
        for d in range(self._channels):
            if self._seen[d]:
                self._pattern[d] = 1
                self._angles[0, d] = self._y[d]
        step = 0
        for k in range(1, self._seen_count):
            wanted = self._time - self._lags[k - 1]
            while step < self._count and self._times[self._back(step)] > wanted + 1e-3 * FRAME:
                step += 1
            if step == self._count:
                return
            older = self._back(step)
            if wanted - self._times[older] <= 1e-3 * FRAME:
                for d in range(self._channels):
                    if self._seen[d] and self._past_seen[older, d]:
                        self._pattern[d] |= 1 << k
                        self._angles[k, d] = self._past[older, d]
            elif step > 0 and self._times[self._back(step - 1)] - self._times[older] <= GAP:
                newer = self._back(step - 1)
                share = (wanted - self._times[older]) / (self._times[newer] - self._times[older])
                for d in range(self._channels):
                    if self._seen[d] and self._past_seen[older, d] and self._past_seen[newer, d]:
                        self._pattern[d] |= 1 << k
                        self._angles[k, d] = self._past[older, d] + share * (self._past[newer, d] - self._past[older, d])

    cdef void _find_odd(self) noexcept nogil:
        """The pattern that most joints seen now have, and the joints that have another."""
        cdef int count[PATTERNS]
        cdef int d
        memset(count, 0, sizeof(count))
        self._common = 1
        for d in range(self._channels):
            if self._seen[d]:
                count[self._pattern[d]] += 1
                if count[self._pattern[d]] > count[self._common]:
                    self._common = self._pattern[d]
        self._odds = 0
        for d in range(self._channels):
            if not self._seen[d] or self._pattern[d] != self._common:
                self._odd[self._odds] = d
                self._odds += 1

    cdef inline int _back(self, int step) noexcept nogil:
        """Place of the sample ``step`` before the newest."""
        return (self._newest - step + KEPT) % KEPT

    cdef double _moved(self, int k) noexcept nogil:
        """Root mean square displacement since angle ``k``, over joints seen now and then; infinite where there is none."""
        cdef int d, count = 0
        cdef double total = 0, step
        for d in range(self._channels):
            if self._seen[d] and self._pattern[d] >> k & 1:
                step = self._angles[0, d] - self._angles[k, d]
                total += step * step
                count += 1
        return sqrt(total / count) if count else INFINITY

    cdef void _judge_still(self) noexcept nogil:
        if self.still:
            self.still = self._moved(TWO_FRAMES) <= MOVING
        else:
            self.still = self._moved(EIGHTEEN_FRAMES) < STILL_LONG and self._moved(EIGHT_FRAMES) < STILL_SHORT

    # ------------------------------------------------------------------------------- what forecasts are worth

    def keep(self, const double[:, ::1] mean, const double[:, ::1] std, const int[::1] low, const double[::1] next_share):
        """Keep the model's forecasts, made at the last observation for `SCORED` frames ahead, beside those of short-range dynamics.

        Parameters
        ----------
        mean, std : ndarray, shape (H, D)
            Rad. What was foretold of a joint that is not seen now is not scored.
        low : ndarray of int32, shape (len(SCORED),)
            Of the horizons: each scored lead lies between this one and the next,
        next_share : ndarray, shape (len(SCORED),)
            at this share of the way.
        """
        cdef int lead, at, d, row, following
        cdef double share, part, said, spread
        self.wanted = False
        for lead in range(self._scored):
            if self._waiting[lead] == PENDING:  # far more samples than spacing allows: nothing to lose
                continue
            at = (self._head[lead] + self._waiting[lead]) % PENDING
            self._waiting[lead] += 1
            self._due[lead, at] = self._time + self._ahead[lead]
            share = 0.0 if self.still else self._weight[lead]
            row, part = low[lead], next_share[lead]
            following = row + 1 if part > 0 else row
            for d in range(self._channels):
                said = mean[row, d] + part * (mean[following, d] - mean[row, d])
                spread = std[row, d] + part * (std[following, d] - std[row, d])
                self._model[lead, at, d] = <float>said
                self._short[lead, at, d] = <float>self._short_leads[lead + 1, d]
                self._mixed[lead, at, d] = <float>(share * said + (1 - share) * self._short_leads[lead + 1, d])
                self._inverse[lead, at, d] = <float>(1 / spread) if self._seen[d] else 0.0    # zero: not scored

    cdef void _score_due(self, int lead, double time, const double[:] y, const unsigned char[:] seen) noexcept nogil:
        """Score the forecasts of one lead that were due until ``time``."""
        cdef int d, at, count
        cdef double due, share, actual, model, short, mixed, since, frames, fade
        cdef double sums[4]
        while self._waiting[lead] and self._due[lead, self._head[lead]] <= time + 1e-3 * FRAME:
            at = self._head[lead]
            due = self._due[lead, at]
            self._head[lead] = (at + 1) % PENDING
            self._waiting[lead] -= 1
            if due < self._time - 1e-3 * FRAME or time - self._time > GAP:
                continue    # too long between two observations to say where the joints were
            share = fmin((due - self._time) / (time - self._time), 1.0)
            sums[0] = sums[1] = sums[2] = sums[3] = 0.0
            count = 0
            since = due - self._last_due[lead] if self._frames[lead] > 0 else FRAME
            frames = fmin(since / FRAME, 2.0)
            fade = exp(-since / BAND_MEMORY)
            for d in range(self._channels):
                if not (seen[d] and self._inverse[lead, at, d] > 0 and (self._seen[d] or share > 0.999)):
                    continue
                actual = y[d] if share > 0.999 else self._y[d] + share * (y[d] - self._y[d])
                model = self._model[lead, at, d] - actual
                short = self._short[lead, at, d] - actual
                mixed = self._mixed[lead, at, d] - actual
                sums[0] += model * model
                sums[1] += model * short
                sums[2] += short * short
                model *= self._inverse[lead, at, d]
                sums[3] += fmin(model * model, WORST_SQUARE)
                mixed = fmin(mixed * mixed, WORST_SQUARE * fmax(
                    self._variances[self._common, lead], 1 / (self._inverse[lead, at, d] * self._inverse[lead, at, d])))
                self._squares[lead, d] = fade * self._squares[lead, d] + frames * mixed
                self._square_frames[lead, d] = fade * self._square_frames[lead, d] + frames
                count += 1
            if not count:
                continue
            if sums[0] > WORST_RATIO * sums[2] > 0:
                share = sqrt(WORST_RATIO * sums[2] / sums[0])
                sums[0] *= share * share
                sums[1] *= share
            fade = exp(-since / MEMORY)
            for d in range(4):
                self._score[d, lead] = fade * self._score[d, lead] + frames * sums[d] / count
            self._frames[lead] = fade * self._frames[lead] + frames
            self._last_due[lead] = due

    cdef void _weigh(self) noexcept nogil:
        """Weight of the model by lead."""
        cdef int lead
        cdef double level, model, both, short, apart
        for lead in range(self._scored):
            level = self._score[2, lead] / self._frames[lead] if self._frames[lead] > 0 else 1.0
            model = self._score[0, lead] + USUAL * self._usual[0, lead] * level
            both = self._score[1, lead] + USUAL * self._usual[1, lead] * level
            short = self._score[2, lead] + USUAL * level
            apart = model + short - 2 * both
            self._weight[lead] = fmin(fmax((short - both) / apart, 0.0), 1.0) if apart > 0 else 0.0

    # --------------------------------------------------------------------------------------------- predictions

    cdef void _foretell(self) noexcept nogil:
        """Short-range predictions at all leads, the angle itself first; of a joint not seen now, those made when it was."""
        cdef int d, k, lead, odd
        cdef int lags = 1 if self.still else self._seen_count
        for odd in range(self._odds):   # kept aside: the loops over all joints do not ask
            d = self._odd[odd]
            if not self._seen[d]:
                for lead in range(self._leads + 1):
                    self._kept[lead, odd] = self._short_leads[lead, d]
        self._short_leads[0] = self._angles[0]
        for lead in range(self._leads):
            self._short_leads[lead + 1] = 0.0
            for k in range(lags):
                if self._common >> k & 1:
                    add_row(self._channels, 1.0 if self.still else self._tables[self._common, lead, k],
                            &self._angles[k, 0], &self._short_leads[lead + 1, 0])
        for odd in range(self._odds):
            d = self._odd[odd]
            for lead in range(self._leads):
                if not self._seen[d]:
                    self._short_leads[lead + 1, d] = self._kept[lead + 1, odd]
                elif not self.still:
                    self._short_leads[lead + 1, d] = 0.0
                    for k in range(self._seen_count):
                        if self._pattern[d] >> k & 1:
                            self._short_leads[lead + 1, d] += self._tables[self._pattern[d], lead, k] * self._angles[k, d]

    def combine(self, const double[::1] ahead, const int[::1] first, const double[:, :, ::1] basis, double[:, ::1] mean,
                double[:, ::1] std, double[:, ::1] velocity):
        """Combine the model's prediction with that of short-range dynamics, in place.

        Parameters
        ----------
        ahead : ndarray, shape (H,)
            Horizons, s.
        first, basis : ndarray
            Interpolation from the angle now and `LEADS` to the horizons (`style_core.unknown.short_range.cubic`).
        mean, std, velocity : ndarray, shape (H, D)
            The model's: rad, rad, rad/s.
        """
        cdef int h, d, lead, odd, count = ahead.shape[0]
        cdef double usual
        for h in range(count):
            usual = 0.0
            for d in range(self._channels):
                usual += std[h, d] * std[h, d]
            usual = fmax(usual / self._channels, 1e-12)
            for odd in range(self._odds):
                d = self._odd[odd]
                self._scratch[2, odd], self._scratch[3, odd], self._scratch[4, odd] = mean[h, d], std[h, d], velocity[h, d]
            self._scratch[:2] = 0.0
            for lead in range(4):
                for odd in range(2):
                    add_row(self._channels, basis[odd, h, lead], &self._short_leads[first[h] + lead, 0],
                            &self._scratch[odd, 0])
            self._combine_seen(ahead[h], usual, mean[h], std[h], velocity[h])
            for odd in range(self._odds):
                self._combine_odd(odd, ahead[h], usual, mean[h], std[h], velocity[h])

    cdef void _combine_seen(self, double at, double usual, double[::1] mean, double[::1] std,
                            double[::1] velocity) noexcept nogil:
        """Combine at one horizon all joints as if they had the common pattern."""
        cdef int low = self._below(at), high = self._above(low)
        cdef double share = 0.0 if self.still else self._between(self._weight, low, at, False)
        cdef double slope = 0.0 if self.still else self._slope(low)
        cdef double growth = fmax(self._variance(self._common, at) / usual, 1.0)
        cdef double grown = share + (1 - share) * growth
        cdef double upper = self._upper(low, at), lower = 1 - upper, stretch = self._stretch(self._common, low, at)
        cdef double early = self._early(low, at)
        low = max(low, 0)
        combine_row(self._channels, &self._scratch[0, 0], &self._scratch[1, 0], share, slope, grown, USUAL, early, lower,
                    upper, &self._squares[low, 0], &self._squares[high, 0], &self._square_frames[low, 0],
                    &self._square_frames[high, 0], stretch, &mean[0], &std[0], &velocity[0])

    cdef void _combine_odd(self, int odd, double ahead, double usual, double[::1] mean, double[::1] std,
                           double[::1] velocity) noexcept nogil:
        """Combine one joint that has another pattern or is not seen now; what the model said of it lies in the scratch.

        What short-range dynamics say of a joint that went dark is what they said when it was seen last.
        """
        cdef int d = self._odd[odd], low, high
        cdef double since = 0.0 if self._seen[d] else self._time - self._last_seen[d]
        cdef double fresh = fmax(1.0 - since / STALE, 0.0) if self._pattern[d] else 0.0
        cdef double said = self._scratch[2, odd], spread = self._scratch[3, odd], speed = self._scratch[4, odd]
        cdef double at = ahead + since, doubt, share = 0.0, slope = 0.0, prior, measured, early, upper
        cdef double short = self._scratch[0, d], rate = self._scratch[1, d]
        low = self._below(at)
        high = self._above(low)
        # as far off as the joints that are seen show the model to be
        doubt = fmax(self._between(self._score[3], low, at, True), 1.0)
        mean[d], std[d], velocity[d] = said, spread * sqrt(doubt), speed
        if fresh == 0.0:
            return
        if not self._seen[d]:
            self._along(d, at, &short, &rate)
        if not self.still:
            share, slope = self._between(self._weight, low, at, False), self._slope(low)
        prior = spread * spread * (share + (1 - share) * fmax(self._variance(self._pattern[d], at) / usual, 1.0))
        upper, early = self._upper(low, at), self._early(low, at)
        measured = self._stretch(self._pattern[d], low, at) * (
            (1 - upper) * self._squares[max(low, 0), d] + upper * self._squares[high, d])
        measured = (measured + USUAL * prior) / (
            (1 - upper) * self._square_frames[max(low, 0), d] + upper * self._square_frames[high, d] + USUAL)
        measured = early * measured + (1 - early) * prior
        std[d] = sqrt(fresh * measured + (1 - fresh) * spread * spread * doubt)
        share, slope = 1 - fresh * (1 - share), fresh * slope
        mean[d] = short + share * (said - short)
        velocity[d] = rate + share * (speed - rate) + slope * (said - short)

    cdef void _along(self, int d, double at, double *value, double *slope) noexcept nogil:
        """Short-range prediction of a joint ``at`` s after it was seen last: linear between leads."""
        cdef int lead = 0
        cdef double start = 0.0
        while lead < self._leads and self._ahead[lead] < at:
            start = self._ahead[lead]
            lead += 1
        slope[0] = 0.0
        if lead < self._leads:
            slope[0] = (self._short_leads[lead + 1, d] - self._short_leads[lead, d]) / (self._ahead[lead] - start)
        value[0] = self._short_leads[lead, d] + slope[0] * (at - start)

    cdef inline int _below(self, double at) noexcept nogil:
        """The scored lead at or before ``at``; -1 before the first."""
        cdef int lead = -1
        while lead + 1 < self._scored and self._ahead[lead + 1] <= at + 1e-9:
            lead += 1
        return lead

    cdef double _between(self, double[::1] values, int low, double at, bint scores) noexcept nogil:
        """A value by lead, linear in between, constant beyond; of ``scores`` the means, one before anything was scored."""
        cdef double first = self._value(values, max(low, 0), scores), second
        if low < 0 or low == self._scored - 1:
            return first
        second = self._value(values, low + 1, scores)
        return first + (at - self._ahead[low]) / (self._ahead[low + 1] - self._ahead[low]) * (second - first)

    cdef inline double _value(self, double[::1] values, int lead, bint scores) noexcept nogil:
        return (values[lead] + USUAL) / (self._frames[lead] + USUAL) if scores else values[lead]

    cdef double _slope(self, int low) noexcept nogil:
        """Of the weight with the horizon, 1/s."""
        if low < 0 or low == self._scored - 1:
            return 0.0
        return (self._weight[low + 1] - self._weight[low]) / (self._ahead[low + 1] - self._ahead[low])

    cdef inline int _above(self, int low) noexcept nogil:
        """The scored lead after ``low``; the last has itself."""
        return min(low + 1, self._scored - 1)

    cdef inline double _upper(self, int low, double at) noexcept nogil:
        """Share of the lead after ``low`` in what lies at ``at``."""
        if low < 0 or low == self._scored - 1:
            return 0.0
        return (at - self._ahead[low]) / (self._ahead[low + 1] - self._ahead[low])

    cdef inline double _early(self, int low, double at) noexcept nogil:
        """Share of what was measured in a band: up to the first lead it grows from what the model says of now."""
        return at / self._ahead[0] if low < 0 else 1.0

    cdef inline double _stretch(self, int pattern, int low, double at) noexcept nogil:
        """Growth of squared errors beyond the last lead that is scored."""
        if low < self._scored - 1:
            return 1.0
        return fmax(self._variance(pattern, at) / self._variance(pattern, self._ahead[low]), 1.0)

    cdef double _variance(self, int pattern, double at) noexcept nogil:
        """Variance of the short-range prediction, linear between leads, constant beyond the last."""
        cdef int lead = 0
        cdef double before = 0.0, from_s = 0.0
        while lead < self._leads and self._ahead[lead] < at:
            before, from_s = self._variances[pattern, lead], self._ahead[lead]
            lead += 1
        if lead == self._leads:
            return before
        return before + (at - from_s) / (self._ahead[lead] - from_s) * (self._variances[pattern, lead] - before)
