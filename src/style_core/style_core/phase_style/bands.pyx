"""How wide bands must be: calibration by horizon, by time in the dark, and by the person who is followed.

The filter's variances are those of people in general. Some move more regularly than others, and a band that is right
on average is too wide for the one and too narrow for the other. So predictions are checked when their time has
come, and the standard deviation follows what was found, starting from what is usual.
"""
import numpy as np

from libc.math cimport INFINITY, exp, sqrt

__all__ = ['LEAD_S', 'Bands', 'Level', 'check']

#: A prediction this far ahead is kept and checked when its time has come, s; then the next one is kept.
LEAD_S = 5 / 60.0
#: A check counts at least a fifth and at most five times what is usual.
MOST = 5.0
#: Checks are forgotten at this time constant, s: longer than one action, shorter than a change of shoes.
MEMORY_S = 10.0
#: A joint this long in the dark is on its way back to the band of people in general, s: twice the longest horizon.
FAR_S = 50 / 60.0


def check(error, std):
    """Mean square of errors in units of the predicted standard deviation."""
    ratio = error / std
    return float(np.dot(ratio, ratio)) / len(ratio)


cdef class Level:
    """Variance of somebody's errors relative to what is usual: a mean of checks that starts at one.

    After checks ``x_1 ... x_n`` (mean squared errors in predicted units) it is
    ``(w + sum_i min(max(x_i / m, 1/5), 5)) / (w + n)``, old checks fading.

    Parameters
    ----------
    median : float
        Usual check ``m``.
    weight : float
        Checks ``w`` that the start is worth.
    """

    cdef double _median, _weight, _sum, _count
    cdef readonly double factor     # on standard deviations

    def __init__(self, double median, double weight):
        self._median, self._weight = median, weight
        self.reset()

    cpdef reset(self):
        """Back to what is usual."""
        self._sum, self._count, self.factor = 0.0, 0.0, 1.0

    cpdef add(self, double value, double share=1.0, double elapsed=LEAD_S):
        """Take a check of a ``share`` of the joints, ``elapsed`` seconds after the last."""
        cdef double keep = exp(-elapsed / MEMORY_S)
        self._sum = keep * self._sum + share * min(max(value / self._median, 1 / MOST), MOST)
        self._count = keep * self._count + share
        self.factor = sqrt((self._weight + self._sum) / (self._weight + self._count))


cdef class Curve:
    """Calibration by horizon: linear in between, constant beyond the ends."""

    cdef const double[::1] _horizons, _scales

    def __init__(self, horizons, scales):
        self._horizons, self._scales = (np.ascontiguousarray(part, dtype=float) for part in (horizons, scales))

    cdef double at(self, double horizon) noexcept nogil:
        cdef long low = 0, high = self._horizons.shape[0] - 1, middle
        if horizon <= self._horizons[0]:
            return self._scales[0]
        if horizon >= self._horizons[high]:
            return self._scales[high]
        while high - low > 1:
            middle = (low + high) // 2
            if horizon < self._horizons[middle]:
                high = middle
            else:
                low = middle
        return (self._scales[high] - self._scales[low]) / (self._horizons[high] - self._horizons[low]) \
            * (horizon - self._horizons[low]) + self._scales[low]


cdef class Bands:
    """Factors on the predicted standard deviations of whoever leads.

    Parameters
    ----------
    behaviours : list of Behaviour
        With residual models.
    calibrated : bool
        False: all factors are one (for ablation).
    """

    cdef bint _calibrated
    cdef list _curves, _levels      # of each behaviour
    cdef double[::1] _age           # how long each joint has been in the dark, s
    cdef object _one                # hypothesis whose prediction is kept
    cdef double _due                # when it will be checked, s
    cdef object _kept               # mean, std and velocity, each (1, D)
    cdef double[:, :, ::1] _expected
    cdef unsigned char[::1] _watched
    cdef object _lead
    cdef double[::1] _factors       # scratch

    def __init__(self, behaviours, bint calibrated=True):
        channels = len(behaviours[0].joint_names)
        self._calibrated = calibrated
        self._curves = [Curve(one.residual.calibration_horizon, one.residual.calibration_scale) for one in behaviours]
        self._levels = [Level(one.residual.check_median, one.residual.check_weight) for one in behaviours]
        self._age = np.empty(channels)
        self._watched = np.empty(channels, dtype=np.uint8)
        kept = np.empty((3, 1, channels))
        self._kept, self._expected = tuple(kept), kept
        self._lead, self._factors = np.array([LEAD_S]), np.empty(0)
        self.reset()

    def reset(self):
        """Forget everything."""
        self._age[:] = INFINITY
        self.forget()

    cpdef forget(self):
        """Forget the person."""
        cdef Level level
        self._one, self._due = None, INFINITY
        for level in self._levels:
            level.reset()

    def observe(self, const unsigned char[::1] seen, double dt):
        """Note which joints were observed, ``dt`` seconds after the last sample."""
        cdef int d
        for d in range(seen.shape[0]):
            self._age[d] = 0.0 if seen[d] else self._age[d] + dt

    def follow(self, one, double time, const double[::1] y, const unsigned char[::1] seen):
        """Check the prediction that is due, if any, and keep the next one of the filter that leads."""
        cdef int d, count = 0
        cdef double late, ratio, total = 0, lead = LEAD_S
        cdef Level level
        if one is not self._one:
            self._one, self._due = one, INFINITY
        late = time - self._due  # -inf: nothing is kept yet
        if -INFINITY < late < -1e-9:
            return
        if -1e-9 <= late <= lead:  # the sample may be late: the predicted velocity bridges that
            for d in range(seen.shape[0]):
                if seen[d] and self._watched[d]:
                    ratio = (y[d] - self._expected[0, 0, d] - late * self._expected[2, 0, d]) / self._expected[1, 0, d]
                    total += ratio * ratio
                    count += 1
            if count:
                level = self._levels[one.behaviour]
                level.add(total / count, count / <double>seen.shape[0], lead + late)
        one.filter.forecast_into(self._lead, *self._kept)
        self._watched[:] = seen
        self._due = time + lead

    def widen(self, int index, const double[::1] horizons, double[:, ::1] std):
        """Multiply standard deviations of behaviour ``index``, shape (H, D), by what they need at ``horizons``, s.

        A joint in the dark is as uncertain as a prediction made when it was last seen: its horizon counts from there.
        What was found on joints that are seen says less and less of it.
        """
        cdef int h, d, H = horizons.shape[0], D = std.shape[1]
        cdef double level, person, age = 0.0, far = FAR_S
        cdef double *seen
        cdef double *dark
        cdef const double *factor
        cdef Curve curve = self._curves[index]
        if not self._calibrated or H == 0:
            return
        if self._factors.shape[0] < 2 * H:
            self._factors = np.empty(2 * H)
        seen, dark = &self._factors[0], &self._factors[H]
        level = (<Level>self._levels[index]).factor
        with nogil:
            for h in range(H):
                seen[h] = level * curve.at(horizons[h])
            for d in range(D):
                factor = dark if self._age[d] else seen
                if self._age[d] and self._age[d] != age:  # joints in the dark are mostly so for the same time
                    age = self._age[d]
                    person = 1 + (level - 1) * exp(-age / far)
                    for h in range(H):
                        dark[h] = person * curve.at(horizons[h] + age)
                for h in range(H):
                    std[h, d] *= factor[h]
