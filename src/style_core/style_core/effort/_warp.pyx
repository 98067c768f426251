"""Dynamic programming of time warping and of one-stage segmentation."""


def warp_costs(const double[:, ::1] distances, double[:, ::1] costs):
    """Fill ``costs`` (n, m) with the least sum of ``distances`` over paths from (0, 0), steps (1,0), (1,1), (0,1)."""
    cdef Py_ssize_t n = distances.shape[0], m = distances.shape[1], p, q
    cdef double best, left
    with nogil:
        left = 0.0
        for q in range(m):
            left += distances[0, q]
            costs[0, q] = left
        for p in range(1, n):
            left = costs[p - 1, 0] + distances[p, 0]
            costs[p, 0] = left
            for q in range(1, m):
                best = costs[p - 1, q - 1]
                if costs[p - 1, q] < best:
                    best = costs[p - 1, q]
                if left < best:
                    best = left
                left = best + distances[p, q]
                costs[p, q] = left


def trace_path(const double[:, ::1] costs, int[::1] rows, int[::1] columns):
    """Write the best path, last point first, into ``rows`` and ``columns``; return its length."""
    cdef Py_ssize_t p = costs.shape[0] - 1, q = costs.shape[1] - 1, length = 0
    with nogil:
        while True:
            rows[length] = <int>p
            columns[length] = <int>q
            length += 1
            if p == 0 and q == 0:
                break
            if p == 0:
                q -= 1
            elif q == 0:
                p -= 1
            # ties go to the diagonal: the shortest of equal paths
            elif costs[p - 1, q - 1] <= costs[p - 1, q] and costs[p - 1, q - 1] <= costs[p, q - 1]:
                p -= 1
                q -= 1
            elif costs[p - 1, q] <= costs[p, q - 1]:
                p -= 1
            else:
                q -= 1
    return length


def one_stage(const double[:, ::1] distances, const int[::1] starts, const int[::1] ends, double[::1] costs,
              long long[::1] records, double[::1] end_costs, long long[::1] end_records, long long frame):
    """Advance the one-stage recursion by the frames of ``distances`` (F, S).

    State s is a frame of one library fragment; fragment j owns the states ``starts[j]`` to ``ends[j] - 1``.
    ``costs`` and ``records`` (S,) are the state after frame ``frame - 1`` and are updated in place. A record names where
    the running fragment was entered: frame * number of fragments + fragment. ``end_costs[f]`` and ``end_records[f]``
    receive the best path that ends a fragment at frame ``frame + f``.
    """
    cdef Py_ssize_t frames = distances.shape[0], fragments = starts.shape[0], f, j, s
    cdef double enter, diagonal, above, best, left
    cdef long long diagonal_record, above_record, record, left_record, best_end_record
    cdef double best_end
    cdef double infinity = float('inf')
    with nogil:
        for f in range(frames):
            # the best end of the frame before; before the very first frame the start is free
            if frame + f == 0:
                enter = 0.0
            elif f > 0:
                enter = end_costs[f - 1]
            else:
                enter = infinity
                for j in range(fragments):
                    if costs[ends[j] - 1] < enter:
                        enter = costs[ends[j] - 1]
            best_end = infinity
            best_end_record = -1
            for j in range(fragments):
                s = starts[j]
                diagonal = costs[s]
                diagonal_record = records[s]
                if enter <= costs[s]:  # (9): enter the fragment here, or stay in its first frame
                    left = enter + distances[f, s]
                    left_record = (frame + f) * fragments + j
                else:
                    left = costs[s] + distances[f, s]
                    left_record = records[s]
                costs[s] = left
                records[s] = left_record
                for s in range(starts[j] + 1, ends[j]):  # (10)
                    above = costs[s]
                    above_record = records[s]
                    best = diagonal
                    record = diagonal_record
                    if above < best:
                        best = above
                        record = above_record
                    if left < best:
                        best = left
                        record = left_record
                    left = best + distances[f, s]
                    left_record = record
                    costs[s] = left
                    records[s] = record
                    diagonal = above
                    diagonal_record = above_record
                if left < best_end:
                    best_end = left
                    best_end_record = left_record
            end_costs[f] = best_end
            end_records[f] = best_end_record
