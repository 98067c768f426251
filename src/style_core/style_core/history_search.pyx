"""Compiled parts of `style_core.histories`: the exact search with any mask, and where the motion went from there."""


cdef extern from *:
    """
    /* Compiled for AVX2 too where the compiler can choose at run time; the sums are taken in the same order. */
    #if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && defined(__gnu_linux__)
    #define STYLE_CLONES __attribute__((target_clones("avx2", "default")))
    #else
    #define STYLE_CLONES
    #endif
    /* The `most` candidates nearest to the window, sorted by (distance, place); returns how many. A candidate is given
       up as soon as what was added up, newest frame first, exceeds `bound` or the worst that is kept. `width` is a
       multiple of 16; frame f of the window, newest first, is compared with row `usable[c] - f`. Where `sketch` is
       given, the distance of 16 coordinates in an orthonormal basis goes before: it is never larger. */
    STYLE_CLONES static int scan(const float *restrict bank, long width, const int *restrict usable, int count,
                                 const float *restrict window, const float *restrict weight, int frames, int most,
                                 float bound, const float *restrict sketches, const float *restrict sketch,
                                 int *restrict found, float *restrict distance)
    {
        int kept = 0;
        for (int c = 0; c < count; c++) {
            const float *row = bank + usable[c] * width;
            float limit = kept == most ? distance[most - 1] : bound, total = 0.0f;
            if (sketch) {
                const float *z = sketches + c * 16L;
                float s[8];
                for (int j = 0; j < 8; j++) {
                    float d = z[j] - sketch[j], e = z[8 + j] - sketch[8 + j];
                    s[j] = d * d + e * e;
                }
                /* a little more than rounding can be wrong */
                if (((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7])) > 1.0001f * limit + 1e-6f)
                    continue;
            }
            for (int f = 0; f < frames && total <= limit; f++) {
                const float *a = row - f * width, *b = window + f * width, *w = weight + f * width;
                for (long k = 0; k < width && total <= limit; k += 16) {
                    float s[8];
                    for (int j = 0; j < 8; j++) {
                        float d = a[k + j] - b[k + j], e = a[k + 8 + j] - b[k + 8 + j];
                        s[j] = w[k + j] * (d * d) + w[k + 8 + j] * (e * e);
                    }
                    total += ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]));
                }
            }
            if (total > limit || (kept == most && total == limit)) continue;
            int at = kept < most ? kept++ : most - 1;
            for (; at > 0 && distance[at - 1] > total; at--) {
                distance[at] = distance[at - 1];
                found[at] = found[at - 1];
            }
            distance[at] = total;
            found[at] = usable[c];
        }
        return kept;
    }
    """
    int scan(const float *bank, long width, const int *usable, int count, const float *window, const float *weight,
             int frames, int most, float bound, const float *sketches, const float *sketch, int *found,
             float *distance) noexcept nogil


def nearest(const float[:, ::1] bank, const int[::1] usable, const float[:, ::1] window, const float[:, ::1] weight,
            float bound, const float[:, ::1] sketches, const float[::1] sketch, int[::1] found, float[::1] distance):
    """Fill ``found`` and ``distance`` with the nearest rows within ``bound``, nearest first; return how many.

    ``window`` and ``weight`` have their newest frame first; every row of ``usable`` has as many rows before it.
    ``sketches`` holds 16 coordinates of the history of every row of ``usable``, ``sketch`` those of the window; where it
    is None (some values were not seen), every candidate is compared in full.
    """
    cdef int kept
    cdef const float *all_sketches = NULL
    cdef const float *own = NULL
    if sketch is not None:
        all_sketches, own = &sketches[0, 0], &sketch[0]
    with nogil:
        kept = scan(&bank[0, 0], bank.shape[1], &usable[0], <int>usable.shape[0], &window[0, 0], &weight[0, 0],
                    <int>window.shape[0], <int>found.shape[0], bound, all_sketches, own, &found[0], &distance[0])
    return kept


def even_window(const double[::1] times, const float[:, ::1] y, const float[:, ::1] seen, Py_ssize_t count,
                double period, const int[::1] order, float[:, ::1] window, float[:, ::1] weight):
    """The last ``count`` observations as frames ``period`` s apart, newest first, channels in ``order``.

    Linear between observations at most two and a half periods apart, where both were seen; otherwise weight 0.
    """
    cdef Py_ssize_t f, d, channel, right = count - 1, left
    cdef double wanted, gap, slack = 0.02 * period
    cdef float share, there
    with nogil:
        window[:, :] = 0.0
        weight[:, :] = 0.0
        for f in range(window.shape[0] if count else 0):
            wanted = times[count - 1] - f * period
            while right > 0 and times[right - 1] >= wanted - slack:
                right -= 1
            if times[right] - wanted <= slack:  # an observation of this very instant
                if times[right] < wanted - slack:
                    continue
                left, share = right, 1.0
            else:
                left = right - 1
                if left < 0:
                    break
                gap = times[right] - times[left]
                if gap > 2.5 * period + slack:
                    continue
                share = <float>((wanted - times[left]) / gap)
            for d in range(order.shape[0]):
                channel = order[d]
                there = seen[left, channel] * seen[right, channel]
                weight[f, d] = there
                window[f, d] = there * ((1 - share) * y[left, channel] + share * y[right, channel])
    return


def displace(const float[:, ::1] bank, const int[::1] found, const int[::1] last, double rate_hz,
             const double[::1] horizons, double[:, ::1] mean, double[:, ::1] velocity):
    """Mean displacement and its velocity, rad and rad/s, ``horizons`` s after the rows ``found``.

    Linear between rows; after the row ``last`` of its recording a neighbour stands still.
    """
    cdef Py_ssize_t h, n, d, left, count = found.shape[0], width = mean.shape[1]
    cdef double place, share, step
    with nogil:
        mean[:, :] = 0.0
        velocity[:, :] = 0.0
        for h in range(horizons.shape[0]):
            for n in range(count):
                place = found[n] + horizons[h] * rate_hz
                left = <Py_ssize_t>(place + 1e-9)
                if left >= last[n]:
                    for d in range(width):
                        mean[h, d] += <double>bank[last[n], d] - bank[found[n], d]
                    continue
                share = place - left
                for d in range(width):
                    step = <double>bank[left + 1, d] - bank[left, d]
                    mean[h, d] += (<double>bank[left, d] - bank[found[n], d]) + share * step
                    velocity[h, d] += step
            for d in range(width):
                mean[h, d] /= count
                velocity[h, d] *= rate_hz / count
