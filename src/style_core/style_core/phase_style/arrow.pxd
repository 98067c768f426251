"""The arrow filter's inner loops: layouts and sizes are those of arrow.h, here stand the fields that Cython uses."""
from style_core.phase_style.basis_table cimport MOST, cubic

cdef extern from "arrow.h":
    enum: WIDEST
    ctypedef struct coupled:
        int first, size
        double g[WIDEST * WIDEST]
        double prior[WIDEST * (WIDEST + 1) // 2]
        double fresh[WIDEST * (WIDEST + 1) // 2]
    ctypedef struct arrow:
        int m, n, parts, couples, blocks, channels, width, rows, third, blank
        double *states
        double *sums
        double logs, worst
        const double *y
        const unsigned char *observed
        double dt, rho
        double load[3][3]
        double back[3][3]
        double mix[3][MOST]
        int part[MOST]
        double decay[MOST]
        double renewal[MOST]
        coupled couple[MOST]
        double w[MOST]
        double s[MOST]
        double by_phase[MOST]
        double thin
        cubic at
        double delta[MOST]
        double factor[MOST * MOST]
    ctypedef struct horizon:
        cubic at
        double w[MOST]
        double s[MOST]
        double by_phase[MOST]
        double by_time[MOST]
        const double *fresh
        double ahead, speed, rho, style_rate, wander
    int arrow_v(const arrow*) noexcept nogil
    int arrow_u(const arrow*) noexcept nogil
    int arrow_g(const arrow*) noexcept nogil
    int arrow_inverse(const arrow*) noexcept nogil
    int arrow_error(const arrow*) noexcept nogil
    int arrow_constants(const arrow*) noexcept nogil
    int arrow_rows(const arrow*) noexcept nogil
    int arrow_variance(const arrow*, int) noexcept nogil
    double *arrow_cell(const arrow*, int, int) noexcept nogil
    void arrow_innovate(arrow*, int) noexcept nogil
    void arrow_fill(arrow*) noexcept nogil
    void arrow_correct(arrow*) noexcept nogil
    void arrow_mean(const arrow*, const horizon*, double*, double*, double*) noexcept nogil
    void arrow_spread(const arrow*, const horizon*, int, const double*, double**) noexcept nogil
